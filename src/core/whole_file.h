// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "core/status.h"
#include "core/time.h"

namespace stillmap {

/// The file that an earlier run left where this one writes, so that a short run takes no long one's work
/// away: where it is more than twice as large as what replaces it, it stays as NAME.1.EXT, or the next number
/// that is free. When what replaces it has grown to half its size, it goes. One for a run and a path.
class EarlierFile {
 public:
  /// Where it is now; empty: it was not kept.
  const std::string& kept_as() const { return kept_as_; }

 private:
  friend class WholeFile;
  /// Before `bytes` take the place of `path`; 0 or an errno.
  int keep(const std::string& path, std::uint64_t bytes);
  /// After they did.
  void let_go(std::uint64_t bytes);

  bool replaced_ = false;  // what lies at the path is this run's own
  std::string kept_as_;
  std::uint64_t kept_bytes_ = 0;
};

/// A file that appears whole or not at all: written front to back beside `path` as `path`.tmp, synced, then
/// renamed over it, and the folder synced so that the name survives a power cut. A link stays one: what it
/// leads to is replaced; what is no regular file (/dev/stdout) is written to directly. The first failure is
/// kept and the rest is skipped. One thread; uses the heap.
class WholeFile {
 public:
  /// Writing gives up `timeout_ns` after this. `earlier`, where given, outlives this.
  explicit WholeFile(std::string path, Nanoseconds timeout_ns = std::numeric_limits<Nanoseconds>::max(),
                     EarlierFile* earlier = nullptr);
  /// Without `finish`, nothing appears and nothing is left.
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;

  /// Whether there is anything to write to; the error is that of `finish`.
  Status opened() const;
  void append(const void* data, std::size_t bytes);
  void append(std::string_view text) { append(text.data(), text.size()); }
  /// FNV-1a over all that was appended so far.
  std::uint64_t checksum() const { return checksum_; }
  /// The error (RunFailed) names the file and the mend.
  Status finish();

 private:
  void flush();

  std::string path_;                // as it was given, for errors
  std::string target_, temporary_;  // the same where it is written to directly
  int fd_ = -1;
  int error_ = 0;
  std::uint64_t checksum_, bytes_ = 0;
  Nanoseconds begin_ns_, timeout_ns_;
  EarlierFile* earlier_;
  std::vector<char> buffer_;
};

/// A text as a WholeFile.
Status write_whole(const std::string& path, std::string_view text);

/// The error with which a WholeFile would end after the run, found out before it. Leaves nothing behind, and
/// an existing file as it is.
Status check_writable(const std::string& path);

/// FNV-1a of 64 bits, going on from `before`: each byte's step is invertible, so one changed byte always
/// changes the sum.
constexpr std::uint64_t kFnvBegin = 0xcbf29ce484222325u;
std::uint64_t fnv1a(const void* data, std::size_t bytes, std::uint64_t before = kFnvBegin);

}  // namespace stillmap
