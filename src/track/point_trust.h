// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/feature.h"
#include "track/local_map.h"
#include "track/pose_solver.h"

namespace stillmap {

/// How much a match of `point` to a feature with this label says about the camera, from 0 (nothing: it is
/// only tested against the pose) to 1. Pure; any thread.
double trust_in(const MapPoint& point, Label label, Nanoseconds stamp_ns);

/// A frame with fewer than 100 observations of weight is starved: people cover the view, or it is new. Then
/// gives the others a little weight, but for those on features that move, and returns true. Observation i
/// belongs to feature `feature_of[i]`. Pure; any thread.
bool readmit_if_starved(std::span<PoseObservation> observations, std::span<const std::uint16_t> feature_of,
                        std::span<const Feature> features);

}  // namespace stillmap
