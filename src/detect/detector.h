// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "core/config.h"
#include "core/detection.h"
#include "core/frame_pool.h"
#include "core/status.h"
#include "detect/model_file.h"

namespace stillmap {

/// A network that finds the objects of a colour picture. One thread at a time. After open() nothing here
/// takes heap memory but OpenCV, where a network runs on that: see open_network().
class Detector {
 public:
  /// Loads the network from the model's bytes, which are not needed afterwards, and proves it on one blank
  /// picture of the camera's size, which also warms it up. Errors: UnreadableInput where the file is no
  /// network that can be run, or not what `detector.decoder` reads; WrongConfig where the number of classes
  /// is not that of `classes.names`; RunFailed where there is no memory for it.
  static Result<std::unique_ptr<Detector>> open(const Config& config, const ModelFile& model);
  ~Detector();

  /// The objects of `frame.colour`, which has the camera's size (checked), with the frame's sequence number
  /// and colour stamp. False, with no objects, when a library failed.
  [[nodiscard]] bool run(const FrameSlot& frame, Detections& out);

  /// One line that names every configured class that the model does not know; empty where there is none.
  const std::string& class_warnings() const;

 private:
  struct Impl;
  explicit Detector(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace stillmap
