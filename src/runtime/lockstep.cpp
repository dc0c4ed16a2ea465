// SPDX-License-Identifier: Apache-2.0
#include <utility>
#include <vector>

#include "runtime/health.h"
#include "runtime/heap_count.h"
#include "runtime/run_context.h"

namespace stillmap {

namespace {

/// The detector's words that are still on their way: `delay` frames long, in the order they will arrive.
class DelayedDetections {
 public:
  explicit DelayedDetections(int delay) : queue_(static_cast<std::size_t>(delay) + 1) {}
  struct Item {
    std::uint64_t due_frame = 0;
    DetectedFrame detected;
  };
  /// Where the next item is made; it counts from `add` on.
  Item& next() { return queue_[(first_ + count_) % queue_.size()]; }
  void add() { ++count_; }
  Item* due(std::uint64_t frame) {
    return count_ > 0 && queue_[first_].due_frame <= frame ? &queue_[first_] : nullptr;
  }
  void pop() {
    queue_[first_].detected.frame.reset();
    first_ = (first_ + 1) % queue_.size();
    --count_;
  }

 private:
  std::vector<Item> queue_;  // made at start
  std::size_t first_ = 0, count_ = 0;
};

}  // namespace

void run_lockstep(RunContext& context) {
  Capture capture = context.capture();
  Health health(context);
  const DetectorTiming& timing = context.options.detector;
  DelayedDetections delayed(timing.delay);
  constexpr std::uint64_t kNever = ~std::uint64_t{0};
  std::uint64_t adjust_at = kNever;
  health.ready();
  for (std::uint64_t n = 0; !context.stop.load(std::memory_order_relaxed);) {
    health.tick();
    FrameHandle frame;
    const Capture::Outcome outcome = capture.next(frame, monotonic_now() + 100'000'000);
    if (outcome == Capture::Outcome::Nothing) continue;
    if (outcome != Capture::Outcome::Frame) {
      context.source_lost = outcome == Capture::Outcome::Lost;
      break;
    }
    if (context.record != nullptr) context.record->offer_patiently(frame);
    if (context.detector != nullptr && n % static_cast<std::uint64_t>(timing.every) == 0) {
      DelayedDetections::Item& item = delayed.next();
      item.due_frame = n + static_cast<std::uint64_t>(timing.delay);
      item.detected.frame = frame.share();
      if (detect_frame(context, *frame, item.detected.boxes)) {
        offer_picture(context, *frame, item.detected.boxes);
        delayed.add();
      } else {
        item.detected.frame.reset();
      }
    }
    if (auto* item = delayed.due(n)) context.stages.track.take_boxes(item->detected.boxes);
    const bool for_map = track_frame(context, *frame);
    if (context.stages.track.work_waits() && adjust_at == kNever)
      adjust_at = n + static_cast<std::uint64_t>(context.options.adjust_delay);
    if (n >= adjust_at) {
      adjust_map(context);
      adjust_at = kNever;
    }
    if (context.detector == nullptr) offer_picture(context, *frame, {});

    const HeapScope scope(HeapOwner::Map);
    if (for_map) {
      PosedFrame posed;
      context.stages.track.fill_posed(frame, posed);
      context.stages.map.take_frame(std::move(posed));
    }
    if (auto* item = delayed.due(n)) {
      // Its own boxes came with the frame where nothing is late.
      if (item->detected.frame->sequence != frame->sequence)
        context.stages.map.take_detected(std::move(item->detected));
      delayed.pop();
    }
    context.stages.map.serve_checkpoint();
    context.counters.blocks.note(context.stages.map.map().usage());
    answer_map_requests(context);
    if (context.stages.stream) {
      const HeapScope stream_scope(HeapOwner::Stream);
      context.stages.stream->service(0);
    }
    ++n;
  }
  health.stopping();
  health.finish();
}

}  // namespace stillmap
