// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace stillmap::test {

/// How often this program called operator new so far (heap_count.cpp replaces it).
std::uint64_t heap_calls();

}  // namespace stillmap::test
