// SPDX-License-Identifier: Apache-2.0
#include "runtime/capture.h"

#include <ctime>

#include "runtime/heap_count.h"

namespace stillmap {

Nanoseconds thread_cpu_now() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<Nanoseconds>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

void make_grey(ImageView<const Bgr> colour, ImageView<std::uint8_t> grey) {
  for (int y = 0; y < colour.height; ++y) {
    const Bgr* from = colour.row(y);
    std::uint8_t* to = grey.row(y);
    for (int x = 0; x < colour.width; ++x) {
      to[x] = static_cast<std::uint8_t>((from[x].b * 29 + from[x].g * 150 + from[x].r * 77 + 128) >> 8);
    }
  }
}

Capture::Outcome Capture::next(FrameHandle& out, Nanoseconds deadline_ns) {
  const HeapScope scope(HeapOwner::Capture);
  FrameHandle frame = frames_.acquire();
  if (!frame) {
    // A camera's frame is lost; a log's only waits until the stages have let go of one.
    if (!is_log_) {
      RunCounters::bump(counters_.offered);
      counters_.drop(DropReason::NoFreeSlot);
    }
    return Outcome::Nothing;
  }
  FrameSlot& slot = frame.writable();
  const Nanoseconds begin = monotonic_now(), cpu_begin = thread_cpu_now();
  const GrabResult grabbed = driver_.grab(slot, deadline_ns);
  switch (grabbed.status) {
    case GrabStatus::EndOfStream: return Outcome::End;
    case GrabStatus::Lost: return Outcome::Lost;
    case GrabStatus::Timeout: return Outcome::Nothing;
    case GrabStatus::Dropped:
      RunCounters::bump(counters_.offered);
      counters_.drop(grabbed.reason);
      ++next_sequence_;
      return Outcome::Nothing;
    case GrabStatus::Frame: break;
  }
  log_.decode_cpu_ns += thread_cpu_now() - cpu_begin;
  log_.decode_time.add(monotonic_now() - begin);
  RunCounters::bump(counters_.offered);
  slot.sequence = next_sequence_++;
  slot.due_ns = monotonic_now();
  make_grey(slot.colour, slot.grey);
  out = std::move(frame);
  return Outcome::Frame;
}

}  // namespace stillmap
