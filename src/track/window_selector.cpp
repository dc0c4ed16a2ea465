// SPDX-License-Identifier: Apache-2.0
#include "track/window_selector.h"

#include <algorithm>

#include "track/point_trust.h"

namespace stillmap {

namespace {

constexpr int kFewestShared = 30;
constexpr std::uint16_t kAbsent = 0xffff, kSeenByNewest = 0xfffe;

struct Sharing {
  std::uint16_t slot = 0;
  std::uint32_t id = 0;
  int shared = 0;
};

}  // namespace

WindowSelector::WindowSelector(Arena& arena, const CameraModel& camera, std::size_t points)
    : camera_(camera), index_of_slot_(arena.take<std::uint16_t>("window.index_of_point", points)) {}

void WindowSelector::choose_views(LocalMap& map, const Keyframe& newest, AdjustmentWindow& window) {
  std::fill(index_of_slot_.begin(), index_of_slot_.end(), kAbsent);
  for (const KeyframeFeature& f : newest.features) {
    if (map.find(f.point) != nullptr) index_of_slot_[static_cast<std::size_t>(f.point.slot)] = kSeenByNewest;
  }
  FixedVector<Sharing, AdjustmentWindow::kViews - 1> best;  // most shared first
  const std::span<Keyframe> keyframes = map.keyframes();
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    const Keyframe& keyframe = keyframes[k];
    if (!keyframe.alive || keyframe.id == newest.id) continue;
    const auto shared =
        std::count_if(keyframe.features.begin(), keyframe.features.end(), [&](const KeyframeFeature& f) {
          return f.point.slot >= 0 &&
                 index_of_slot_[static_cast<std::size_t>(f.point.slot)] == kSeenByNewest &&
                 map.find(f.point) != nullptr;
        });
    if (shared < kFewestShared) continue;
    const Sharing entry{static_cast<std::uint16_t>(k), keyframe.id, static_cast<int>(shared)};
    if (!best.try_push_back(entry)) {
      Sharing& last = *(best.end() - 1);
      if (last.shared >= entry.shared) continue;
      last = entry;
    }
    for (Sharing* s = best.end() - 1; s != best.begin() && s->shared > (s - 1)->shared; --s)
      std::swap(*s, *(s - 1));
  }
  std::sort(best.begin(), best.end(), [](const Sharing& a, const Sharing& b) { return a.id > b.id; });
  window.views.clear();
  const auto add = [&](std::size_t slot, bool fixed) {
    static_cast<void>(window.views.try_push_back({keyframes[slot].id, static_cast<std::uint16_t>(slot), fixed,
                                                  inverse(keyframes[slot].T_odom_camera)}));
  };
  add(static_cast<std::size_t>(&newest - keyframes.data()), false);
  for (std::size_t i = 0; i < best.size(); ++i) {
    // Something must hold the window in its place.
    const bool fixed = window.views.size() >= AdjustmentWindow::kFreeViews || i + 1 == best.size();
    add(best[i].slot, fixed);
  }
}

bool WindowSelector::select(LocalMap& map, const FeatureExtractor& extractor, AdjustmentWindow& window) {
  window.views.clear();
  window.points.clear();
  window.observations.clear();
  const Keyframe* newest = map.newest_keyframe();
  if (newest == nullptr) return false;
  choose_views(map, *newest, window);
  if (window.views.size() < 3) return false;

  std::fill(index_of_slot_.begin(), index_of_slot_.end(), kAbsent);
  for (std::size_t v = 0; v < window.views.size(); ++v) {
    const WindowView& view = window.views[v];
    for (const KeyframeFeature& f : map.keyframes()[view.keyframe_slot].features) {
      const MapPoint* point = map.find(f.point);
      if (point == nullptr || trust_in(*point, Label::Static, newest->stamp_ns) <= 0) continue;
      std::uint16_t& index = index_of_slot_[static_cast<std::size_t>(f.point.slot)];
      if (index == kAbsent) {
        // A point that no free view sees says nothing.
        if (view.fixed ||
            !window.points.try_push_back({f.point, point->p_odom, point->p_odom, point->information}))
          continue;
        index = static_cast<std::uint16_t>(window.points.size() - 1);
      }
      const double sigma_px = extractor.sigma_px(f.octave);
      const double sigma_depth = f.depth_m > 0 ? camera_.depth_sigma_m(static_cast<double>(f.depth_m)) : 0;
      static_cast<void>(window.observations.try_push_back({static_cast<std::uint16_t>(v), index, f.ray_x,
                                                           f.ray_y, static_cast<float>(sigma_px), f.depth_m,
                                                           static_cast<float>(sigma_depth)}));
    }
  }
  return !window.observations.empty();
}

Pose WindowSelector::apply(const AdjustmentWindow& window, LocalMap& map) {
  Pose move;
  for (const WindowView& view : window.views) {
    Keyframe& keyframe = map.keyframes()[view.keyframe_slot];
    if (view.fixed || !keyframe.alive || keyframe.id != view.keyframe_id) continue;
    const Pose after = inverse(view.T_camera_odom);
    if (&view == window.views.begin()) move = after * inverse(keyframe.T_odom_camera);
    keyframe.T_odom_camera = after;
  }
  for (const WindowPoint& adjusted : window.points) {
    if (MapPoint* point = map.find(adjusted.ref)) point->p_odom = adjusted.p_odom;
  }
  return move;
}

}  // namespace stillmap
