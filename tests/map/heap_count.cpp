// SPDX-License-Identifier: Apache-2.0
#include "heap_count.h"

#include <cstdlib>
#include <new>

namespace {
std::uint64_t calls = 0;
}

void* operator new(std::size_t bytes) {
  ++calls;
  if (void* p = std::malloc(bytes)) return p;
  throw std::bad_alloc();
}
void operator delete(void* p) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t) noexcept {
  std::free(p);
}

std::uint64_t stillmap::test::heap_calls() {
  return calls;
}
