// SPDX-License-Identifier: Apache-2.0
#include "tests/support/heap_calls.h"

#include "runtime/heap_count.h"

namespace {
constinit thread_local long t_calls = 0;
}

// What the program's own interposer tells: linked in place of src/runtime/heap_count.cpp.
void stillmap::note_heap_allocation() noexcept {
  ++t_calls;
}

long stillmap::test::heap_calls() {
  return t_calls;
}

bool stillmap::test::counts_heap_calls() {
#ifdef STILLMAP_SANITIZED
  return false;
#else
  return true;
#endif
}
