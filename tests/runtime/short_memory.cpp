// SPDX-License-Identifier: Apache-2.0
#include "tests/runtime/short_memory.h"

#include <cstdlib>
#include <new>

namespace {
thread_local bool is_short = false;
}

void* operator new(std::size_t bytes) {
  if (void* p = is_short ? nullptr : std::malloc(bytes)) return p;
  throw std::bad_alloc();
}
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  return is_short ? nullptr : std::malloc(bytes);
}
void operator delete(void* p) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t) noexcept {
  std::free(p);
}

void stillmap::test::set_short_of_memory(bool is) {
  is_short = is;
}
