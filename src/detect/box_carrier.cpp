// SPDX-License-Identifier: Apache-2.0
#include "detect/box_carrier.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

constexpr double kUnknownDepth_m = 2.5;  // a box without readings is carried as if it stood here
constexpr double kSameObject_m = 0.8;    // two detections of a class nearer than this are one object
constexpr double kFastest_m_s = 2.5;     // a quick walk
constexpr double kGrowth_per_s = 0.4;    // of the box's size, for what the velocity does not know
constexpr int kMostMisses = 2;
constexpr double kMemory = 0.7;           // what the looks so far are still worth at the next
constexpr double kLongestCoast_s = 0.35;  // the velocity is trusted this long

double depth_or_guess(const Detection& d) {
  return d.depth_m > 0 ? d.depth_m : kUnknownDepth_m;
}

}  // namespace

void measure_depths(Detections& detections, ImageView<const std::uint16_t> depth, const CameraModel& camera) {
  std::array<float, 1024> readings;
  for (Detection& d : detections.items) {
    const Box& b = d.box;
    // A grid of at most 32 x 32 pixels over the middle half of the box.
    std::size_t count = 0;
    for (int row = 0; row < 32; ++row) {
      for (int column = 0; column < 32; ++column) {
        const int x = static_cast<int>(b.x0 + b.width() * (0.25f + 0.5f * static_cast<float>(column) / 31));
        const int y = static_cast<int>(b.y0 + b.height() * (0.25f + 0.5f * static_cast<float>(row) / 31));
        if (!depth.contains(x, y)) continue;
        const double z = camera.depth_m(depth.at(x, y));
        if (z > 0) readings[count++] = static_cast<float>(z);
      }
    }
    d.depth_m = 0;
    if (count < 16) continue;
    const auto quarter = readings.begin() + static_cast<std::ptrdiff_t>(count / 4);
    std::nth_element(readings.begin(), quarter, readings.begin() + static_cast<std::ptrdiff_t>(count));
    d.depth_m = *quarter;
  }
}

BoxCarrier::Track BoxCarrier::track_of(const Detection& d, Nanoseconds stamp_ns,
                                       const Pose& T_odom_camera) const {
  const double z = depth_or_guess(d);
  const auto in_odom = [&](float x, float y) {
    const Vec2 ray = camera_.undistort({x, y});
    return T_odom_camera * Vec3{ray.x * z, ray.y * z, z};
  };
  Track t;
  t.seen = d;
  t.corners = {in_odom(d.box.x0, d.box.y0), in_odom(d.box.x1, d.box.y0), in_odom(d.box.x1, d.box.y1),
               in_odom(d.box.x0, d.box.y1)};
  t.centre = 0.25 * (t.corners[0] + t.corners[1] + t.corners[2] + t.corners[3]);
  t.first_seen_ns = t.seen_ns = stamp_ns;
  return t;
}

BoxCarrier::Track* BoxCarrier::nearest(const Track& fresh) {
  Track* best = nullptr;
  double best_distance = kSameObject_m;
  for (Track& t : tracks_) {
    if (t.matched || t.seen.class_id != fresh.seen.class_id) continue;
    const double ahead = std::min(to_seconds(fresh.seen_ns - t.seen_ns), kLongestCoast_s);
    const double distance = norm(t.centre + ahead * t.velocity - fresh.centre);
    if (distance < best_distance) {
      best_distance = distance;
      best = &t;
    }
  }
  return best;
}

void BoxCarrier::update(const Detections& fresh, const Pose& T_odom_camera) {
  for (Track& t : tracks_) t.matched = false;
  for (const Detection& d : fresh.items) {
    Track track = track_of(d, fresh.stamp_ns, T_odom_camera);
    track.matched = true;
    track.evidence = d.score;
    Track* before = nearest(track);
    if (before == nullptr) {
      track.object = ++objects_;
      static_cast<void>(tracks_.try_push_back(track));
      continue;
    }
    track.evidence += kMemory * before->evidence;
    track.object = before->object;
    track.first_seen_ns = before->first_seen_ns;
    const double span = to_seconds(fresh.stamp_ns - before->seen_ns);
    const bool both_deep = d.depth_m > 0 && before->seen.depth_m > 0;
    if (span > 0 && both_deep) {
      Vec3 velocity = 1 / span * (track.centre - before->centre);
      const double speed = norm(velocity);
      if (speed > kFastest_m_s) velocity = kFastest_m_s / speed * velocity;
      track.velocity = before->has_velocity ? 0.5 * (velocity + before->velocity) : 0.5 * velocity;
      track.has_velocity = true;
    }
    *before = track;
  }
  for (Track& t : tracks_) {
    t.misses = t.matched ? 0 : t.misses + 1;
    if (!t.matched) t.evidence *= kMemory;
  }
  const auto gone = [](const Track& t) { return t.misses > kMostMisses; };
  tracks_.truncate(
      static_cast<std::size_t>(std::remove_if(tracks_.begin(), tracks_.end(), gone) - tracks_.begin()));
}

void BoxCarrier::carry(Nanoseconds stamp_ns, const Pose& T_odom_camera, Detections& out) {
  const auto too_old = [&](const Track& t) { return stamp_ns - t.seen_ns > max_age_ns_; };
  tracks_.truncate(
      static_cast<std::size_t>(std::remove_if(tracks_.begin(), tracks_.end(), too_old) - tracks_.begin()));
  out.items.clear();
  out.stamp_ns = stamp_ns;
  const Pose T_camera_odom = inverse(T_odom_camera);
  for (const Track& t : tracks_) {
    if (t.evidence < confirm_score_) continue;
    Detection d = t.seen;
    d.object = t.object;
    d.age_ns = stamp_ns - t.first_seen_ns;
    d.velocity_m_s = t.velocity;
    const double age = to_seconds(stamp_ns - t.seen_ns);
    if (age > 0) {
      const Vec3 moved = std::min(age, kLongestCoast_s) * t.velocity;
      constexpr float kInf = std::numeric_limits<float>::infinity();
      Box box{kInf, kInf, -kInf, -kInf};
      bool in_front = true;
      for (const Vec3& corner : t.corners) {
        const Vec3 p = T_camera_odom * (corner + moved);
        in_front &= p.z > 0.1;
        if (!in_front) break;
        // Without the lens: its polynomial means nothing outside the picture, where corners may well lie.
        const auto x = static_cast<float>(camera_.fx * p.x / p.z + camera_.cx);
        const auto y = static_cast<float>(camera_.fy * p.y / p.z + camera_.cy);
        box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x), std::max(box.y1, y)};
      }
      if (!in_front) continue;
      const auto grow_x = static_cast<float>(kGrowth_per_s * age) * box.width() / 2;
      const auto grow_y = static_cast<float>(kGrowth_per_s * age) * box.height() / 2;
      d.box = {std::max(0.0f, box.x0 - grow_x), std::max(0.0f, box.y0 - grow_y),
               std::min(static_cast<float>(camera_.width), box.x1 + grow_x),
               std::min(static_cast<float>(camera_.height), box.y1 + grow_y)};
      if (d.box.width() <= 1 || d.box.height() <= 1) continue;
      if (d.depth_m > 0) {
        const Vec3 centre = T_camera_odom * (t.centre + moved);
        d.depth_m = static_cast<float>(std::max(0.1, centre.z));
      }
    }
    static_cast<void>(out.items.try_push_back(d));
  }
}

}  // namespace stillmap
