// SPDX-License-Identifier: Apache-2.0
// LD_PRELOAD for the program under test: a wall clock that jumps by an hour with every look, where
// STILLMAP_TEST_CLOCK is set; and a disk that is as the first letter of the file $STILLMAP_TEST_DISK says at
// the moment: s is slow to write, l is slow to read, r has become read-only, anything else is well.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdlib>
#include <ctime>

namespace {

template <class Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
using Open = int (*)(const char*, int, mode_t);
using OpenAt = int (*)(int, const char*, int, mode_t);

long jump_s() {
  static const bool jumps = std::getenv("STILLMAP_TEST_CLOCK") != nullptr;
  static std::atomic<unsigned> looks{0};
  if (!jumps) return 0;
  return looks++ % 2 == 0 ? 3600 : -3600;
}

char disk() {
  static const volatile char* const state = []() -> const volatile char* {
    const char* path = std::getenv("STILLMAP_TEST_DISK");
    if (path == nullptr) return nullptr;
    const int file = next<Open>("open")(path, O_RDONLY | O_CLOEXEC, 0);
    void* memory = mmap(nullptr, 1, PROT_READ, MAP_SHARED, file, 0);
    close(file);
    return memory == MAP_FAILED ? nullptr : static_cast<const volatile char*>(memory);
  }
  ();
  return state == nullptr ? '-' : *state;
}

bool refuses(int flags) {
  if (disk() != 'r' || (flags & (O_WRONLY | O_RDWR | O_CREAT)) == 0) return false;
  errno = EROFS;
  return true;
}

mode_t mode_of(int flags, va_list rest) {
  return (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* t) noexcept {
  static const auto real = next<int (*)(clockid_t, timespec*)>("clock_gettime");
  const int result = real(clock, t);
  if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) t->tv_sec += jump_s();
  return result;
}

int gettimeofday(timeval* t, void* zone) noexcept {
  static const auto real = next<int (*)(timeval*, void*)>("gettimeofday");
  const int result = real(t, zone);
  t->tv_sec += jump_s();
  return result;
}

time_t time(time_t* out) noexcept {
  static const auto real = next<time_t (*)(time_t*)>("time");
  const time_t now = real(nullptr) + jump_s();
  if (out != nullptr) *out = now;
  return now;
}

int open(const char* path, int flags, ...) {
  static const auto real = next<Open>("open");
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = mode_of(flags, rest);
  va_end(rest);
  return refuses(flags) ? -1 : real(path, flags, mode);
}

int openat(int folder, const char* path, int flags, ...) {
  static const auto real = next<OpenAt>("openat");
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = mode_of(flags, rest);
  va_end(rest);
  return refuses(flags) ? -1 : real(folder, path, flags, mode);
}

ssize_t write(int file, const void* data, size_t bytes) {
  static const auto real = next<ssize_t (*)(int, const void*, size_t)>("write");
  struct stat facts {};
  if ((disk() == 's' || disk() == 'r') && fstat(file, &facts) == 0 && S_ISREG(facts.st_mode)) {
    if (refuses(O_WRONLY)) return -1;
    if (disk() == 's') usleep(30'000);
  }
  return real(file, data, bytes);
}

ssize_t read(int file, void* data, size_t bytes) {
  static const auto real = next<ssize_t (*)(int, void*, size_t)>("read");
  struct stat facts {};
  if (disk() == 'l' && fstat(file, &facts) == 0 && S_ISREG(facts.st_mode)) usleep(50'000);
  return real(file, data, bytes);
}

}  // extern "C"
