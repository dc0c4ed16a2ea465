// SPDX-License-Identifier: Apache-2.0
#include "detect/model_file.h"

#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <system_error>
#include <vector>

namespace stillmap {

namespace {

namespace fs = std::filesystem;

constexpr const char* kMend = "fetch it with scripts/get_model.sh, or run with detector.model = \"none\"";

std::vector<fs::path> model_folders() {
  std::vector<fs::path> folders;
  if (const char* given = std::getenv("STILLMAP_MODELS"); given != nullptr && *given != '\0')
    folders.emplace_back(given);
  folders.emplace_back("models");
  std::error_code error;
  if (const fs::path program = fs::read_symlink("/proc/self/exe", error); !error) {
    folders.push_back((program.parent_path() / "../../../models").lexically_normal());
    folders.push_back((program.parent_path() / "../share/stillmap/models").lexically_normal());
  }
  return folders;
}

/// The file that "auto" stands for, or nothing, with the folders that were looked through.
struct Found {
  std::string path, searched;
};
Found find_default_model() {
  Found found;
  for (const fs::path& folder : model_folders()) {
    std::error_code error;
    if (fs::exists(folder / kDefaultModelName, error)) {
      found.path = folder / kDefaultModelName;
      break;
    }
    found.searched += (found.searched.empty() ? "" : ", ") + folder.string();
  }
  return found;
}

/// What a manifest must say, so that nothing of another network is taken for granted.
constexpr std::array kNeeded{"detector.decoder",      "detector.sha256",   "detector.input_width",
                             "detector.input_height", "detector.strides",  "detector.colour_order",
                             "detector.mean",         "detector.deviation"};

Status check_manifest(const LoadedConfig& loaded, const std::string& manifest) {
  const auto wrong = [&](const std::string& what) {
    return Error{ExitCode::WrongConfig, manifest + ": " + what};
  };
  for (const ConfigEntry& entry : loaded.entries) {
    const bool is_own = entry.key.starts_with("detector.") || entry.key.starts_with("classes.");
    if (entry.origin == manifest && (!is_own || entry.key == "detector.model"))
      return wrong("key '" + entry.key + "' is not the model's; move it to a file of --config");
    const bool is_missing = entry.origin == "default" || entry.origin == "built in" ||
                            (entry.origin == manifest && entry.value == "\"\"");
    if (is_missing && std::ranges::find(kNeeded, entry.key) != kNeeded.end())
      return wrong("key '" + entry.key + "' is missing; expected " + entry.help +
                   "; firmware-config/models has whole examples");
  }
  return {};
}

Error unreadable(const std::string& path, const std::string& why) {
  return {ExitCode::UnreadableInput, "detector.model: '" + path + "' " + why + "; " + kMend};
}

std::string hexadecimal(std::span<const unsigned char> bytes) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string hex;
  for (const unsigned char byte : bytes) {
    hex += kDigits[byte >> 4];
    hex += kDigits[byte & 15];
  }
  return hex;
}

/// Lower case; empty where `text` is no SHA-256.
std::string canonical(std::string text) {
  const auto is_hex = [](unsigned char c) { return std::isxdigit(c) != 0; };
  if (text.size() != 64 || !std::all_of(text.begin(), text.end(), is_hex)) return {};
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

}  // namespace

Result<LoadedConfig> load_config_of_model(std::span<const std::string> files,
                                          std::span<const std::string> overrides) {
  Result<LoadedConfig> plain = load_config(files, overrides);
  if (!plain.ok()) return plain;
  std::string model = plain.value().config.detector.model;
  if (model == "auto") model = find_default_model().path;
  if (model.empty() || model == "none") return plain;
  const std::string manifest = fs::path(model).replace_extension(".toml");
  std::error_code error;
  if (!fs::exists(manifest, error)) return plain;
  std::vector<std::string> with_manifest{manifest};
  with_manifest.insert(with_manifest.end(), files.begin(), files.end());
  Result<LoadedConfig> loaded = load_config(with_manifest, overrides);
  const Status checked = loaded.ok() ? check_manifest(loaded.value(), manifest) : loaded.error();
  if (!checked.ok())
    return Error{ExitCode::WrongConfig, "manifest of '" + model + "': " + checked.error().message};
  return loaded;
}

Result<ModelFile> read_model(const std::string& path) {
  std::error_code error;
  const fs::file_status kind = fs::status(path, error);
  if (fs::exists(kind) && !fs::is_regular_file(kind))
    return unreadable(path, "is a folder, a pipe or a device, not an ONNX file");
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), std::fclose);
  if (file == nullptr) return unreadable(path, std::string("cannot be read (") + std::strerror(errno) + ")");
  ModelFile model{.path = path, .bytes = {}, .sha256 = {}, .warning = {}};
  if (const std::uintmax_t size = fs::file_size(path, error); !error)
    model.bytes.reserve(static_cast<std::size_t>(size));
  std::array<char, 65536> chunk;
  while (const std::size_t count = std::fread(chunk.data(), 1, chunk.size(), file.get()))
    model.bytes.append(chunk.data(), count);
  if (std::ferror(file.get()) != 0) return unreadable(path, "cannot be read to its end");
  model.sha256 = sha256_of(model.bytes);
  return model;
}

Result<ModelFile> find_model(const Config::Detector& detector) {
  if (detector.model == "none") return ModelFile{};
  const std::string expected = canonical(detector.sha256);
  if (!detector.sha256.empty() && expected.empty()) {
    return Error{ExitCode::WrongConfig,
                 "detector.sha256: '" + detector.sha256 +
                     "' is not a SHA-256; expected 64 hex digits, or \"\" for no check"};
  }
  const bool is_auto = detector.model == "auto";
  ModelFile model;
  if (is_auto) {
    const Found found = find_default_model();
    model.path = found.path;
    if (model.path.empty()) {
      model.warning = std::string("no detector: ") + kDefaultModelName + " is in none of " + found.searched +
                      "; moving people will not be recognised; " + kMend;
      return model;
    }
  } else {
    model.path = detector.model;
  }
  Result<ModelFile> read = read_model(model.path);
  if (!read.ok()) return read;
  const std::string wanted = expected.empty() && is_auto ? kDefaultModelSha256 : expected;
  if (!wanted.empty() && wanted != read.value().sha256) {
    return unreadable(model.path, "is not the expected file: SHA-256 (detector.sha256) expected " + wanted +
                                      ", found " + read.value().sha256);
  }
  return read;
}

std::string sha256_of(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> sum;
  unsigned int length = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), sum.data(), &length, EVP_sha256(), nullptr) != 1) return {};
  return hexadecimal({sum.data(), length});
}

}  // namespace stillmap
