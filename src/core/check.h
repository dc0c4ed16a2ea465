// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace stillmap {

/// Ends the process on a broken promise of our own code (a bug), never on bad input or a failing world.
/// A supervisor restarts the runtime, which resumes from its checkpoint.
[[noreturn]] void check_failed(const char* condition, const char* file, int line);

}  // namespace stillmap

/// On in every build, release included.
#define STILLMAP_CHECK(condition) \
  ((condition) ? static_cast<void>(0) : ::stillmap::check_failed(#condition, __FILE__, __LINE__))
