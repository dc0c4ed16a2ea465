// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "core/check.h"

namespace stillmap {

/// The process's exit codes; an error at start knows which one it ends with.
enum class ExitCode : int { Done = 0, RunFailed = 1, WrongConfig = 2, UnreadableInput = 3 };

/// One line that names the thing and the mend. Made at start and at shutdown only: it owns heap text.
struct Error {
  ExitCode exit_code = ExitCode::RunFailed;
  std::string message;
};

/// Success, or one Error. For work at start and shutdown; a frame's way uses plain enums instead.
class [[nodiscard]] Status {
 public:
  Status() = default;
  // NOLINTNEXTLINE(google-explicit-constructor): `return Error{...}`
  Status(Error error) : error_(std::move(error)) {}
  bool ok() const { return !error_.has_value(); }
  const Error& error() const { return *error_; }

 private:
  std::optional<Error> error_;
};

/// A value, or one Error.
template <class T>
class [[nodiscard]] Result {
 public:
  // NOLINTNEXTLINE(google-explicit-constructor): `return value`
  Result(T value) : value_(std::move(value)) {}
  // NOLINTNEXTLINE(google-explicit-constructor): `return Error{...}`
  Result(Error error) : error_(std::move(error)) {}
  bool ok() const { return value_.has_value(); }
  T& value() {
    STILLMAP_CHECK(value_.has_value());
    return *value_;
  }
  const T& value() const {
    STILLMAP_CHECK(value_.has_value());
    return *value_;
  }
  const Error& error() const { return *error_; }

 private:
  std::optional<T> value_;
  std::optional<Error> error_;
};

}  // namespace stillmap
