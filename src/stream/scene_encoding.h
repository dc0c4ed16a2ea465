// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "core/camera.h"
#include "stream/preview_size.h"
#include "stream/stream_types.h"

// What is seen on a frame to Foxglove's messages. Pure functions; any thread; no heap. Each returns the bytes
// written.
namespace stillmap::stream {

constexpr std::size_t kMaxObjectsBytes = 48'000, kMaxAnnotationsBytes = 48'800, kMaxCalibrationBytes = 512,
                      kMaxPictureEnvelopeBytes = 64;

/// foxglove.SceneUpdate: for each object with a known depth an entity "object N" that lives for half a second
/// unless it is sent again: a box with the axes of the camera, its class as text, an arrow where it goes in
/// the next second if it is one that moves, and class, kind, speed and age as metadata.
std::size_t encode_objects(const StreamScene& scene, std::span<const std::string> class_names,
                           const CameraModel& camera, std::span<std::uint8_t, kMaxObjectsBytes> out);

/// foxglove.ImageAnnotations on the preview: boxes with class and score, features by label (static green,
/// dynamic red, semi-static amber, unknown grey).
std::size_t encode_annotations(const StreamScene& scene, std::span<const std::string> class_names,
                               const PreviewSize& size, std::span<std::uint8_t, kMaxAnnotationsBytes> out);

/// foxglove.CameraCalibration of the preview.
std::size_t encode_calibration(const CameraModel& camera, Nanoseconds stamp_ns,
                               std::span<std::uint8_t, kMaxCalibrationBytes> out);

/// foxglove.CompressedImage with this JPEG; 0 when it does not fit.
std::size_t encode_picture(std::span<const std::uint8_t> jpeg, Nanoseconds stamp_ns,
                           std::span<std::uint8_t> out);

}  // namespace stillmap::stream
