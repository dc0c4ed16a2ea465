// SPDX-License-Identifier: Apache-2.0
#include "runtime/threads.h"

#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <new>
#include <utility>

#include "core/check.h"
#include "runtime/heap_count.h"

namespace stillmap {

namespace {

#ifdef STILLMAP_SANITIZED
constexpr std::size_t kStackBytes = 4 << 20;  // a sanitizer's frames are larger
#else
constexpr std::size_t kStackBytes = 256 << 10;
#endif
// Above anything of ours and below what the kernel itself runs at 50.
constexpr int kCapturePriority = 20, kTrackPriority = 10;
constexpr int kDetectorNiceness = 10;  // the last to get a core that is short
constexpr rlim_t kRealtimeBound_us = 500'000;

constexpr const char* kOfStacks = "stack.";
/// In the order of ThreadRole.
constexpr std::array<const char*, kThreadRoles> kStackNames{"stack.decode", "stack.capture", "stack.track",
                                                            "stack.adjust", "stack.map",     "stack.stream",
                                                            "stack.detect"};
static_assert(static_cast<std::size_t>(ThreadRole::Detect) + 1 == kThreadRoles);

bool on_a_frames_way(ThreadRole role) {
  return role == ThreadRole::Capture || role == ThreadRole::Track;
}

cpu_set_t allowed_cores() {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  sched_getaffinity(0, sizeof(cores), &cores);
  return cores;
}

void pin_to(int nth) {
  const cpu_set_t allowed = allowed_cores();
  for (int core = 0; core < CPU_SETSIZE; ++core) {
    if (CPU_ISSET(core, &allowed) == 0 || nth-- > 0) continue;
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(core, &one);
    sched_setaffinity(0, sizeof(one), &one);
    return;
  }
}

bool go_before_all(int priority) {
  const sched_param param{.sched_priority = priority};
  return sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &param) == 0;
}

[[gnu::noinline]] void touch_stack() {
  volatile char stack[kStackBytes * 3 / 4];
  for (std::size_t i = 0; i < sizeof(stack); i += 4096) stack[i] = 0;
}

}  // namespace

const char* name_of(ThreadRole role) {
  return kStackNames[static_cast<std::size_t>(role)] + std::strlen(kOfStacks);
}

Config::Threads usable_threads(const Config::Threads& asked, std::vector<std::string>& warnings) {
  Config::Threads usable = asked;
  const cpu_set_t allowed = allowed_cores();
  const int count = CPU_COUNT(&allowed);
  const auto check_core = [&](const char* key, int& core) {
    if (core < count) return;
    warnings.push_back(std::string(key) + " = " + std::to_string(core) + ", but this process may use " +
                       std::to_string(count) + " cores, counted from 0: not pinned");
    core = -1;
  };
  check_core("threads.tracking_core", usable.tracking_core);
  check_core("threads.other_core", usable.other_core);
  if (!asked.realtime) return usable;
  const sched_param ordinary{};
  usable.realtime = go_before_all(kTrackPriority);
  if (usable.realtime) {
    sched_setscheduler(0, SCHED_OTHER, &ordinary);
    const rlimit bound{kRealtimeBound_us, kRealtimeBound_us};
    setrlimit(RLIMIT_RTTIME, &bound);
  } else {
    warnings.push_back(
        "threads.realtime: this process may not use SCHED_FIFO; grant CAP_SYS_NICE or an rtprio limit of " +
        std::to_string(kCapturePriority) + " (systemd: LimitRTPRIO); running without");
  }
  return usable;
}

void* StageThread::enter(void* self) {
  StageThread& thread = *static_cast<StageThread*>(self);
  const HeapScope scope(HeapOwner::None);
  pthread_setname_np(pthread_self(), name_of(thread.role_));
  const int core = on_a_frames_way(thread.role_) ? thread.config_.tracking_core : thread.config_.other_core;
  if (core >= 0) pin_to(core);
  if (thread.role_ == ThreadRole::Detect)
    setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + kDetectorNiceness);  // of this thread alone
  if (thread.config_.realtime && on_a_frames_way(thread.role_))
    go_before_all(thread.role_ == ThreadRole::Capture ? kCapturePriority : kTrackPriority);
  if (thread.prefault_) touch_stack();
  thread.body_();
  return nullptr;
}

StageThread::StageThread() {
  const auto guard_bytes = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  void* memory = mmap(nullptr, guard_bytes + kStackBytes, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK | MAP_NORESERVE, -1, 0);
  if (memory == MAP_FAILED) throw std::bad_alloc();
  mprotect(memory, guard_bytes, PROT_NONE);
  stack_ = static_cast<std::byte*>(memory) + guard_bytes;
}

StageThread::~StageThread() {
  join();
  const auto guard_bytes = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  munmap(stack_ - guard_bytes, guard_bytes + kStackBytes);
}

void StageThread::start(ThreadRole role, const Config::Threads& config, bool prefault,
                        std::function<void()> body) {
  STILLMAP_CHECK(!started_);
  role_ = role;
  config_ = config;
  prefault_ = prefault;
  body_ = std::move(body);
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstack(&attributes, stack_, kStackBytes);
  started_ = pthread_create(&thread_, &attributes, enter, this) == 0;
  pthread_attr_destroy(&attributes);
  STILLMAP_CHECK(started_);
}

void StageThread::join() {
  if (std::exchange(started_, false)) pthread_join(thread_, nullptr);
}

PoolUsage StageThread::stack_usage() const {
  STILLMAP_CHECK(!started_);
  // The kernel gave zeros, and stacks grow downwards: what lies below the last byte that is none was not
  // needed.
  const std::byte* end = stack_ + kStackBytes;
  const std::byte* deepest =
      std::find_if(static_cast<const std::byte*>(stack_), end, [](std::byte b) { return b != std::byte{}; });
  return {kStackNames[static_cast<std::size_t>(role_)], kStackBytes,
          static_cast<std::uint64_t>(end - deepest), 0};
}

}  // namespace stillmap
