// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace stillmap::test {

/// How often this thread has called the heap, C libraries included (link stillmap_test_heap); 0 where a
/// sanitizer owns the heap.
long heap_calls();
bool counts_heap_calls();

}  // namespace stillmap::test
