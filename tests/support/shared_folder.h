// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace stillmap::test {

/// The folder with recorded logs and models that tests use and the project does not ship: $STILLMAP_SHARED,
/// or
/// `../shared` beside the source tree. Empty where it is missing: such a test is skipped with a clear word.
inline std::filesystem::path shared_folder() {
  const char* given = std::getenv("STILLMAP_SHARED");
  const std::filesystem::path folder = given != nullptr ? given : STILLMAP_SOURCE_DIR "/../shared";
  return std::filesystem::is_directory(folder / "data") ? folder : std::filesystem::path();
}

}  // namespace stillmap::test

#define STILLMAP_NEEDS_SHARED()                  \
  if (::stillmap::test::shared_folder().empty()) \
  GTEST_SKIP() << "needs the shared data folder (STILLMAP_SHARED)"
