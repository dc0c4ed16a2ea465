// SPDX-License-Identifier: Apache-2.0
#include "runtime/threads.h"

#include <gmock/gmock.h>
#include <sched.h>
#include <sys/resource.h>

#include <atomic>

namespace stillmap {
namespace {

using ::testing::HasSubstr;

/// What a thread sees of itself.
struct Seen {
  std::string name;
  int cores = 0, niceness = 0, policy = 0;
  std::size_t stack_bytes = 0;
};

Seen run(ThreadRole role, const Config::Threads& config, bool prefault = true) {
  Seen seen;
  StageThread thread;
  thread.start(role, config, prefault, [&] {
    char name[16];
    pthread_getname_np(pthread_self(), name, sizeof(name));
    seen.name = name;
    cpu_set_t cores;
    sched_getaffinity(0, sizeof(cores), &cores);
    seen.cores = CPU_COUNT(&cores);
    seen.niceness = getpriority(PRIO_PROCESS, 0);
    seen.policy = sched_getscheduler(0);
    pthread_attr_t attributes;
    pthread_getattr_np(pthread_self(), &attributes);
    pthread_attr_getstacksize(&attributes, &seen.stack_bytes);
    pthread_attr_destroy(&attributes);
  });
  thread.join();
  return seen;
}

int cores_of_this_process() {
  cpu_set_t cores;
  sched_getaffinity(0, sizeof(cores), &cores);
  return CPU_COUNT(&cores);
}

TEST(StageThread, HasNameCoreNicenessAndStack) {
  const int own = getpriority(PRIO_PROCESS, 0);
  for (const auto role : {ThreadRole::Decode, ThreadRole::Capture, ThreadRole::Track, ThreadRole::Map,
                          ThreadRole::Stream, ThreadRole::Detect}) {
    const Seen seen = run(role, {.tracking_core = 0, .other_core = -1});
    EXPECT_EQ(seen.name, name_of(role));
    const bool pinned = role == ThreadRole::Capture || role == ThreadRole::Track;
    EXPECT_EQ(seen.cores, pinned ? 1 : cores_of_this_process()) << seen.name;
    EXPECT_EQ(seen.niceness, role == ThreadRole::Detect ? std::min(own + 10, 19) : own) << seen.name;
    EXPECT_EQ(seen.policy, SCHED_OTHER);
#ifndef STILLMAP_SANITIZED
    EXPECT_EQ(seen.stack_bytes, 256u << 10) << seen.name;
#endif
  }
}

TEST(StageThread, TellsHowMuchOfItsStackWasNeeded) {
  constexpr std::size_t kNeeded = 100'000;
  const auto after = [](bool prefault, std::size_t bytes) {
    StageThread thread;
    thread.start(ThreadRole::Map, {}, prefault, [=] {
      const auto memory = static_cast<volatile char*>(__builtin_alloca(bytes));
      memory[0] = 1;
    });
    thread.join();
    return thread.stack_usage();
  };
  for (const bool prefault : {false, true}) {
#ifdef STILLMAP_SANITIZED
    if (prefault) continue;  // a sanitizer's marks stay where the stack was touched
#endif
    const PoolUsage little = after(prefault, 16), much = after(prefault, kNeeded);
    EXPECT_STREQ(much.name, "stack.map");
    EXPECT_GE(much.high_water, kNeeded);
    EXPECT_LT(much.high_water, much.capacity);
    EXPECT_LT(little.high_water + kNeeded / 2, much.high_water);
  }
  EXPECT_EQ(StageThread().stack_usage().high_water, 0U) << "that never ran";
}

TEST(StageThread, CoresAreCountedAmongThoseThatTheProcessMayUse) {
  cpu_set_t before, last;
  sched_getaffinity(0, sizeof(before), &before);
  CPU_ZERO(&last);
  for (int core = 0; core < CPU_SETSIZE; ++core) {
    if (CPU_ISSET(core, &before) == 0) continue;
    CPU_ZERO(&last);
    CPU_SET(core, &last);
  }
  sched_setaffinity(0, sizeof(last), &last);  // as taskset does it
  std::vector<std::string> warnings;
  const Config::Threads usable = usable_threads({.tracking_core = 0, .other_core = 1}, warnings);
  std::atomic<int> core{-1};
  StageThread thread;
  thread.start(ThreadRole::Track, usable, false, [&] { core = sched_getcpu(); });
  thread.join();
  sched_setaffinity(0, sizeof(before), &before);
  EXPECT_NE(CPU_ISSET(core.load(), &last), 0);
  EXPECT_EQ(usable.other_core, -1);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("threads.other_core = 1, but this process may use 1 cores"));
}

TEST(StageThreadDeathTest, RealtimeIsForAFramesWayAndBounded) {
  // In a process of its own, which may lose the right for the rest of its life.
  const auto check = [] {
    std::vector<std::string> warnings;
    const Config::Threads usable = usable_threads({.realtime = true}, warnings);
    const auto fifo = SCHED_FIFO | SCHED_RESET_ON_FORK;
    rlimit bound{};
    getrlimit(RLIMIT_RTTIME, &bound);
    const bool good = usable.realtime
                          ? warnings.empty() && bound.rlim_cur <= 500'000 &&
                                sched_getscheduler(0) == SCHED_OTHER &&
                                run(ThreadRole::Capture, usable).policy == fifo &&
                                run(ThreadRole::Track, usable).policy == fifo &&
                                run(ThreadRole::Map, usable).policy == SCHED_OTHER
                          : warnings.size() == 1 && warnings[0].find("CAP_SYS_NICE") != std::string::npos &&
                                run(ThreadRole::Capture, usable).policy == SCHED_OTHER;
    std::_Exit(good ? 0 : 1);
  };
  EXPECT_EXIT(check(), ::testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace stillmap
