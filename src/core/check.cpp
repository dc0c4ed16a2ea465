// SPDX-License-Identifier: Apache-2.0
#include "core/check.h"

#include <array>
#include <cstdio>
#include <cstdlib>

#include "core/stderr_text.h"

namespace stillmap {

void check_failed(const char* condition, const char* file, int line) {
  std::array<char, 512> words;
  std::snprintf(words.data(), words.size(), "stillmap: bug: %s does not hold (%s:%d)\n", condition, file,
                line);
  write_stderr(words.data());
  std::abort();
}

}  // namespace stillmap
