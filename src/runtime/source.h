// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/status.h"
#include "drivers/rgbd_driver.h"
#include "runtime/reopening_source.h"

namespace stillmap {

struct OpenedSource {
  std::unique_ptr<RgbdDriver> driver;
  std::vector<Nanoseconds> stamps;   ///< colour stamps of a log's first pass; empty for a camera
  std::unique_ptr<SourceNews> news;  ///< null for a log
};

/// Opens what a source URI names: `tum:DIR`, `v4l2:COLOUR,DEPTH`, `openni2:[URI|FILE.oni]`,
/// `libcamera:ID[,DEPTH]` (without DEPTH, the first video node with depth). A camera that goes away is opened
/// anew until camera.give_up_s has passed. A log in the TUM layout is played `loops` times, forwards and
/// backwards in turn; what else was opened cannot be.
Result<OpenedSource> open_source(const std::string& uri, const Config& config, int loops);

/// The folder of the log that `tum:DIR` names. The error tells a URI of another kind from a folder that is
/// none.
Result<std::string> log_folder(const std::string& uri);

/// The source that somebody meant by `word`, as "; did you mean `--source URI`?"; empty where it is like
/// none.
std::string meant_source(const std::string& word);

/// What can be opened on this machine now.
struct FoundSource {
  std::string uri;          ///< for --source; empty for a device that needs a partner
  std::string description;  ///< for people
};
std::vector<FoundSource> find_sources();

/// The kinds of source that this program can open: "tum, v4l2, openni2, libcamera".
std::string source_kinds();

/// A camera profile where none is given, as --set overrides.
struct NominalProfile {
  std::vector<std::string> overrides;
  std::string warning;  ///< what is assumed, and the mend
};
/// With the lens that the device itself tells, where it does; otherwise nominal values.
NominalProfile nominal_profile(const std::string& uri);

}  // namespace stillmap
