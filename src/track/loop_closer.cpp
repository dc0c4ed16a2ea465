// SPDX-License-Identifier: Apache-2.0
#include "track/loop_closer.h"

#include <algorithm>

namespace stillmap {

namespace {

constexpr std::uint32_t kApart = 15;             // keyframes between the two ends of a loop
constexpr int kTied = 15;                        // shared points that already hold two keyframes together
constexpr std::uint64_t kVisitsPerFrame = 8000;  // of the place index: some 0.7 ms
constexpr int kFewestResembling = 8;             // features, for a candidate
constexpr std::uint32_t kSuccessive = 10;        // keyframes within which the next one must confirm

// Two sightings of one place differ by their own errors and by the odometry between them.
constexpr double kOff_m = 0.06, kOff_rad = 0.05, kOdometryShare = 0.05;

}  // namespace

LoopCloser::LoopCloser(Arena& arena, const Config::Track& config, const CameraModel& camera,
                       const PlaceIndex& places)
    : places_(places),
      query_(arena, places),
      matcher_(arena, config, camera),
      pair_(arena.take<Keyframe>("loop_closer.pair", 2)),
      marked_(arena.take<std::uint32_t>("loop_closer.points", static_cast<std::size_t>(config.points))) {}

const Keyframe* LoopCloser::find(const LocalMap& map, KeyframeRef ref) {
  const Keyframe& keyframe = map.keyframes()[ref.slot];
  return keyframe.alive && keyframe.id == ref.id ? &keyframe : nullptr;
}

void LoopCloser::mark_points(const Keyframe& keyframe) {
  std::fill(marked_.begin(), marked_.end(), 0u);
  for (const KeyframeFeature& f : keyframe.features) {
    if (f.point.slot >= 0) marked_[static_cast<std::size_t>(f.point.slot)] = f.point.id;
  }
}

bool LoopCloser::is_tied(const Keyframe& keyframe) const {
  return kTied <=
         std::count_if(keyframe.features.begin(), keyframe.features.end(), [&](const KeyframeFeature& f) {
           return f.point.slot >= 0 && marked_[static_cast<std::size_t>(f.point.slot)] == f.point.id;
         });
}

void LoopCloser::ask(const LocalMap& map, std::size_t slot) {
  ++counts_.asked;
  if (busy()) {
    ++counts_.skipped;
    return;
  }
  asking_ = {slot, map.keyframes()[slot].id};
  candidates_.clear();
  next_ = 0;
  query_.begin(places_.descriptors(slot));
  gathering_ = true;
}

void LoopCloser::gather(const LocalMap& map) {
  if (!gathering_) return;
  const Keyframe* a = find(map, asking_);
  if (a == nullptr) return end_question();  // the ring has given its slot to another keyframe
  if (!query_.vote(kVisitsPerFrame)) return;
  gathering_ = false;
  mark_points(*a);
  for (const PlaceCandidate& c : query_.ranked()) {
    const Keyframe& b = map.keyframes()[c.slot];
    if (c.features < kFewestResembling || !b.alive || b.id >= a->id) continue;
    const bool apart = a->id - b.id >= kApart || b.segment != a->segment;
    if (!apart || is_tied(b)) continue;
    if (!candidates_.try_push_back({c.slot, b.id})) break;
  }
  if (!sighting_) return;
  // What the last sighting saw comes first: it waits to be confirmed.
  const auto near = std::find_if(candidates_.begin(), candidates_.end(), [&](KeyframeRef c) {
    return std::max(c.id, sighting_->b) - std::min(c.id, sighting_->b) < kApart;
  });
  if (near != candidates_.end()) std::rotate(candidates_.begin(), near, near + 1);
}

bool LoopCloser::confirms(const Sighting& earlier, const Sighting& now) const {
  if (now.a - earlier.a > kSuccessive) return false;
  const Pose T_now_earlier_a = inverse(now.T_odom_a) * earlier.T_odom_a;
  const Pose T_earlier_now_b = inverse(earlier.T_odom_b) * now.T_odom_b;
  const Pose off = T_now_earlier_a * earlier.T_a_b * T_earlier_now_b * inverse(now.T_a_b);
  const double way_m = norm(T_now_earlier_a.t) + norm(T_earlier_now_b.t);
  // The lever: an error in direction moves what is far.
  const double reach_m = norm(now.T_a_b.t);
  return norm(log_so3(off.R)) < kOff_rad &&
         norm(off.t) < kOff_m + kOdometryShare * way_m + 0.5 * kOff_rad * reach_m;
}

bool LoopCloser::awaits(std::uint32_t keyframe_id) const {
  return sighting_ && keyframe_id - sighting_->a <= kSuccessive;
}

bool LoopCloser::prepare(const LocalMap& map, Random random) {
  if (gathering_) return false;
  const Keyframe* a = find(map, asking_);
  if (a == nullptr) end_question();
  for (; next_ < candidates_.size(); ++next_) {
    const Keyframe* b = find(map, candidates_[next_]);
    if (b == nullptr) continue;
    pair_[0] = *a;
    pair_[1] = *b;
    random_ = random;
    return true;
  }
  return false;
}

void LoopCloser::compare() {
  match_ = matcher_.match(pair_[0], pair_[1], random_);
}

std::optional<LoopEdge> LoopCloser::judge(const LocalMap& map) {
  ++counts_.compared;
  ++next_;
  if (!match_ || !match_->is_convincing()) return std::nullopt;
  end_question();  // the others see the same place
  ++counts_.verified;
  // Where they are now: the map may have been mended meanwhile.
  const Keyframe *a = map.find_keyframe(pair_[0].id), *b = map.find_keyframe(pair_[1].id);
  if (a == nullptr || b == nullptr) return std::nullopt;
  const Sighting now{a->id, b->id, match_->T_a_b, a->T_odom_camera, b->T_odom_camera};
  const bool sure = sighting_ && confirms(*sighting_, now);
  sighting_ = now;
  if (!sure) return std::nullopt;
  sighting_.reset();  // it has served
  ++counts_.closed;
  return LoopEdge{a->id, b->id, match_->T_a_b, match_->information, match_->inliers};
}

}  // namespace stillmap
