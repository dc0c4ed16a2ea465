// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "drivers/rgbd_driver.h"

namespace stillmap {

/// A recorded log in the TUM RGB-D benchmark's layout: rgb.txt and depth.txt, or associations.txt; PNG or
/// JPEG colour, 16-bit PNG depth. Frames come in the order of the lists, each with both stamps as written
/// there, exact to the nanosecond. A frame that cannot be used is Dropped with its reason and the log goes
/// on: NoDepthMatch and TimeJump as the lists show, MissingFile, WrongSize, CorruptColour, CorruptDepth as
/// the files show. Played several times, it goes forwards and backwards in turn, as a camera that goes back
/// the way it came: stamps go on rising, in steps of the log's own length and one median interval.
///
/// `open` reads the lists, looks at every file's size and at the first pictures' width and height; its error
/// (UnreadableInput, or WrongConfig where the camera profile is another camera's) names the folder and the
/// mend. `start` goes back to the first frame. One thread; `grab` takes nothing from the heap.
class TumLog : public RgbdDriver {
 public:
  /// The size is what the camera profile says. Where the first pictures have another, `open` refuses; later
  /// ones are dropped.
  TumLog(std::string folder, int width, int height, int loops = 1);
  ~TumLog() override;

  Status open() override;
  SourceInfo describe() const override;
  Status start() override;
  GrabResult grab(FrameSlot& slot, Nanoseconds deadline_ns) override;
  void stop() override {}

  /// The colour stamps of all offered frames of the first pass, usable or not, in order. Valid after `open`.
  std::span<const Nanoseconds> colour_stamps() const { return colour_stamps_; }

 private:
  struct Reader;
  Status check_size();
  Nanoseconds median_interval() const;
  std::string folder_;
  int width_, height_, loops_;
  std::vector<Nanoseconds> colour_stamps_;
  std::unique_ptr<Reader> reader_;  // made by open
  std::size_t next_ = 0;
};

}  // namespace stillmap
