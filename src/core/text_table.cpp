// SPDX-License-Identifier: Apache-2.0
#include "core/text_table.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace stillmap {

namespace {

constexpr std::string_view kSeparators = " \t,\r";
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
constexpr Nanoseconds kLargest = 4'000'000'000'000'000'000;  // the year 2096; sums of two stamps still fit

std::vector<std::string> split(std::string_view line) {
  std::vector<std::string> columns;
  for (std::size_t at = line.find_first_not_of(kSeparators); at != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(kSeparators, at), line.size());
    columns.emplace_back(line.substr(at, end - at));
    at = line.find_first_not_of(kSeparators, end);
  }
  return columns;
}

}  // namespace

Result<std::vector<TextRow>> read_text_table(const std::string& path) {
  std::error_code unknown;
  const std::filesystem::file_status kind = std::filesystem::status(path, unknown);
  if (std::filesystem::exists(kind) && !std::filesystem::is_regular_file(kind))
    return Error{ExitCode::UnreadableInput, path + ": cannot be read: it is no regular file; name one"};
  std::ifstream file(path, std::ios::binary);
  std::vector<TextRow> rows;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (number == 1 && line.starts_with(kByteOrderMark)) line.erase(0, kByteOrderMark.size());
    std::vector<std::string> columns = split(line);
    if (!columns.empty() && columns[0][0] != '#') rows.push_back({number, std::move(columns), file.eof()});
  }
  if (!file.eof())
    return Error{ExitCode::UnreadableInput, path + ": cannot be read: " + std::strerror(errno)};
  return rows;
}

std::optional<Nanoseconds> parse_stamp(std::string_view seconds) {
  std::string digits;
  std::ptrdiff_t whole_digits = 0;  // digits before the decimal point
  bool in_fraction = false, any = false;
  std::size_t i = 0;
  for (; i < seconds.size() && seconds[i] != 'e' && seconds[i] != 'E'; ++i) {
    const char c = seconds[i];
    if (c == '.' && !in_fraction) {
      in_fraction = true;
    } else if (c >= '0' && c <= '9') {
      any = true;
      digits += c;
      if (!in_fraction) ++whole_digits;
    } else {
      return std::nullopt;
    }
  }
  if (!any) return std::nullopt;
  if (i < seconds.size()) {
    std::string_view exponent_text = seconds.substr(i + 1);
    if (exponent_text.starts_with('+') && !exponent_text.starts_with("+-")) exponent_text.remove_prefix(1);
    int exponent = 0;
    const char* end = exponent_text.data() + exponent_text.size();
    const auto [stopped, error] = std::from_chars(exponent_text.data(), end, exponent);
    if (error != std::errc() || stopped != end || exponent > 30 || exponent < -30) return std::nullopt;
    whole_digits += exponent;
  }
  const std::ptrdiff_t kept = whole_digits + 9;  // digits that make whole nanoseconds
  const auto digit = [&](std::ptrdiff_t at) {
    return at >= 0 && at < std::ssize(digits) ? digits[static_cast<std::size_t>(at)] - '0' : 0;
  };
  Nanoseconds value = 0;
  for (std::ptrdiff_t at = 0; at < kept; ++at) {
    if (value >= kLargest / 10) return std::nullopt;
    value = 10 * value + digit(at);
  }
  return value + (digit(kept) >= 5 ? 1 : 0);
}

std::string stamp_text(Nanoseconds stamp_ns) {
  std::string fraction = std::to_string(stamp_ns % 1'000'000'000);
  fraction.insert(0, 9 - fraction.size(), '0');
  return std::to_string(stamp_ns / 1'000'000'000) + "." + fraction;
}

}  // namespace stillmap
