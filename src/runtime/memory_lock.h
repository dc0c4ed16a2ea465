// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace stillmap {

/// Whether this process has a capability (capabilities(7)); root in a container may lack it.
bool has_capability(unsigned number);

/// Keeps all memory of the process, now and later, from being swapped out once it is touched (MCL_ONFAULT:
/// what nobody uses costs nothing), and touches the program itself. With that a frame's way is in memory from
/// the start: the arena wrote to all its pages when it gave them out, and a stage's thread touches its stack;
/// of libraries, what the first frames call stays. The report's memory.major_faults counts the exceptions.
/// Empty where that is done; else the warning with the mend. Does nothing
/// under sanitizers, whose shadow memory is larger than any machine's.
std::string lock_memory();

}  // namespace stillmap
