// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>

#include "core/event.h"
#include "drivers/rgbd_driver.h"
#include "runtime/waker.h"

namespace stillmap {

/// A camera that is opened anew when it goes away or falls silent, at growing intervals up to two seconds.
/// While it is away a grab is a Timeout; after `give_up_s` without it, Lost. Tells of each change as an
/// event. Used by the capture thread.
class ReopeningSource : public RgbdDriver {
 public:
  using Factory = std::function<std::unique_ptr<RgbdDriver>()>;
  struct Patience {
    double stall_s = 2, give_up_s = 30;
  };
  ReopeningSource(Factory make, Patience patience, EventRing& events);

  Status open() override;
  SourceInfo describe() const override { return info_; }
  Status start() override;
  GrabResult grab(FrameSlot& slot, Nanoseconds deadline_ns) override;
  void stop() override;

 private:
  void lose(EventCode code);
  GrabResult wait_for_return(Nanoseconds deadline_ns);
  bool reopen();
  void tell(EventCode code, std::int64_t a);

  Factory make_;
  Patience patience_;
  EventRing& events_;
  SourceInfo info_;                     // as the first opening found it
  std::unique_ptr<RgbdDriver> camera_;  // null while it is away
  Nanoseconds alive_ns_ = 0;            // when it last delivered, or was started
  Nanoseconds next_try_ns_ = 0, pause_ns_ = 0;
  int tries_ = 0;
  Waker never_woken_;
};

}  // namespace stillmap
