// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace stillmap::test {

/// From now on, operator new throws std::bad_alloc on this thread, or no longer does (short_memory.cpp
/// replaces it).
void set_short_of_memory(bool is);

}  // namespace stillmap::test
