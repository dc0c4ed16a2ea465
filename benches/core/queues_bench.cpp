// SPDX-License-Identifier: Apache-2.0
// What a frame costs on its way between two threads: rings and latest values beside a locked queue.
#include <benchmark/benchmark.h>

#include <atomic>
#include <deque>
#include <mutex>
#include <thread>

#include "core/latest_value.h"
#include "core/spsc_ring.h"

namespace stillmap {
namespace {

struct Item {
  std::uint64_t number = 0;
  char payload[56]{};
};

/// The baseline: what one writes without thinking.
class LockedQueue {
 public:
  explicit LockedQueue(std::size_t most) : most_(most) {}
  bool try_push(Item&& item) {
    const std::lock_guard lock(mutex_);
    if (items_.size() == most_) return false;
    items_.push_back(item);
    return true;
  }
  std::optional<Item> try_pop() {
    const std::lock_guard lock(mutex_);
    if (items_.empty()) return std::nullopt;
    Item item = items_.front();
    items_.pop_front();
    return item;
  }

 private:
  std::mutex mutex_;
  std::deque<Item> items_;
  std::size_t most_;
};

/// Items a second through `queue` while another thread takes them out.
template <class Queue>
void pass_items(benchmark::State& state, Queue& queue) {
  std::atomic<bool> stop{false};
  std::thread consumer([&] {
    while (!stop.load(std::memory_order_relaxed)) {
      const auto item = queue.try_pop();
      benchmark::DoNotOptimize(item);
      if (!item) std::this_thread::yield();
    }
  });
  std::uint64_t number = 0;
  for (auto _ : state) {
    while (!queue.try_push(Item{++number})) std::this_thread::yield();
  }
  stop = true;
  consumer.join();
  state.SetItemsProcessed(state.iterations());
}

void ring(benchmark::State& state) {
  SpscRing<Item, 64> queue;
  pass_items(state, queue);
}
void ring_baseline_locked_queue(benchmark::State& state) {
  LockedQueue queue(64);
  pass_items(state, queue);
}
BENCHMARK(ring)->UseRealTime();
BENCHMARK(ring_baseline_locked_queue)->UseRealTime();

void latest_value(benchmark::State& state) {
  LatestValue<Item> value;
  std::atomic<bool> stop{false};
  std::thread reader([&] {
    while (!stop.load(std::memory_order_relaxed)) {
      if (value.refresh()) benchmark::DoNotOptimize(value.value().number);
    }
  });
  std::uint64_t number = 0;
  for (auto _ : state) benchmark::DoNotOptimize(value.publish(Item{++number}));
  stop = true;
  reader.join();
}
void latest_value_baseline_locked(benchmark::State& state) {
  std::mutex mutex;
  Item shared;
  std::atomic<bool> stop{false};
  std::thread reader([&] {
    while (!stop.load(std::memory_order_relaxed)) {
      const std::lock_guard lock(mutex);
      Item copy = shared;
      benchmark::DoNotOptimize(copy);
    }
  });
  std::uint64_t number = 0;
  for (auto _ : state) {
    const std::lock_guard lock(mutex);
    shared = Item{++number};
  }
  stop = true;
  reader.join();
}
BENCHMARK(latest_value)->UseRealTime();
BENCHMARK(latest_value_baseline_locked)->UseRealTime();

}  // namespace
}  // namespace stillmap
