// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "core/config.h"
#include "core/status.h"

namespace stillmap {

/// The default network's file, and what it must be byte for byte.
constexpr const char* kDefaultModelName = "nanodet_plus_m_int8.onnx";
constexpr const char* kDefaultModelSha256 =
    "b38dc42b22951ae5001d2b4ba0e1c49c9e47a6f7712cd31f20fc97c656fb478e";

/// The network to load.
struct ModelFile {
  std::string path;     ///< empty: the run goes without a detector
  std::string bytes;    ///< what the file held when it was verified; let go of once the network is open
  std::string sha256;   ///< of the file's bytes, 64 hex digits; empty without a file
  std::string warning;  ///< one line for the user where "auto" found nothing; else empty
};

/// A network's file, read once: what is verified is what will run. At start. Errors: UnreadableInput.
Result<ModelFile> read_model(const std::string& path);

/// load_config() with the manifest of `detector.model` beneath `files`, where there is one: `net.toml` beside
/// `net.onnx`, in the configuration's own form, with keys of `detector` and `classes` alone. At start.
/// Errors: WrongConfig as load_config(), and where the manifest says something else or not all that a network
/// needs.
Result<LoadedConfig> load_config_of_model(std::span<const std::string> files,
                                          std::span<const std::string> overrides);

/// Finds, reads and verifies `detector.model`, at start. A path must exist; "none" is no file; "auto" is the
/// default network in the first of $STILLMAP_MODELS, ./models, <executable's folder>/../../../models (a
/// checkout) and <executable's folder>/../share/stillmap/models that has it, or no file. The checksum is
/// compared with `detector.sha256`, or with kDefaultModelSha256 for "auto" without one. Errors:
/// UnreadableInput where the file cannot be read or is not the expected one, WrongConfig where the expected
/// checksum is none.
Result<ModelFile> find_model(const Config::Detector& detector);

/// SHA-256 of some bytes, 64 hex digits.
std::string sha256_of(std::string_view bytes);

}  // namespace stillmap
