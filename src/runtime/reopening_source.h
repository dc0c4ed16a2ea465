// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <string>

#include "core/event.h"
#include "core/latest_value.h"
#include "drivers/rgbd_driver.h"
#include "runtime/waker.h"

namespace stillmap {

/// What happens to a camera, told on capture's thread.
struct SourceNews {
  using Words = std::array<char, 256>;  ///< end with a 0
  EventRing events;
  LatestValue<Words> refusal;  ///< why the newest SourceRefused was
};

/// A camera that is opened anew when it goes away or falls silent, at growing intervals up to two seconds.
/// While it is away a grab is a Timeout; after `give_up_s` without a picture, Lost. Tells of each change as
/// an event, and of each new reason why it cannot be opened. Used by the capture thread.
class ReopeningSource : public RgbdDriver {
 public:
  using Factory = std::function<std::unique_ptr<RgbdDriver>()>;
  struct Patience {
    double stall_s = 2, give_up_s = 30;
  };
  ReopeningSource(Factory make, Patience patience, SourceNews& news);

  Status open() override;
  SourceInfo describe() const override { return info_; }
  Status start() override;
  GrabResult grab(FrameSlot& slot, Nanoseconds deadline_ns) override;
  void stop() override;

 private:
  GrabResult lose(EventCode code);
  GrabResult wait_for_return(Nanoseconds deadline_ns);
  Status reopen();
  void tell(EventCode code, std::int64_t a);
  GrabResult try_later(const std::string& why);

  Factory make_;
  Patience patience_;
  SourceNews& news_;
  SourceInfo info_;                     // as the first opening found it
  std::unique_ptr<RgbdDriver> camera_;  // null while it is away
  Nanoseconds alive_ns_ = 0;            // when it last delivered, or was opened
  Nanoseconds delivered_ns_ = 0;        // when it last delivered, or was first started
  Nanoseconds next_try_ns_ = 0, pause_ns_ = 0;
  int tries_ = 0;             // to open it anew, since it last delivered
  std::string refusal_told_;  // since it went away
  Waker never_woken_;
};

}  // namespace stillmap
