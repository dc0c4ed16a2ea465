// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace stillmap {

/// One thing about this machine that decides whether a camera can be followed in real time.
struct Finding {
  bool good = false;
  std::string what;  ///< with the measured value
  std::string mend;  ///< a command or an action, where it is not good
};

/// Looks at the cores' number and speed, the governor, the limits of this process for real-time priority and
/// locked memory, the links of USB cameras, and who may open video nodes. `root` is "/" but in tests.
std::vector<Finding> examine_machine(const std::string& root);

}  // namespace stillmap
