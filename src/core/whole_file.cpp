// SPDX-License-Identifier: Apache-2.0
#include "core/whole_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <utility>

namespace stillmap {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBufferBytes = 1 << 16;

Error cannot_write(const std::string& path, int error) {
  const char* mend = "choose another file name";
  if (error == ENOSPC || error == EDQUOT || error == EFBIG) mend = "free some space or write to another disk";
  if (error == ENOENT || error == ENOTDIR) mend = "create the folder first or choose another one";
  if (error == EACCES || error == EPERM || error == EROFS)
    mend = "make the folder writable or choose another one";
  if (error == EISDIR) mend = "name a file in it";
  if (error == ETIMEDOUT) mend = "raise map.save_timeout_s or write to a faster disk";
  return {ExitCode::RunFailed, path + ": cannot be written: " + std::strerror(error) + "; " + mend};
}

/// A device, a pipe: there is nothing to rename over.
bool is_written_directly(const std::string& path) {
  std::error_code unknown;
  const fs::file_type type = fs::status(path, unknown).type();
  return type != fs::file_type::none && type != fs::file_type::not_found && type != fs::file_type::regular &&
         type != fs::file_type::directory;
}

/// Makes the new name itself survive a power cut. 0 or an errno.
int sync_folder(const fs::path& folder) {
  const int fd = open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return errno;
  const int error = fsync(fd) != 0 ? errno : 0;
  close(fd);
  return error;
}

}  // namespace

int EarlierFile::keep(const std::string& path, std::uint64_t bytes) {
  std::error_code none;
  const std::uintmax_t its_bytes = fs::file_size(path, none);
  if (replaced_ || !kept_as_.empty() || none || its_bytes <= 2 * bytes) return 0;
  const fs::path whole(path);
  for (int number = 1;; ++number) {
    fs::path name = whole;
    name.replace_filename(whole.stem().string() + "." + std::to_string(number) + whole.extension().string());
    // A second name, so that the first is never without its file; or, where the disk knows no such, another.
    if (link(path.c_str(), name.c_str()) != 0) {
      if (errno == EEXIST) continue;
      if (errno != EPERM && errno != EOPNOTSUPP) return errno;
      if (fs::exists(name, none)) continue;
      if (std::rename(path.c_str(), name.c_str()) != 0) return errno;
    }
    kept_as_ = name;
    kept_bytes_ = its_bytes;
    return 0;
  }
}

void EarlierFile::let_go(std::uint64_t bytes) {
  replaced_ = true;
  if (kept_as_.empty() || 2 * bytes < kept_bytes_) return;
  unlink(kept_as_.c_str());
  kept_as_.clear();
}

std::uint64_t fnv1a(const void* data, std::size_t bytes, std::uint64_t before) {
  const auto* from = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < bytes; ++i) before = (before ^ from[i]) * 0x100000001b3u;
  return before;
}

WholeFile::WholeFile(std::string path, Nanoseconds timeout_ns, EarlierFile* earlier)
    : path_(std::move(path)),
      target_(path_),
      checksum_(kFnvBegin),
      begin_ns_(monotonic_now()),
      timeout_ns_(timeout_ns),
      earlier_(earlier) {
  std::error_code unknown;
  if (fs::is_directory(path_, unknown)) {
    error_ = EISDIR;
    return;
  }
  if (is_written_directly(path_)) {
    temporary_ = target_;
  } else {
    if (fs::is_symlink(path_, unknown)) target_ = fs::weakly_canonical(path_, unknown);
    temporary_ = target_ + ".tmp";
  }
  fd_ = open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd_ < 0) error_ = errno;
  buffer_.reserve(kBufferBytes);
}

WholeFile::~WholeFile() {
  if (fd_ < 0) return;
  close(fd_);
  if (temporary_ != target_) unlink(temporary_.c_str());
}

Status WholeFile::opened() const {
  return error_ == 0 ? Status() : cannot_write(path_, error_);
}

void WholeFile::append(const void* data, std::size_t bytes) {
  checksum_ = fnv1a(data, bytes, checksum_);
  bytes_ += bytes;
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
  const bool renamed = temporary_ != target_;
  if (error_ == 0 && renamed) {
    if (fsync(fd_) != 0) error_ = errno;
    if (error_ == 0 && earlier_ != nullptr) error_ = earlier_->keep(target_, bytes_);
    if (error_ == 0 && std::rename(temporary_.c_str(), target_.c_str()) != 0) error_ = errno;
  }
  if (error_ != 0) return cannot_write(path_, error_);
  close(std::exchange(fd_, -1));
  if (!renamed) return {};
  if (earlier_ != nullptr) earlier_->let_go(bytes_);
  if (const int unsynced = sync_folder(fs::path(target_).parent_path()); unsynced != 0)
    return cannot_write(path_, unsynced);
  return {};
}

Status write_whole(const std::string& path, std::string_view text) {
  WholeFile file(path);
  file.append(text);
  return file.finish();
}

Status check_writable(const std::string& path) {
  if (is_written_directly(path))  // to open a pipe would be to begin
    return access(path.c_str(), W_OK) == 0 ? Status() : cannot_write(path, errno);
  return WholeFile(path).opened();
}

}  // namespace stillmap
