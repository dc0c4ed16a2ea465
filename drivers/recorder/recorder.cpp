// SPDX-License-Identifier: Apache-2.0
#include "drivers/recorder/recorder.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "drivers/pictures/png.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kSecond = 1'000'000'000;

bool write_all(int file, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(file, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return true;
}

/// A file in `folder`; what could not be written whole is taken away again.
bool write_file(int folder, const char* name, std::span<const std::byte> bytes) {
  if (bytes.empty()) return false;
  const int file = openat(folder, name, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) return false;
  const bool whole = write_all(file, bytes);
  const bool closed = ::close(file) == 0;
  if (!whole || !closed) unlinkat(folder, name, 0);
  return whole && closed;
}

/// A line of a list, whole or not at all: what half a line would be joined with spoils the list.
bool append_line(int file, std::span<const std::byte> line) {
  const off_t end = lseek(file, 0, SEEK_END);
  if (write_all(file, line)) return true;
  // Where not even that can be done, the line is the next one's trouble.
  if (end >= 0) [[maybe_unused]]
    const int cut = ftruncate(file, end);
  return false;
}

/// Text on the stack.
class Line {
 public:
  template <class... Values>
  explicit Line(const char* format, Values... values) {
    const int length = std::snprintf(text_.data(), text_.size(), format, values...);
    length_ = std::min(text_.size() - 1, static_cast<std::size_t>(std::max(0, length)));
  }
  const char* text() const { return text_.data(); }
  std::span<const std::byte> bytes() const { return std::as_bytes(std::span(text_.data(), length_)); }

 private:
  std::array<char, 256> text_{};
  std::size_t length_ = 0;
};

}  // namespace

struct Recorder::Writer {
  explicit Writer(const Setup& s) : png(s.width, s.height) {
    if (s.exact_colour) return;
    jpeg.emplace(Scratch(JpegEncoder::memory_bytes(s.width)), s.width, s.height);
    // Noise at quality 100 is as large as the picture.
    jpeg_file.resize(static_cast<std::size_t>(s.width) * static_cast<std::size_t>(s.height) * 3 + (1 << 16));
  }
  ~Writer() {
    for (const int file : {both, colour, depth, folder}) {
      if (file >= 0) ::close(file);
    }
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  int create(const char* name) const {
    return openat(folder, name, O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0644);
  }

  std::span<const std::byte> encode_colour(ImageView<const Bgr> picture, int quality) {
    if (!jpeg) return png.encode_colour(picture);
    return std::span(jpeg_file).first(jpeg->encode(picture, quality, jpeg_file));
  }

  PngEncoder png;
  std::optional<JpegEncoder> jpeg;  // where colour is not exact
  std::vector<std::byte> jpeg_file;
  int folder = -1, both = -1, colour = -1, depth = -1;  // the folder and its three lists
};

Recorder::Recorder(Setup setup) : setup_(std::move(setup)) {}
Recorder::~Recorder() = default;

Status Recorder::open() {
  const std::string& path = setup_.folder;
  const auto refused = [&](const std::string& what) {
    return Error{ExitCode::RunFailed, "--record " + path + ": " + what};
  };
  auto writer = std::make_unique<Writer>(setup_);
  if (mkdir(path.c_str(), 0755) != 0 && errno != EEXIST)
    return refused(std::string("cannot be made (") + std::strerror(errno) +
                   "); give a folder whose parent is there");
  writer->folder = ::open(path.c_str(), O_DIRECTORY | O_RDONLY | O_CLOEXEC);
  if (writer->folder < 0) return refused(std::string(std::strerror(errno)) + "; give a folder");
  constexpr const char* kTaken = "holds a log or a camera.toml already; give a new folder";
  if (faccessat(writer->folder, "camera.toml", F_OK, AT_SYMLINK_NOFOLLOW) == 0) return refused(kTaken);
  writer->both = writer->create("associations.txt");
  writer->colour = writer->create("rgb.txt");
  writer->depth = writer->create("depth.txt");
  if (writer->both < 0 || writer->colour < 0 || writer->depth < 0) {
    return refused(errno == EEXIST ? kTaken
                                   : std::string("cannot be written (") + std::strerror(errno) + ")");
  }
  for (const char* part : {"rgb", "depth"}) {
    if (mkdirat(writer->folder, part, 0755) != 0 && errno != EEXIST)
      return refused(std::string("cannot be written (") + std::strerror(errno) + ")");
  }
  const auto profile = std::as_bytes(std::span(setup_.camera_profile));
  if (!profile.empty() && !write_file(writer->folder, "camera.toml", profile))
    return refused(std::string("cannot be written (") + std::strerror(errno) + ")");
  writer_ = std::move(writer);
  return {};
}

bool Recorder::write(const FrameSlot& frame) {
  STILLMAP_CHECK(writer_ != nullptr);
  const auto seconds = [](Nanoseconds t) { return static_cast<std::int64_t>(t / kSecond); };
  const auto rest = [](Nanoseconds t) { return static_cast<std::int64_t>(t % kSecond); };
  const Nanoseconds c = frame.colour_ns, d = frame.depth_ns;
  const Line colour_stamp("%" PRId64 ".%09" PRId64, seconds(c), rest(c));
  const Line depth_stamp("%" PRId64 ".%09" PRId64, seconds(d), rest(d));
  const Line colour_name("rgb/%s.%s", colour_stamp.text(), writer_->jpeg ? "jpg" : "png");
  const Line depth_name("depth/%s.png", depth_stamp.text());
  if (!write_file(writer_->folder, colour_name.text(),
                  writer_->encode_colour(frame.colour, setup_.jpeg_quality)))
    return false;
  if (!write_file(writer_->folder, depth_name.text(), writer_->png.encode_depth(frame.depth))) return false;
  const Line both("%s %s %s %s\n", colour_stamp.text(), colour_name.text(), depth_stamp.text(),
                  depth_name.text());
  const Line colour("%s %s\n", colour_stamp.text(), colour_name.text());
  const Line depth("%s %s\n", depth_stamp.text(), depth_name.text());
  // The list that says which frames there are comes last: what stands in it is whole.
  return append_line(writer_->colour, colour.bytes()) && append_line(writer_->depth, depth.bytes()) &&
         append_line(writer_->both, both.bytes());
}

void Recorder::close() {
  if (writer_ == nullptr) return;
  syncfs(writer_->folder);
  writer_.reset();
}

}  // namespace stillmap
