// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "core/status.h"

namespace stillmap {

/// The error (RunFailed) with which writing `path` would end after the run, found out before it. Leaves
/// nothing behind, and an existing file as it is.
Status check_writable(const std::string& path);

/// Writes a file that appears whole or not at all: a temporary name beside it, then rename; what is no
/// regular file
/// (/dev/stdout) is written to directly. The error (RunFailed) names the file and the mend.
Status write_text(const std::string& path, std::string_view text);

}  // namespace stillmap
