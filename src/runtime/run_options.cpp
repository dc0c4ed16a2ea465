// SPDX-License-Identifier: Apache-2.0
#include "runtime/run_options.h"

namespace stillmap {

const char* to_string(RunMode mode) {
  constexpr std::array<const char*, kRunModes.size()> kNames{"live", "realtime", "fast", "lockstep"};
  return kNames[static_cast<std::size_t>(mode)];  // in its order
}

}  // namespace stillmap
