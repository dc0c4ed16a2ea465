// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include "core/time.h"
#include "drivers/rgbd_driver.h"

namespace stillmap::test {

/// A source that does what a test wrote down: a list of grabs, each with its result, its stamp and the time
/// it takes.
class ScriptedDriver : public RgbdDriver {
 public:
  struct Grab {
    GrabStatus status = GrabStatus::Frame;
    Nanoseconds stamp_ns = 0;
    int picture = 0;  ///< passed to `fill`
    DropReason reason = DropReason::CorruptColour;
    Nanoseconds takes_ns = 0;  ///< of wall time, at most until the deadline
  };
  using Fill = std::function<void(int picture, FrameSlot& slot)>;

  ScriptedDriver(
      SourceInfo info, std::vector<Grab> grabs, Fill fill = [](int, FrameSlot&) {})
      : info_(std::move(info)), grabs_(std::move(grabs)), fill_(std::move(fill)) {}

  Status open() override { return {}; }
  SourceInfo describe() const override { return info_; }
  Status start() override { return {}; }
  GrabResult grab(FrameSlot& slot, Nanoseconds deadline_ns) override {
    if (next_ == grabs_.size()) return {GrabStatus::EndOfStream};
    const Grab& g = grabs_[next_++];
    const Nanoseconds until = monotonic_now() + g.takes_ns;
    if (g.takes_ns > 0) {
      std::this_thread::sleep_for(std::chrono::nanoseconds(std::min(until, deadline_ns) - monotonic_now()));
    }
    if (g.status != GrabStatus::Frame) return {g.status, g.reason};
    fill_(g.picture, slot);
    slot.colour_ns = slot.depth_ns = g.stamp_ns;
    return {GrabStatus::Frame};
  }
  void stop() override {}
  std::size_t grabbed() const { return next_; }

 private:
  SourceInfo info_;
  std::vector<Grab> grabs_;
  Fill fill_;
  std::size_t next_ = 0;
};

}  // namespace stillmap::test
