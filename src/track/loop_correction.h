// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "core/arena.h"
#include "track/local_map.h"
#include "track/loop_closer.h"
#include "track/pose_graph.h"

namespace stillmap {

/// Mends the local map after a loop: keyframes' poses by a pose graph, and each point with a keyframe that
/// saw it. The newest keyframe stays where it is, so that odom does not jump; what moves is the past, and
/// with it map -> odom. No heap after construction.
class LoopCorrection {
 public:
  LoopCorrection(Arena& arena, std::size_t keyframes, std::size_t points);

  /// Takes over where the keyframes of the loop's segments stand, and one more loop. Keyframes that share
  /// points, and successive ones of a segment, hold together as they stand now. False where an end is no
  /// longer in the map.
  bool prepare(const LocalMap& map, const LoopEdge& loop);
  /// Some milliseconds; may be another thread's, and the map may go on meanwhile.
  void solve() { graph_.solve(); }
  /// Takes the solution into the map, where the loop's segments are one then. What map -> odom is to be
  /// multiplied by from the right, so that the oldest keyframe stays where it is in the map's frame; nothing,
  /// with the map as it was, where the loop did not fit the rest.
  std::optional<Pose> apply(LocalMap& map);
  const PoseGraphResult& result() const { return graph_.result(); }

 private:
  /// A keyframe in the graph; its place in `nodes_` is its node's number.
  struct Node {
    std::size_t slot = 0;
    std::uint32_t id = 0;
    std::uint32_t segment = 0;
    Nanoseconds stamp_ns = 0;
    Pose T_odom_camera;  // when the correction began
    Pose T_moved_odom;   // takes what stood with it to where that belongs
  };
  std::optional<std::uint32_t> node_of(std::uint32_t keyframe_id) const;
  void collect_nodes(const LocalMap& map);
  Pose as_they_stand(std::uint32_t a, std::uint32_t b) const;
  void tie_by_points(const LocalMap& map);
  void tie_successive();
  void add_loop(const LoopEdge& loop);
  void move_points(LocalMap& map);

  PoseGraph graph_;
  ArenaVector<Node> nodes_;                 // by id
  ArenaVector<LoopEdge> loops_;             // with both ends in the map, of any segment
  std::size_t newest_loop_ = 0;             // its edge in the graph
  std::uint32_t segment_ = 0, other_ = 0;   // that the newest loop ties, or twice the same
  std::span<std::uint32_t> mark_of_point_;  // by slot
};

}  // namespace stillmap
