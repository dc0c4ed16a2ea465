// SPDX-License-Identifier: Apache-2.0
#include "map/ply.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <vector>

namespace stillmap {

namespace {

static_assert(std::endian::native == std::endian::little, "the PLY is written as it lies in memory");

constexpr std::size_t kBufferBytes = 1 << 16;
constexpr std::size_t kVertexBytes = 3 * sizeof(float) + 3;

/// A file that is written once, front to back. The first failure's errno is kept and the rest is skipped.
class OutputFile {
 public:
  OutputFile(const std::string& path, Nanoseconds timeout_ns)
      : fd_(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)),
        begin_ns_(monotonic_now()),
        timeout_ns_(timeout_ns) {
    if (fd_ < 0) error_ = errno;
    buffer_.reserve(kBufferBytes);
  }
  ~OutputFile() {
    if (fd_ >= 0) close(fd_);
  }
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void append(const void* data, std::size_t bytes) {
    if (buffer_.size() + bytes > kBufferBytes) flush();
    const char* from = static_cast<const char*>(data);
    buffer_.insert(buffer_.end(), from, from + bytes);
  }
  /// The errno of what went wrong, 0 when all bytes are on the disk.
  int finish() {
    flush();
    if (error_ == 0 && fsync(fd_) != 0) error_ = errno;
    if (fd_ >= 0 && close(fd_) != 0 && error_ == 0) error_ = errno;
    fd_ = -1;
    return error_;
  }

 private:
  void flush() {
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

  int fd_;
  int error_ = 0;
  Nanoseconds begin_ns_, timeout_ns_;
  std::vector<char> buffer_;
};

Error cannot_write(const std::string& path, int error) {
  const char* mend = "choose another file name with --map";
  if (error == ENOSPC || error == EDQUOT || error == EFBIG)
    mend = "free some space or write to another disk with --map";
  if (error == ENOENT || error == ENOTDIR) mend = "create the folder first or choose another one with --map";
  if (error == EACCES || error == EPERM || error == EROFS)
    mend = "make the folder writable or choose another one with --map";
  if (error == ETIMEDOUT) mend = "raise map.save_timeout_s or write to a faster disk with --map";
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

void append_vertices(const VoxelMap& map, OutputFile& file) {
  map.for_each_occupied([&file](const OccupiedVoxel& v) {
    const std::array<float, 3> place{v.x, v.y, v.z};
    std::array<char, kVertexBytes> vertex;
    std::memcpy(vertex.data(), place.data(), sizeof(place));
    vertex[12] = static_cast<char>(v.colour.r);
    vertex[13] = static_cast<char>(v.colour.g);
    vertex[14] = static_cast<char>(v.colour.b);
    file.append(vertex.data(), vertex.size());
  });
}

}  // namespace

Status write_ply(const VoxelMap& map, const std::string& path, Nanoseconds timeout_ns) {
  const std::string temporary = path + ".tmp";
  OutputFile file(temporary, timeout_ns);
  const std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment Stillmap voxel centres in m, map frame\nelement "
      "vertex " +
      std::to_string(map.occupied_voxels()) +
      "\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  file.append(header.data(), header.size());
  append_vertices(map, file);
  int error = file.finish();
  if (error == 0 && std::rename(temporary.c_str(), path.c_str()) != 0) error = errno;
  if (error != 0) {
    unlink(temporary.c_str());
    return cannot_write(path, error);
  }
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  if (const int unsynced = sync_folder(folder.empty() ? "." : folder); unsynced != 0)
    return cannot_write(path, unsynced);
  return {};
}

}  // namespace stillmap
