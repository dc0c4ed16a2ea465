// SPDX-License-Identifier: Apache-2.0
#include "map/whole_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <utility>

namespace stillmap {

namespace {

constexpr std::size_t kBufferBytes = 1 << 16;

Error cannot_write(const std::string& path, int error) {
  const char* mend = "choose another file name";
  if (error == ENOSPC || error == EDQUOT || error == EFBIG) mend = "free some space or write to another disk";
  if (error == ENOENT || error == ENOTDIR) mend = "create the folder first or choose another one";
  if (error == EACCES || error == EPERM || error == EROFS)
    mend = "make the folder writable or choose another one";
  if (error == ETIMEDOUT) mend = "raise map.save_timeout_s or write to a faster disk";
  return {ExitCode::RunFailed, path + ": cannot write the map: " + std::strerror(error) + "; " + mend};
}

/// Makes the new name itself survive a power cut. 0 or an errno.
int sync_folder(const std::filesystem::path& folder) {
  const int fd = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return errno;
  const int error = fsync(fd) != 0 ? errno : 0;
  close(fd);
  return error;
}

}  // namespace

std::uint64_t fnv1a(const void* data, std::size_t bytes, std::uint64_t before) {
  const auto* from = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < bytes; ++i) before = (before ^ from[i]) * 0x100000001b3u;
  return before;
}

WholeFile::WholeFile(std::string path, Nanoseconds timeout_ns)
    : path_(std::move(path)),
      temporary_(path_ + ".tmp"),
      fd_(open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)),
      checksum_(kFnvBegin),
      begin_ns_(monotonic_now()),
      timeout_ns_(timeout_ns) {
  if (fd_ < 0) error_ = errno;
  buffer_.reserve(kBufferBytes);
}

WholeFile::~WholeFile() {
  if (fd_ < 0) return;
  close(fd_);
  unlink(temporary_.c_str());
}

void WholeFile::append(const void* data, std::size_t bytes) {
  checksum_ = fnv1a(data, bytes, checksum_);
  if (buffer_.size() + bytes > kBufferBytes) flush();
  const char* from = static_cast<const char*>(data);
  buffer_.insert(buffer_.end(), from, from + bytes);
}

void WholeFile::flush() {
  if (error_ == 0 && monotonic_now() - begin_ns_ > timeout_ns_) error_ = ETIMEDOUT;
  std::size_t done = 0;
  while (error_ == 0 && done < buffer_.size()) {
    const ssize_t n = write(fd_, buffer_.data() + done, buffer_.size() - done);
    if (n >= 0) {
      done += static_cast<std::size_t>(n);
    } else if (errno != EINTR) {
      error_ = errno;
    }
  }
  buffer_.clear();
}

Status WholeFile::finish() {
  flush();
  if (error_ == 0 && fsync(fd_) != 0) error_ = errno;
  if (error_ == 0 && std::rename(temporary_.c_str(), path_.c_str()) != 0) error_ = errno;
  if (error_ != 0) return cannot_write(path_, error_);
  close(fd_);
  fd_ = -1;
  const std::filesystem::path folder = std::filesystem::path(path_).parent_path();
  if (const int unsynced = sync_folder(folder.empty() ? "." : folder); unsynced != 0)
    return cannot_write(path_, unsynced);
  return {};
}

}  // namespace stillmap
