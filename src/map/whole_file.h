// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "core/status.h"
#include "core/time.h"

namespace stillmap {

/// A file that appears whole or not at all: written front to back beside `path` as `path`.tmp, synced, then
/// renamed over it, and the folder synced so that the name survives a power cut. The first failure is kept
/// and the rest is skipped. One thread; uses the heap.
class WholeFile {
 public:
  /// Writing gives up `timeout_ns` after this.
  explicit WholeFile(std::string path, Nanoseconds timeout_ns = std::numeric_limits<Nanoseconds>::max());
  /// Without `finish`, nothing appears and nothing is left.
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;

  void append(const void* data, std::size_t bytes);
  /// FNV-1a over all that was appended so far.
  std::uint64_t checksum() const { return checksum_; }
  /// The error (exit code 1) names the file and the mend.
  Status finish();

 private:
  void flush();

  std::string path_, temporary_;
  int fd_;
  int error_ = 0;
  std::uint64_t checksum_;
  Nanoseconds begin_ns_, timeout_ns_;
  std::vector<char> buffer_;
};

/// FNV-1a of 64 bits, going on from `before`: each byte's step is invertible, so one changed byte always
/// changes the sum.
constexpr std::uint64_t kFnvBegin = 0xcbf29ce484222325u;
std::uint64_t fnv1a(const void* data, std::size_t bytes, std::uint64_t before = kFnvBegin);

}  // namespace stillmap
