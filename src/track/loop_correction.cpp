// SPDX-License-Identifier: Apache-2.0
#include "track/loop_correction.h"

#include <algorithm>

namespace stillmap {

namespace {

constexpr std::size_t kTiesPerKeyframe = 8;
// Every fourth feature tells as well as all who shares points with whom.
constexpr std::size_t kStride = 4;
constexpr int kFewestShared = 8;                      // of those
constexpr std::uint32_t kNoMark = ~std::uint32_t{0};  // where nodes are marked
constexpr std::uint32_t kNoPoint = 0;                 // where ids of points are

std::array<double, 36> information_of(double sigma_rad, double sigma_m) {
  std::array<double, 36> information{};
  for (std::size_t i = 0; i < 6; ++i)
    information[7 * i] = 1 / (i < 3 ? sigma_rad * sigma_rad : sigma_m * sigma_m);
  return information;
}

/// What tracking from one keyframe to the next may be wrong by, 1 sigma: a little, and a share of the way.
std::array<double, 36> odometry_information(const Pose& T_a_b) {
  const double way_m = norm(T_a_b.t), turn_rad = norm(log_so3(T_a_b.R));
  return information_of(0.003 + 0.02 * turn_rad + 0.01 * way_m, 0.005 + 0.03 * way_m + 0.02 * turn_rad);
}

/// Two keyframes that stand on the same points, however they came there.
std::array<double, 36> shared_information() {
  return information_of(0.008, 0.015);
}

void move_point(MapPoint& point, const Pose& T) {
  point.p_odom = T * point.p_odom;
  point.view_direction = T.R * point.view_direction;
  point.information = turned(point.information, T.R);
}

}  // namespace

LoopCorrection::LoopCorrection(Arena& arena, std::size_t keyframes, std::size_t points)
    : graph_(arena, keyframes, (kTiesPerKeyframe + 1) * keyframes),
      nodes_(arena.take<Node>("loop_correction.nodes", keyframes)),
      loops_(arena.take<LoopEdge>("loop_correction.loops", keyframes)),
      mark_of_point_(arena.take<std::uint32_t>("loop_correction.marks", points)) {}

std::optional<std::uint32_t> LoopCorrection::node_of(std::uint32_t keyframe_id) const {
  const auto at = std::lower_bound(nodes_.begin(), nodes_.end(), keyframe_id,
                                   [](const Node& n, std::uint32_t id) { return n.id < id; });
  if (at == nodes_.end() || at->id != keyframe_id) return std::nullopt;
  return static_cast<std::uint32_t>(at - nodes_.begin());
}

void LoopCorrection::collect_nodes(const LocalMap& map) {
  nodes_.clear();
  for (std::size_t slot = 0; slot < map.keyframes().size(); ++slot) {
    const Keyframe& k = map.keyframes()[slot];
    if (k.alive && (k.segment == segment_ || k.segment == other_))
      static_cast<void>(nodes_.try_push_back({slot, k.id, k.segment, k.stamp_ns, k.T_odom_camera, {}}));
  }
  std::sort(nodes_.begin(), nodes_.end(), [](const Node& a, const Node& b) { return a.id < b.id; });
  graph_.clear();
  for (const Node& node : nodes_) {
    const bool newest = &node == nodes_.end() - 1;
    graph_.add_node(node.T_odom_camera, newest);
  }
}

Pose LoopCorrection::as_they_stand(std::uint32_t a, std::uint32_t b) const {
  return inverse(nodes_[a].T_odom_camera) * nodes_[b].T_odom_camera;
}

void LoopCorrection::tie_successive() {
  constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::uint32_t last = kNone, last_of_other = kNone;
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    std::uint32_t& before = nodes_[i].segment == segment_ ? last : last_of_other;
    if (before != kNone) {
      const Pose T = as_they_stand(before, i);
      static_cast<void>(graph_.add_edge({before, i, T, odometry_information(T)}));
    }
    before = i;
  }
}

/// Successive keyframes are tied in any case; this adds those that see the same points.
void LoopCorrection::tie_by_points(const LocalMap& map) {
  std::fill(mark_of_point_.begin(), mark_of_point_.end(), kNoPoint);
  for (std::uint32_t a = 0; a < nodes_.size(); ++a) {
    const Keyframe& from = map.keyframes()[nodes_[a].slot];
    for (const KeyframeFeature& f : from.features) {
      if (f.point.slot >= 0) mark_of_point_[static_cast<std::size_t>(f.point.slot)] = f.point.id;
    }
    std::size_t ties = 0;
    for (std::uint32_t b = a; b-- > 0 && ties + 1 < kTiesPerKeyframe;) {
      const Keyframe& to = map.keyframes()[nodes_[b].slot];
      if (b + 1 == a || nodes_[b].segment != nodes_[a].segment) continue;
      int shared = 0;
      for (std::size_t i = 0; i < to.features.size(); i += kStride) {
        const PointRef p = to.features[i].point;
        shared += p.slot >= 0 && mark_of_point_[static_cast<std::size_t>(p.slot)] == p.id;
      }
      if (shared < kFewestShared) continue;
      static_cast<void>(graph_.add_edge({b, a, as_they_stand(b, a), shared_information()}));
      ++ties;
    }
    for (const KeyframeFeature& f : from.features) {
      if (f.point.slot >= 0) mark_of_point_[static_cast<std::size_t>(f.point.slot)] = kNoPoint;
    }
  }
}

void LoopCorrection::add_loop(const LoopEdge& loop) {
  const auto a = node_of(loop.keyframe_a), b = node_of(loop.keyframe_b);
  if (a && b) static_cast<void>(graph_.add_edge({*a, *b, loop.T_a_b, loop.information, true}));
}

bool LoopCorrection::prepare(const LocalMap& map, const LoopEdge& loop) {
  const Keyframe *a = map.find_keyframe(loop.keyframe_a), *b = map.find_keyframe(loop.keyframe_b);
  if (a == nullptr || b == nullptr) return false;
  segment_ = a->segment;
  other_ = b->segment;
  collect_nodes(map);
  // Loops first: they must find room.
  std::size_t kept = 0;
  for (const LoopEdge& known : loops_) {
    if (map.find_keyframe(known.keyframe_a) == nullptr || map.find_keyframe(known.keyframe_b) == nullptr)
      continue;
    add_loop(known);
    loops_[kept++] = known;
  }
  loops_.resize_down(kept);
  add_loop(loop);
  newest_loop_ = graph_.edges().size() - 1;
  if (loops_.full()) {
    std::move(loops_.begin() + 1, loops_.end(), loops_.begin());
    loops_.pop_back();
  }
  static_cast<void>(loops_.try_push_back(loop));
  tie_successive();
  tie_by_points(map);
  return true;
}

/// Each point goes with the newest keyframe that saw it, or else with the one that was new when it was made.
void LoopCorrection::move_points(LocalMap& map) {
  std::fill(mark_of_point_.begin(), mark_of_point_.end(), kNoMark);
  for (std::uint32_t n = 0; n < nodes_.size(); ++n) {
    const Keyframe& keyframe = map.keyframes()[nodes_[n].slot];
    if (keyframe.id != nodes_[n].id) continue;
    for (const KeyframeFeature& f : keyframe.features) {
      if (map.find(f.point) != nullptr) mark_of_point_[static_cast<std::size_t>(f.point.slot)] = n;
    }
  }
  for (std::size_t slot = 0; slot < map.points().size(); ++slot) {
    MapPoint& point = map.points()[slot];
    if (!point.alive || (point.segment != segment_ && point.segment != other_)) continue;
    std::uint32_t owner = mark_of_point_[slot];
    if (owner == kNoMark) {
      owner = 0;
      while (owner + 1 < nodes_.size() && nodes_[owner].stamp_ns < point.made_ns) ++owner;
    }
    move_point(point, nodes_[owner].T_moved_odom);
  }
}

std::optional<Pose> LoopCorrection::apply(LocalMap& map) {
  if (graph_.result().state == PoseGraphState::NothingToDo) return std::nullopt;
  if (graph_.edges()[newest_loop_].weight < PoseGraph::kRefusedBelow) {
    loops_.pop_back();
    return std::nullopt;
  }
  for (std::uint32_t n = 0; n < nodes_.size(); ++n) {
    Keyframe& keyframe = map.keyframes()[nodes_[n].slot];
    nodes_[n].T_moved_odom = graph_.pose(n) * inverse(nodes_[n].T_odom_camera);
    if (keyframe.id == nodes_[n].id) keyframe.T_odom_camera = nodes_[n].T_moved_odom * keyframe.T_odom_camera;
  }
  move_points(map);
  map.join_segments(segment_, other_);
  return inverse(nodes_[0].T_moved_odom);
}

}  // namespace stillmap
