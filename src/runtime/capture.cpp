// SPDX-License-Identifier: Apache-2.0
#include "runtime/capture.h"

#include <algorithm>
#include <ctime>

#include "runtime/heap_count.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kUnit_ns = Nanoseconds{1} << 60;  // 36 years; seven of them do not overflow

}  // namespace

Nanoseconds thread_cpu_now() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<Nanoseconds>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

Capture::Outcome Capture::next(FrameHandle& out, Nanoseconds deadline_ns) {
  const HeapScope scope(HeapOwner::Capture);
  if (!spare_) spare_ = frames_.acquire();
  if (!spare_) return Outcome::Nothing;
  if (const Outcome outcome = fill_spare(deadline_ns); outcome != Outcome::Frame) return outcome;
  RunCounters::bump(counters_.offered);
  FrameHandle next_spare;
  if (!is_log_ && !(next_spare = frames_.acquire())) {
    counters_.drop(DropReason::NoFreeSlot);
    return Outcome::Nothing;
  }
  out = std::move(spare_);
  spare_ = std::move(next_spare);
  return Outcome::Frame;
}

void Capture::drop(DropReason reason) {
  RunCounters::bump(counters_.offered);
  counters_.drop(reason);
  ++next_sequence_;
}

Capture::Outcome Capture::fill_spare(Nanoseconds deadline_ns) {
  FrameSlot& slot = spare_.writable();
  const Nanoseconds begin = monotonic_now(), cpu_begin = thread_cpu_now();
  const GrabResult grabbed = driver_.grab(slot, deadline_ns);
  switch (grabbed.status) {
    case GrabStatus::EndOfStream:
      return Outcome::End;
    case GrabStatus::Lost:
      return Outcome::Lost;
    case GrabStatus::Timeout:
      return Outcome::Nothing;
    case GrabStatus::Dropped:
      drop(grabbed.reason);
      return Outcome::Nothing;
    case GrabStatus::Frame:
      break;
  }
  log_.decode_cpu_ns += thread_cpu_now() - cpu_begin;
  log_.decode_time.add(monotonic_now() - begin);
  if (!mend_clock(slot)) {
    drop(DropReason::TimeJump);
    return Outcome::Nothing;
  }
  if (!is_log_ && first_stamp_ns_) tell_jump(slot);
  if (!first_stamp_ns_) first_stamp_ns_ = slot.colour_ns;
  newest_stamp_ns_ = slot.colour_ns;
  newest_arrival_ns_ = monotonic_now();
  if (duration_s_ > 0 && to_seconds(slot.colour_ns - *first_stamp_ns_) > duration_s_) return Outcome::End;
  slot.sequence = next_sequence_++;
  slot.due_ns = monotonic_now();
  if (stamps_are_monotonic_) {
    log_.stamp_to_slot.add(slot.due_ns - slot.colour_ns);
    slot.due_ns = std::min(slot.due_ns, slot.colour_ns);
  }
  check_depth(slot);
  return Outcome::Frame;
}

/// Moves the stamps as the source's clock has jumped. False: the frame is from before the newest, or is it.
bool Capture::mend_clock(FrameSlot& slot) {
  const auto is_sane = [](Nanoseconds t) { return t > -kUnit_ns && t < 3 * kUnit_ns; };
  if (!is_sane(slot.colour_ns) || !is_sane(slot.depth_ns) ||
      slot.colour_ns + clock_offset_ns_ > 3 * kUnit_ns + kUnit_ns / 2)
    return false;
  slot.colour_ns += clock_offset_ns_;
  slot.depth_ns += clock_offset_ns_;
  if (slot.colour_ns > newest_stamp_ns_) {
    early_ = 0;
    return true;
  }
  const Nanoseconds step_ns = slot.colour_ns - last_early_ns_;
  early_ = early_ == 0 || step_ns <= 0 ? 1 : early_ + 1;
  last_early_ns_ = slot.colour_ns;
  if (is_log_ || early_ <= kFramesToBelieve) return false;
  const Nanoseconds back_ns = newest_stamp_ns_ + step_ns - slot.colour_ns;
  tell(EventCode::SourceTimeJump, -back_ns / 1'000'000);
  clock_offset_ns_ += back_ns;
  slot.colour_ns += back_ns;
  slot.depth_ns += back_ns;
  early_ = 0;
  return true;
}

/// A camera's clock that was put on, as the machine's own shows beside it.
void Capture::tell_jump(const FrameSlot& slot) {
  constexpr Nanoseconds kJump_ns = 1'000'000'000;
  const Nanoseconds on_ns = (slot.colour_ns - newest_stamp_ns_) - (monotonic_now() - newest_arrival_ns_);
  if (on_ns > kJump_ns) tell(EventCode::SourceTimeJump, on_ns / 1'000'000);
}

void Capture::check_depth(const FrameSlot& slot) {
  const DepthCheck::Verdict verdict = depth_check_.look(slot);
  if (verdict.fault == DepthFault::None || verdict.fault == depth_fault_told_) return;
  depth_fault_told_ = verdict.fault;
  EventCode code = EventCode::DepthEmpty;
  if (verdict.fault == DepthFault::Scale) code = EventCode::DepthScale;
  if (verdict.fault == DepthFault::Unregistered) code = EventCode::DepthUnregistered;
  tell(code, verdict.amount);
}

/// Of the newest frame.
void Capture::tell(EventCode code, std::int64_t a) {
  static_cast<void>(events_.try_push({monotonic_now(), Stage::Capture, code, next_sequence_ - 1, a}));
}

}  // namespace stillmap
