// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "core/frame_pool.h"
#include "core/status.h"

namespace stillmap {

/// Writes frames as a log in the TUM RGB-D benchmark's layout, which TumLog plays: depth as exact PNG, colour
/// as JPEG or exact PNG, stamps to the nanosecond. A list names a picture only after the picture's file is
/// complete, so that whatever ends the process leaves a log that plays.
///
/// All memory of the encoders is taken by `open`; a frame takes nothing from the heap. One thread.
class Recorder {
 public:
  struct Setup {
    std::string folder;  ///< made where it is missing; a log that is there already is refused
    int width = 0, height = 0;
    bool exact_colour = false;
    int jpeg_quality = 95;
    std::string camera_profile;  ///< text of a configuration file that fits the log, kept beside it
  };
  explicit Recorder(Setup setup);
  ~Recorder();

  /// The error (RunFailed) names the folder and the mend.
  Status open();
  /// False where a file could not be written: the frame is not in the lists, and the next may fare better.
  [[nodiscard]] bool write(const FrameSlot& frame);
  /// Brings the lists to the disk. Writing is over.
  void close();

 private:
  struct Writer;
  Setup setup_;
  std::unique_ptr<Writer> writer_;  // made by open
};

}  // namespace stillmap
