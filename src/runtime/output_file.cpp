// SPDX-License-Identifier: Apache-2.0
#include "runtime/output_file.h"

#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

namespace stillmap {

namespace {

namespace fs = std::filesystem;

std::string temporary_name(const std::string& path) {
  return path + ".part";
}

bool is_replaced_whole(const std::string& path) {
  std::error_code ignored;
  return !fs::exists(path, ignored) || fs::is_regular_file(path, ignored);
}

Error cannot_write(const std::string& path) {
  return {ExitCode::RunFailed,
          path + ": cannot be written; check the folder, its permissions and the space left"};
}

}  // namespace

Status check_writable(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored))
    return Error{ExitCode::RunFailed, path + ": is a folder; name a file in it"};
  bool good = false;
  if (is_replaced_whole(path)) {
    good = std::ofstream(temporary_name(path)).good();
    fs::remove(temporary_name(path), ignored);
  } else {
    good = access(path.c_str(), W_OK) == 0;
  }
  if (good) return {};
  return cannot_write(path);
}

Status write_text(const std::string& path, std::string_view text) {
  const bool whole = is_replaced_whole(path);
  const std::string target = whole ? temporary_name(path) : path;
  std::ofstream file(target, std::ios::binary);
  file << text;
  file.close();
  bool good = file.good();
  if (whole) {
    good = good && std::rename(target.c_str(), path.c_str()) == 0;
    if (!good) std::remove(target.c_str());
  }
  if (good) return {};
  return cannot_write(path);
}

}  // namespace stillmap
