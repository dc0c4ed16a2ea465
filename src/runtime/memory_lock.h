// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace stillmap {

/// Keeps all memory of the process, now and later, from being swapped out once it is touched (MCL_ONFAULT:
/// what nobody uses costs nothing). Empty where that is done; else the warning with the mend. Does nothing
/// under sanitizers, whose shadow memory is larger than any machine's.
std::string lock_memory();

}  // namespace stillmap
