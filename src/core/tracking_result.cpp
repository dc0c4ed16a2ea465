// SPDX-License-Identifier: Apache-2.0
#include "core/tracking_result.h"

namespace stillmap {

const char* to_string(TrackState state) {
  constexpr std::array kNames{"initializing", "tracking", "weak", "lost"};  // in its order
  static_assert(kNames.size() == static_cast<std::size_t>(TrackState::Lost) + 1);
  return kNames[static_cast<std::size_t>(state)];
}

}  // namespace stillmap
