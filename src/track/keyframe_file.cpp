// SPDX-License-Identifier: Apache-2.0
#include "track/keyframe_file.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <unordered_map>

#include "track/pyramid.h"

namespace stillmap {

namespace {

static_assert(std::endian::native == std::endian::little, "the records hold what lies in memory");

constexpr std::uint32_t kKeyframe = 1, kPoint = 2;

struct KeyframeRecord {
  std::uint32_t kind = kKeyframe, id = 0;
  std::uint64_t sequence = 0;
  std::int64_t stamp_ns = 0;
  Pose T_map_camera;
  std::uint32_t tracked_points = 0, features = 0;
  std::uint32_t segment = 0, unused = 0;
};
static_assert(sizeof(KeyframeRecord) == 136);

struct FeatureRecord {
  float ray_x = 0, ray_y = 0, depth_m = 0;
  std::uint32_t octave = 0, point_id = 0, unused = 0;  // point 0: none
  Descriptor descriptor;
};
static_assert(sizeof(FeatureRecord) == 56);
static_assert(sizeof(KeyframeRecord) + kMaxFeatures * sizeof(FeatureRecord) <=
              KeyframeWriter::kLargestRecord);

struct PointRecord {
  std::uint32_t kind = kPoint, id = 0;
  Vec3 p_map, view_direction;
  Symmetric3 information{};
  double reference_distance_m = 0;
  std::uint32_t reference_octave = 0, suspect = 0, visible = 0, found = 0;
  Descriptor descriptor;
  std::uint32_t segment = 0, unused = 0;
};
static_assert(sizeof(PointRecord) == 168);

class Room {
 public:
  explicit Room(std::span<std::byte> memory) : memory_(memory) {}
  std::size_t left() const { return memory_.size() - used_; }
  std::size_t used() const { return used_; }
  template <class T>
  void put(const T& record) {
    static_assert(std::is_trivially_copyable_v<T>);
    std::memcpy(memory_.data() + used_, &record, sizeof(T));
    used_ += sizeof(T);
  }

 private:
  std::span<std::byte> memory_;
  std::size_t used_ = 0;
};

void put_keyframe(const Keyframe& keyframe, const LocalMap& map, const Pose& T_map_odom, Room& room) {
  room.put(KeyframeRecord{.id = keyframe.id,
                          .sequence = keyframe.sequence,
                          .stamp_ns = keyframe.stamp_ns,
                          .T_map_camera = T_map_odom * keyframe.T_odom_camera,
                          .tracked_points = static_cast<std::uint32_t>(keyframe.tracked_points),
                          .features = static_cast<std::uint32_t>(keyframe.features.size()),
                          .segment = keyframe.segment});
  for (std::size_t i = 0; i < keyframe.features.size(); ++i) {
    const KeyframeFeature& f = keyframe.features[i];
    const bool stands =
        f.point.slot >= 0 && map.points()[static_cast<std::size_t>(f.point.slot)].id == f.point.id;
    room.put(FeatureRecord{.ray_x = f.ray_x,
                           .ray_y = f.ray_y,
                           .depth_m = f.depth_m,
                           .octave = f.octave,
                           .point_id = stands ? f.point.id : 0,
                           .descriptor = keyframe.descriptors[i]});
  }
}

void put_point(const MapPoint& point, const Pose& T_map_odom, Room& room) {
  room.put(PointRecord{.id = point.id,
                       .p_map = T_map_odom * point.p_odom,
                       .view_direction = T_map_odom.R * point.view_direction,
                       .information = turned(point.information, T_map_odom.R),
                       .reference_distance_m = point.reference_distance_m,
                       .reference_octave = point.reference_octave,
                       .suspect = point.suspect ? 1U : 0U,
                       .visible = point.visible,
                       .found = point.found,
                       .descriptor = point.descriptor,
                       .segment = point.segment});
}

// A file's bytes are a stranger's. What the tracker takes for granted is looked at here, once.
constexpr std::uint32_t kLargestId = 1U << 31;  // no robot makes as many; later ones must not wrap

bool is_finite(Vec3 v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

bool is_sound(const KeyframeRecord& record) {
  if (record.id == 0 || record.id > kLargestId || record.segment > kLargestId ||
      record.features > kMaxFeatures || record.tracked_points > kMaxFeatures ||
      !is_finite(record.T_map_camera))
    return false;
  const Mat3 rest = transposed(record.T_map_camera.R) * record.T_map_camera.R;
  return std::abs(rest(0, 0) - 1) < 1e-3 && std::abs(rest(1, 1) - 1) < 1e-3 &&
         std::abs(rest(2, 2) - 1) < 1e-3;
}

bool is_sound(const FeatureRecord& f) {
  return f.octave < Pyramid::kMaxLevels && std::isfinite(f.ray_x) && std::isfinite(f.ray_y) &&
         std::isfinite(f.depth_m) && f.depth_m >= 0;
}

bool is_sound(const PointRecord& point) {
  constexpr std::uint32_t kMost = std::numeric_limits<std::uint16_t>::max();
  return point.segment <= kLargestId && is_finite(point.p_map) && is_finite(point.view_direction) &&
         std::ranges::all_of(point.information, [](double v) { return std::isfinite(v); }) &&
         std::isfinite(point.reference_distance_m) && point.reference_distance_m > 0 &&
         point.reference_octave < Pyramid::kMaxLevels && point.visible <= kMost && point.found <= kMost;
}

FeatureRecord feature_at(std::span<const std::byte> features, std::size_t i) {
  FeatureRecord f;
  std::memcpy(&f, features.data() + i * sizeof(f), sizeof(f));
  return f;
}

/// Calls `keyframe(record, its features as bytes)` and `point(record)` for each record; false where the bytes
/// are none.
template <class OnKeyframe, class OnPoint>
bool for_each_record(std::span<const std::byte> bytes, OnKeyframe&& on_keyframe, OnPoint&& on_point) {
  const auto take = [&](auto& record) {
    if (bytes.size() < sizeof(record)) return false;
    std::memcpy(&record, bytes.data(), sizeof(record));
    bytes = bytes.subspan(sizeof(record));
    return true;
  };
  while (!bytes.empty()) {
    std::uint32_t kind = 0;
    if (bytes.size() < sizeof(kind)) return false;
    std::memcpy(&kind, bytes.data(), sizeof(kind));
    if (KeyframeRecord keyframe; kind == kKeyframe && take(keyframe)) {
      const std::size_t size = keyframe.features * sizeof(FeatureRecord);
      if (!is_sound(keyframe) || bytes.size() < size) return false;
      for (std::size_t i = 0; i < keyframe.features; ++i) {
        if (!is_sound(feature_at(bytes, i))) return false;
      }
      on_keyframe(keyframe, bytes.first(size));
      bytes = bytes.subspan(size);
    } else if (PointRecord point; kind == kPoint && take(point)) {
      if (!is_sound(point)) return false;
      on_point(point);
    } else {
      return false;
    }
  }
  return true;
}

MapPoint point_of(const PointRecord& record) {
  MapPoint point;
  point.p_odom = record.p_map;
  point.information = record.information;
  point.view_direction = record.view_direction;
  point.descriptor = record.descriptor;
  point.reference_distance_m = record.reference_distance_m;
  point.reference_octave = static_cast<std::uint8_t>(record.reference_octave);
  point.suspect = record.suspect != 0;
  point.visible = static_cast<std::uint16_t>(record.visible);
  point.found = static_cast<std::uint16_t>(record.found);
  return point;
}

using PointRefs = std::unordered_map<std::uint32_t, PointRef>;  // by the id in the file

void put_into(LocalMap& map, const KeyframeRecord& record, std::span<const std::byte> features,
              const PointRefs& refs) {
  map.enter_segment(record.segment);
  Keyframe& keyframe = map.add_keyframe();
  keyframe.id = record.id;
  keyframe.sequence = record.sequence;
  keyframe.stamp_ns = record.stamp_ns;
  keyframe.T_odom_camera = record.T_map_camera;
  keyframe.tracked_points = static_cast<int>(record.tracked_points);
  for (std::size_t i = 0; i < record.features; ++i) {
    const FeatureRecord f = feature_at(features, i);
    const auto ref = refs.find(f.point_id);
    static_cast<void>(
        keyframe.features.try_push_back({f.ray_x, f.ray_y, f.depth_m, static_cast<std::uint8_t>(f.octave),
                                         ref == refs.end() ? PointRef{} : ref->second}));
    keyframe.descriptors[i] = f.descriptor;
  }
}

}  // namespace

std::size_t KeyframeWriter::write(const LocalMap& map, const Pose& T_map_odom, std::span<std::byte> out) {
  Room room(out);
  for (; next_keyframe_ < map.keyframes().size(); ++next_keyframe_) {
    const Keyframe& keyframe = map.keyframes()[next_keyframe_];
    if (!keyframe.alive) continue;
    if (room.left() < sizeof(KeyframeRecord) + keyframe.features.size() * sizeof(FeatureRecord))
      return room.used();
    put_keyframe(keyframe, map, T_map_odom, room);
  }
  for (; next_point_ < map.points().size(); ++next_point_) {
    const MapPoint& point = map.points()[next_point_];
    if (!point.alive) continue;
    if (room.left() < sizeof(PointRecord)) return room.used();
    put_point(point, T_map_odom, room);
  }
  return room.used();
}

Result<KeyframeCounts> count_keyframes(std::span<const std::byte> bytes) {
  KeyframeCounts counts;
  const bool sound = for_each_record(
      bytes, [&](const KeyframeRecord&, std::span<const std::byte>) { ++counts.keyframes; },
      [&](const PointRecord&) { ++counts.points; });
  if (!sound) return Error{ExitCode::UnreadableInput, "its keyframes are damaged; take an earlier file"};
  return counts;
}

Status read_keyframes(std::span<const std::byte> bytes, LocalMap& map) {
  const Result<KeyframeCounts> counts = count_keyframes(bytes);
  if (!counts.ok()) return counts.error();
  const auto [keyframes, points] = counts.value();
  if (keyframes > map.keyframes().size() || points > map.points().size()) {
    return Error{ExitCode::WrongConfig, "holds " + std::to_string(keyframes) + " keyframes and " +
                                            std::to_string(points) +
                                            " points; raise track.keyframes and track.points to that"};
  }
  PointRefs refs;
  refs.reserve(points);
  static_cast<void>(for_each_record(
      bytes, [](const KeyframeRecord&, std::span<const std::byte>) {},
      [&](const PointRecord& record) {
        map.enter_segment(record.segment);
        refs[record.id] = map.add_point(point_of(record));
      }));
  std::uint32_t last_id = 0;
  static_cast<void>(for_each_record(
      bytes,
      [&](const KeyframeRecord& record, std::span<const std::byte> features) {
        put_into(map, record, features, refs);
        last_id = std::max(last_id, record.id);
      },
      [](const PointRecord&) {}));
  map.begin_keyframe_ids_after(last_id);
  if (const Keyframe* newest = map.newest_keyframe()) map.enter_segment(newest->segment);
  return {};
}

}  // namespace stillmap
