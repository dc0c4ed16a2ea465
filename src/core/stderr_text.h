// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace stillmap {

/// Writes whole lines to stderr as far as it takes them at once. Never waits: where a pipe or a terminal
/// behind it is full because nobody reads, the rest is lost, and before the next text that gets through a
/// line tells how many texts were. Any thread; takes no memory.
void write_stderr(std::string_view text) noexcept;

}  // namespace stillmap
