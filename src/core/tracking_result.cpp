// SPDX-License-Identifier: Apache-2.0
#include "core/tracking_result.h"

namespace stillmap {

const char* to_string(TrackState state) {
  switch (state) {
    case TrackState::Initializing:
      return "initializing";
    case TrackState::Tracking:
      return "tracking";
    case TrackState::Weak:
      return "weak";
    case TrackState::Lost:
      return "lost";
  }
  return "?";
}

}  // namespace stillmap
