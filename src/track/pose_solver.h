// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "core/camera.h"
#include "core/geometry.h"
#include "core/random.h"

namespace stillmap {

/// One feature matched to one map point.
struct PoseObservation {
  Vec3 p_world;                 ///< the map point
  double ray_x = 0, ray_y = 0;  ///< where the feature is, on the undistorted normalised plane
  double sigma_px = 1;          ///< its localisation error, 1 sigma, at full resolution
  double depth_m = 0;           ///< its measured depth, 0 = none
  double sigma_depth_m = 0;     ///< 1 sigma of depth_m together with the map point's own
  double weight = 1;            ///< of its information; 0: only tested against the result
  bool inlier = true;           ///< out: whether it fits
};

/// What is believed of the pose before looking: from a motion model, wheel odometry or an IMU.
struct PosePrior {
  Pose T_camera_world;
  double sigma_rotation_rad = 0, sigma_translation_m = 0;  ///< 1 sigma per axis
};

struct PoseEstimate {
  Pose T_camera_world;
  int observed = 0;   ///< observations of weight
  int inliers = 0;    ///< of them
  double rms_px = 0;  ///< reprojection error of the inliers
  /// Of the left perturbation (rotation in rad, translation in m) in the camera frame, row-major.
  std::array<double, 36> covariance{};
  bool converged = false;  ///< false: too few or degenerate observations, T_camera_world is the initial one
};

/// The pose that minimises reprojection error and depth error together, by iteratively reweighted
/// Gauss-Newton (Huber) in rounds, observations beyond the 95 % quantile of chi-square left out from round to
/// round. Residual of an observation: (u, v) in units of sigma_px and, where there is depth, z in units of
/// sigma_depth_m. With a prior, its deviation counts too, and three observations are enough. No heap; any
/// thread.
PoseEstimate solve_pose(std::span<PoseObservation> observations, const CameraModel& camera,
                        const Pose& T_camera_world_initial, const PosePrior* prior = nullptr);

/// What `solve_pose` gives; where too little of the weight comes near that, what samples of three find
/// (`rigid_consensus`), if more fits it. Descent from a pose too far off ends where a few agree by chance. No
/// heap; any thread.
PoseEstimate solve_pose_among_outliers(std::span<PoseObservation> observations, const CameraModel& camera,
                                       const Pose& T_camera_world_initial, const PosePrior* prior,
                                       Random random);

}  // namespace stillmap
