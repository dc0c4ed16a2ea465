// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "core/config.h"
#include "core/detection.h"

namespace stillmap {

/// How each of `classes.names` behaves, in their order; a name in no list is Ignored (seed paper, Table 1).
std::vector<ClassKind> class_kinds(const Config::Classes& classes);

/// One line that names every listed class that is not among `classes.names`; empty where there is none.
std::string class_warning(const Config::Classes& classes);

}  // namespace stillmap
