// SPDX-License-Identifier: Apache-2.0
#include "runtime/heap_count.h"

#include <atomic>

namespace stillmap {

namespace {

constinit thread_local HeapOwner current_owner = HeapOwner::Driver;
constinit std::atomic<bool> counting{false};
constinit std::array<std::atomic<std::uint64_t>, kHeapOwners> counts{};

}  // namespace

HeapScope::HeapScope(HeapOwner owner) : before_(current_owner) {
  current_owner = owner;
}
HeapScope::~HeapScope() {
  current_owner = before_;
}

void start_heap_count() {
  counting.store(true, std::memory_order_relaxed);
}

std::array<std::uint64_t, kHeapOwners> heap_counts() {
  std::array<std::uint64_t, kHeapOwners> out{};
  for (std::size_t i = 0; i < kHeapOwners; ++i) out[i] = counts[i].load(std::memory_order_relaxed);
  return out;
}

void note_heap_allocation() noexcept {
  if (!counting.load(std::memory_order_relaxed)) return;
  counts[static_cast<std::size_t>(current_owner)].fetch_add(1, std::memory_order_relaxed);
}

}  // namespace stillmap
