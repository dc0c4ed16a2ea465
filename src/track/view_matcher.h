// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/random.h"
#include "track/local_map.h"
#include "track/pose_solver.h"

namespace stillmap {

/// Where keyframe b was, as seen from keyframe a, and what speaks for it.
struct ViewMatch {
  Pose T_a_b;
  /// Of T_a_b's left perturbation (rotation in rad, translation in m, in a's frame), row-major.
  std::array<double, 36> information{};
  int pairs = 0;            ///< features that are each other's best match
  int agreeing_pairs = 0;   ///< of those, how many one rigid motion explains
  int inliers = 0;          ///< features of a that are where b's features project to, and look alike
  int in_view = 0;          ///< features of b that project into a's picture
  int depths = 0;           ///< of those, how many fall where a has a depth
  int agreeing_depths = 0;  ///< and how many have that depth
  double spread = 0;        ///< of the inliers in a's picture: 1 sigma along the narrower axis, of its width
  double sigma_m = 0, sigma_rad = 0;  ///< 1 sigma of T_a_b along its worst axis

  /// Whether geometry alone speaks for it: enough inliers in number and spread, an accurate pose, and a depth
  /// picture that agrees.
  bool is_convincing() const;
};

/// Looks for the motion between two keyframes that may see the same place, with nothing known of it. It uses
/// what the keyframes measured themselves, so neither drift nor the map's forgetting matters: descriptors are
/// compared with all of about their size, three-point absolute orientation in RANSAC, then matching around
/// the motion found and a robust solve. Used by one thread; no heap after construction.
class ViewMatcher {
 public:
  ViewMatcher(Arena& arena, const Config::Track& config, const CameraModel& camera);

  /// The motion that the descriptors speak for, if any; whether to believe it is the caller's choice.
  std::optional<ViewMatch> match(const Keyframe& a, const Keyframe& b, Random random);

 private:
  struct Best {
    std::int16_t distance = 257, second = 257;
    std::int16_t other = -1;
  };
  struct Pair {
    Vec3 p_a, p_b;
    std::uint8_t octave = 0;  // in a
  };
  void compare(const Keyframe& a, const Keyframe& b);
  void collect_pairs(const Keyframe& a, const Keyframe& b);
  int count_agreeing(const Pose& T_a_b) const;
  std::optional<Pose> sample_motion(Random& random) const;
  bool agrees(const Pair& pair, const Pose& T_a_b) const;
  void observe_pairs(const Pose& T_a_b);
  void sort_by_x(const Keyframe& keyframe);
  template <class F>
  void for_each_near(const Keyframe& keyframe, double x, double radius, F fn) const;
  void match_around(const Pose& T_a_b, const Keyframe& a, const Keyframe& b, double radius_px);
  void count_depths(const Keyframe& a, const Keyframe& b, ViewMatch& out) const;
  void weigh(const PoseEstimate& estimate, const Keyframe& a, const Keyframe& b, ViewMatch& out) const;
  double scale(int octave) const { return scales_[static_cast<std::size_t>(octave)]; }
  double depth_sigma_m(double z_m) const;

  CameraModel camera_;
  int levels_;
  std::array<double, 256> scales_{};
  std::span<Best> best_of_a_, best_of_b_;
  ArenaVector<Pair> pairs_;
  ArenaVector<std::uint16_t> order_;  // of a keyframe's features, as the step at work needs them
  std::span<Descriptor> in_order_;  // its descriptors in that order, as they are compared one after the other
  ArenaVector<PoseObservation> observations_;
};

}  // namespace stillmap
