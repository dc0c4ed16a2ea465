// SPDX-License-Identifier: Apache-2.0
#include "runtime/run_options.h"

namespace stillmap {

const char* to_string(RunMode mode) {
  switch (mode) {
    case RunMode::Live:
      return "live";
    case RunMode::Realtime:
      return "realtime";
    case RunMode::Fast:
      return "fast";
    case RunMode::Lockstep:
      return "lockstep";
  }
  return "?";
}

}  // namespace stillmap
