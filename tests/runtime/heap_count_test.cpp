// SPDX-License-Identifier: Apache-2.0
// Links the interposer, as the program does.
#include "runtime/heap_count.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <thread>
#include <vector>

namespace stillmap {
namespace {

#ifdef STILLMAP_SANITIZED
constexpr bool kInterposed = false;
#else
constexpr bool kInterposed = true;
#endif

std::uint64_t count_of(HeapOwner owner) {
  return heap_counts()[static_cast<std::size_t>(owner)];
}

/// Keeps the compiler from leaving the allocation out.
void* volatile g_seen = nullptr;
void use(void* memory) {
  g_seen = memory;
}

class HeapCount : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!kInterposed) GTEST_SKIP() << "sanitizers bring their own malloc";
  }
};

TEST_F(HeapCount, CountsNothingBeforeTheStart) {
  const HeapScope scope(HeapOwner::Capture);
  use(std::make_unique<int>(1).get());
  EXPECT_EQ(count_of(HeapOwner::Capture), 0u);  // each test is a process of its own under ctest
  start_heap_count();
  use(std::make_unique<int>(1).get());
  EXPECT_EQ(count_of(HeapOwner::Capture), 1u);
}

TEST_F(HeapCount, CountsEveryWayToTakeMemory) {
  start_heap_count();
  const HeapScope scope(HeapOwner::Track);
  const std::uint64_t before = count_of(HeapOwner::Track);
  void* memory = std::malloc(10);
  use(memory);
  memory = std::realloc(memory, 5000);
  use(memory);
  std::free(memory);
  use(memory = std::calloc(3, 3));
  std::free(memory);
  use(memory = std::aligned_alloc(64, 64));
  std::free(memory);
  ASSERT_EQ(posix_memalign(&memory, 64, 10), 0);
  std::free(memory);
  use(std::make_unique<double>(1).get());
  use(std::vector<char>(100).data());
  EXPECT_EQ(count_of(HeapOwner::Track) - before, 7u);
}

TEST_F(HeapCount, InnerScopesOwnAndTheOuterComesBack) {
  start_heap_count();
  const auto before = heap_counts();
  {
    const HeapScope outer(HeapOwner::Map);
    use(std::make_unique<int>(1).get());
    {
      const HeapScope inner(HeapOwner::Stream);
      use(std::make_unique<int>(1).get());
      use(std::make_unique<int>(1).get());
    }
    use(std::make_unique<int>(1).get());
  }
  use(std::make_unique<int>(1).get());
  EXPECT_EQ(count_of(HeapOwner::Map) - before[static_cast<std::size_t>(HeapOwner::Map)], 2u);
  EXPECT_EQ(count_of(HeapOwner::Stream) - before[static_cast<std::size_t>(HeapOwner::Stream)], 2u);
}

TEST_F(HeapCount, AnotherThreadsWorkIsNotMine) {
  start_heap_count();
  const HeapScope scope(HeapOwner::Detect);
  std::thread other;
  other = std::thread([] {
    for (int i = 0; i < 1000; ++i) use(std::make_unique<int>(i).get());
  });
  other.join();
  EXPECT_LT(count_of(HeapOwner::Detect), 100u);  // starting a thread takes a few
  EXPECT_GE(count_of(HeapOwner::Driver), 1000u) << "of whom nothing is known";
}

}  // namespace
}  // namespace stillmap
