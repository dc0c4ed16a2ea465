// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/status.h"
#include "core/time.h"

namespace stillmap {

/// One line of a text table that holds something.
struct TextRow {
  int line = 0;  ///< counted from 1, for errors
  std::vector<std::string> columns;
  bool ends_the_file = false;  ///< without a newline: it may be cut off
};

/// Reads a table as the TUM RGB-D benchmark writes it: columns parted by blanks, tabs or commas; `#` starts a
/// line of comment; blank lines, CRLF and a missing last newline do not matter. For work at start: it uses
/// the heap. The error (UnreadableInput) names the file and why it cannot be read.
Result<std::vector<TextRow>> read_text_table(const std::string& path);

/// Decimal seconds, with or without a fraction and an exponent, to nanoseconds without a detour over floating
/// point: "1305031239.529662" is 1305031239529662000. Digits beyond the ninth decimal are rounded. Nothing
/// for what is no such number, is negative, or does not fit.
std::optional<Nanoseconds> parse_stamp(std::string_view seconds);

/// Seconds with nine decimals: what parse_stamp reads back exactly. `stamp_ns` must not be negative.
std::string stamp_text(Nanoseconds stamp_ns);

}  // namespace stillmap
