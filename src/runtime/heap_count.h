// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace stillmap {

/// Whose work a thread does right now, as the report names it. `None` is start, shutdown, and the main
/// thread. A thread that never says is not ours: `Driver`, as those of a camera's library are.
enum class HeapOwner : std::uint8_t { None, Capture, Track, Map, Stream, Detect, Driver };
constexpr std::size_t kHeapOwners = 7;

/// Counts what this thread takes from the heap as `owner`'s while it lives. malloc and its kin are interposed
/// in the stillmap program; in a program that does not link the interposer, or under a sanitizer, every count
/// stays 0.
class HeapScope {
 public:
  explicit HeapScope(HeapOwner owner);
  ~HeapScope();
  HeapScope(const HeapScope&) = delete;
  HeapScope& operator=(const HeapScope&) = delete;

 private:
  HeapOwner before_;
};

/// Starts counting (from the first pose on: what start-up takes is not the frame's way).
void start_heap_count();
/// Allocations so far, by owner.
std::array<std::uint64_t, kHeapOwners> heap_counts();
/// For the interposer.
void note_heap_allocation() noexcept;

}  // namespace stillmap
