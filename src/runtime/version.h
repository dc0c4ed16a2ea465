// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace stillmap {

extern const char* const kVersion;
/// What git says of the sources as they were built ("-dirty" where they were changed); "unknown" outside of
/// git.
extern const char* const kGitRevision;

}  // namespace stillmap
