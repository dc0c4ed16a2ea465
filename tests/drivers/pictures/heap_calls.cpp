// SPDX-License-Identifier: Apache-2.0
#include "tests/drivers/pictures/heap_calls.h"

#include <cstddef>

namespace {
thread_local long t_calls = 0;
}

#ifdef STILLMAP_SANITIZED
namespace stillmap::test {
bool counts_heap_calls() {
  return false;
}
}  // namespace stillmap::test
#else
namespace stillmap::test {
bool counts_heap_calls() {
  return true;
}
}  // namespace stillmap::test

// glibc calls these in place of its own; operator new ends here too.
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t bytes) {
  ++t_calls;
  return __libc_malloc(bytes);
}
void* calloc(std::size_t count, std::size_t bytes) {
  ++t_calls;
  return __libc_calloc(count, bytes);
}
void* realloc(void* old, std::size_t bytes) {
  ++t_calls;
  return __libc_realloc(old, bytes);
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
  ++t_calls;
  return __libc_memalign(alignment, bytes);
}
}
#endif

namespace stillmap::test {
long heap_calls() {
  return t_calls;
}
}  // namespace stillmap::test
