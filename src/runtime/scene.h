// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/dynamic_mask.h"
#include "core/feature.h"
#include "core/tracking_result.h"
#include "stream/stream_types.h"

namespace stillmap {

/// What the tracker saw on one frame, for the stream: the boxes that the mask was made from with the depth
/// that the mask gives them, and the features with their final labels. No heap.
void make_scene(const TrackingResult& result, const DynamicMask& mask, std::span<const Feature> features,
                StreamScene& out);

}  // namespace stillmap
