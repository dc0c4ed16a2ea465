// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/event.h"
#include "core/frame_pool.h"
#include "core/status.h"

namespace stillmap {

/// What a source delivers.
struct SourceInfo {
  std::string name;  ///< for people and the report, e.g. "tum:DIR"
  int width = 0, height = 0;
  double fps = 0;       ///< nominal; 0 = unknown
  bool is_log = false;  ///< recorded: it can be paced, and it ends
  bool monotonic_stamps =
      false;  ///< stamps are on the monotonic clock, at exposure: latency counts from them
};

enum class GrabStatus : std::uint8_t {
  Frame,        ///< the slot is filled
  Dropped,      ///< this frame cannot be used, `reason` says why; the next grab goes on with the next one
  Timeout,      ///< nothing arrived before the deadline
  EndOfStream,  ///< a log's end
  Lost          ///< the source is gone; reopen or give up
};

struct GrabResult {
  GrabStatus status = GrabStatus::Timeout;
  DropReason reason = DropReason::MissingFile;  ///< meaningful where status is Dropped
};

/// A source of RGB-D frames. Its life: open (may refuse), describe, start, grab again and again, stop. Used
/// by one thread. `grab` takes nothing from the heap: what it needs is made in `open`.
class RgbdDriver {
 public:
  virtual ~RgbdDriver() = default;
  virtual Status open() = 0;
  virtual SourceInfo describe() const = 0;
  virtual Status start() = 0;
  /// Fills colour, depth and both stamps of `slot` (not the sequence number). `deadline_ns` is on
  /// the monotonic clock; a log ignores it. The slot's views fix the size: another size is Dropped with
  /// WrongSize.
  virtual GrabResult grab(FrameSlot& slot, Nanoseconds deadline_ns) = 0;
  virtual void stop() = 0;
};

}  // namespace stillmap
