// SPDX-License-Identifier: Apache-2.0
#include "runtime/record_lane.h"

#include <pthread.h>

#include <utility>

#include "runtime/capture.h"
#include "runtime/heap_count.h"

namespace stillmap {

RecordLane::RecordLane(Recorder& recorder, int capacity, RunCounters& counters)
    : recorder_(recorder),
      capacity_(static_cast<std::size_t>(capacity)),
      counters_(counters),
      thread_([this] { write_all(); }) {}

RecordLane::~RecordLane() {
  finish();
}

void RecordLane::offer(const FrameHandle& frame) {
  if (has_place()) {
    push(frame);
  } else {
    RunCounters::bump(counters_.record_left_out);
  }
}

void RecordLane::offer_patiently(const FrameHandle& frame) {
  for (;;) {
    const std::uint32_t ticket = place_waker_.ticket();
    if (has_place()) break;
    place_waker_.wait(ticket, kIdleWait);
  }
  push(frame);
}

void RecordLane::push(const FrameHandle& frame) {
  STILLMAP_CHECK(waiting_.try_push(frame.share()));
  work_waker_.wake();
}

void RecordLane::finish() {
  if (!thread_.joinable()) return;
  end_.store(true, std::memory_order_release);
  work_waker_.wake();
  thread_.join();
  recorder_.close();
}

void RecordLane::write_all() {
  pthread_setname_np(pthread_self(), "record");
  const HeapScope scope(HeapOwner::Capture);
  for (;;) {
    const std::uint32_t ticket = work_waker_.ticket();
    const bool ending = end_.load(std::memory_order_acquire);  // before looking: what was offered is written
    if (auto frame = waiting_.try_pop()) {
      const Nanoseconds cpu_begin = thread_cpu_now();
      RunCounters::bump(recorder_.write(**frame) ? counters_.recorded : counters_.record_failed);
      RunCounters::bump(counters_.record_cpu_ns, static_cast<std::uint64_t>(thread_cpu_now() - cpu_begin));
      frame->reset();
      place_waker_.wake();
    } else if (ending) {
      return;
    } else {
      work_waker_.wait(ticket, kIdleWait);
    }
  }
}

std::string recorded_profile(const LoadedConfig& loaded) {
  std::string text = "# The camera of this log, as it was set when it was recorded.\n";
  for (const ConfigEntry& entry : loaded.entries) {
    const bool of_camera = entry.key.starts_with("camera.") && !entry.key.starts_with("camera.depth.");
    if (of_camera && entry.value != "(unknown)") text += entry.key + " = " + entry.value + "\n";
  }
  return text;
}

}  // namespace stillmap
