// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pthread.h>

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/fixed_vector.h"

namespace stillmap {

/// What a thread does decides its name, its core and its priority.
enum class ThreadRole { Decode, Capture, Track, Adjust, Map, Stream, Detect };
inline constexpr std::size_t kThreadRoles = 7;
/// As `top -H` shows it.
const char* name_of(ThreadRole role);

/// What of `asked` this process may do; a warning with the mend for each thing that it may not. Also bounds
/// how long a thread may hold a core with SCHED_FIFO, so that an endless loop ends the process and not the
/// machine.
Config::Threads usable_threads(const Config::Threads& asked, std::vector<std::string>& warnings);

/// A thread with a name, a core, a priority and a stack of 256 KB, which is taken by the constructor
/// (std::bad_alloc where there is none) and touched at once where `prefault` asks for it. Threads that it
/// starts (a library's) inherit its core but not SCHED_FIFO.
class StageThread {
 public:
  StageThread();
  ~StageThread();
  StageThread(const StageThread&) = delete;
  StageThread& operator=(const StageThread&) = delete;

  /// Once. `config` as `usable_threads` gave it.
  void start(ThreadRole role, const Config::Threads& config, bool prefault, std::function<void()> body);
  /// Waits for the end; nothing where it never started.
  void join();
  /// Once joined: of the stack's bytes, how many were ever written. ("stack.track", and so on.)
  PoolUsage stack_usage() const;

 private:
  static void* enter(void* self);
  std::byte* stack_;  // above a page that nobody may touch
  ThreadRole role_ = ThreadRole::Capture;
  Config::Threads config_;
  bool prefault_ = false, started_ = false;
  std::function<void()> body_;
  pthread_t thread_{};
};

}  // namespace stillmap
