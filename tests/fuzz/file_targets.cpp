// SPDX-License-Identifier: Apache-2.0
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/config.h"
#include "detect/model_file.h"
#include "drivers/tum_log/frame_list.h"
#include "eval/trajectory.h"
#include "map/map_file.h"
#include "map/occupancy_image.h"
#include "tests/fuzz/targets.h"
#include "track/keyframe_file.h"

namespace stillmap::fuzz {

namespace {

/// A file in memory, read by its name.
class MemoryFile {
 public:
  explicit MemoryFile(Bytes bytes) : file_(memfd_create("fuzz", MFD_CLOEXEC)) {
    require(file_ >= 0);
    require(::write(file_, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()));
  }
  ~MemoryFile() { ::close(file_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(file_); }

 private:
  int file_;
};

void require_error(const Error& error, const std::string& names) {
  require(!error.message.empty() && error.message.find(names) != std::string::npos);
}

/// What comes before the first NUL and after it.
std::pair<Bytes, Bytes> halves(Bytes bytes) {
  const auto nul = static_cast<std::size_t>(std::find(bytes.begin(), bytes.end(), 0) - bytes.begin());
  return {bytes.first(nul), nul < bytes.size() ? bytes.subspan(nul + 1) : Bytes{}};
}

std::string text(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// A folder that goes when the process ends.
const std::filesystem::path& folder() {
  struct Folder {
    Folder() {
      std::string name = "/dev/shm/stillmap_fuzz_XXXXXX";  // in memory: written anew for each case
      require(mkdtemp(name.data()) != nullptr);
      path = name;
    }
    ~Folder() { std::filesystem::remove_all(path); }
    std::filesystem::path path;
  };
  static const Folder made;
  return made.path;
}

void write(const char* name, Bytes bytes) {
  std::ofstream(folder() / name, std::ios::binary) << text(bytes);
}

}  // namespace

void read_config(Bytes bytes) {
  const auto [file_bytes, override_bytes] = halves(bytes);
  const MemoryFile file(file_bytes);
  const std::vector<std::string> files{file.path()};
  std::vector<std::string> overrides;
  if (!override_bytes.empty()) overrides.push_back(text(override_bytes));
  const Result<LoadedConfig> loaded = load_config(files, overrides);
  if (!loaded.ok()) {
    require(loaded.error().exit_code == ExitCode::WrongConfig);
    return require_error(loaded.error(), "");
  }
  require(!config_text(loaded.value()).empty());
}

void read_frame_list(Bytes bytes) {
  const auto [first, second] = halves(bytes);
  std::filesystem::remove(folder() / "associations.txt");
  if (second.empty()) {
    write("associations.txt", first);
  } else {
    write("rgb.txt", first);
    write("depth.txt", second);
  }
  const auto frames = stillmap::read_frame_list(folder());
  if (!frames.ok()) {
    require(frames.error().exit_code == ExitCode::UnreadableInput);
    return require_error(frames.error(), folder());
  }
  Nanoseconds latest = -1;
  for (const ListedFrame& frame : frames.value()) {
    if (frame.known_unusable) continue;
    require(frame.colour_ns > latest && !frame.colour_path.empty() && !frame.depth_path.empty());
    latest = frame.colour_ns;
  }
}

void read_trajectory(Bytes bytes) {
  const MemoryFile file(bytes);
  const auto poses = stillmap::read_trajectory(file.path());
  if (!poses.ok()) return require_error(poses.error(), file.path());
  for (const StampedPose& pose : poses.value()) require(is_finite(pose.T_world_camera));
}

void read_map(Bytes bytes) {
  std::vector<std::uint8_t> whole(bytes.begin(), bytes.end());
  if (whole.size() >= 8) {
    // A checksum keeps accidents out, not attackers.
    const std::uint64_t sum = fnv1a(whole.data(), whole.size() - 8);
    std::memcpy(whole.data() + whole.size() - 8, &sum, 8);
  }
  const MemoryFile file(whole);
  const Result<MapFile> map = read_map_file(file.path());
  if (!map.ok()) {
    require(map.error().exit_code == ExitCode::UnreadableInput);
    return require_error(map.error(), file.path());
  }
  const BlockTable& blocks = *map.value().blocks;
  require(blocks.occupied_voxels() <= kBlockVoxels * static_cast<std::size_t>(blocks.size()));
  static_cast<void>(occupancy_image(map.value(), -1, 1));
}

void read_manifest(Bytes bytes) {
  write("net.toml", bytes);
  const std::vector<std::string> overrides{"detector.model=" + (folder() / "net.onnx").string(),
                                           "camera.width=640",
                                           "camera.height=480",
                                           "camera.fx=525",
                                           "camera.fy=525",
                                           "camera.cx=319.5",
                                           "camera.cy=239.5",
                                           "camera.depth_units_per_m=5000"};
  const Result<LoadedConfig> loaded = load_config_of_model({}, overrides);
  if (!loaded.ok()) {
    require(loaded.error().exit_code == ExitCode::WrongConfig);
    return require_error(loaded.error(), "net.onnx");  // the manifest of that model
  }
  // It has said nothing but what is the model's own.
  for (const ConfigEntry& entry : loaded.value().entries) {
    if (entry.origin.ends_with("net.toml"))
      require(entry.key.starts_with("detector.") || entry.key.starts_with("classes."));
  }
}

void read_keyframes(Bytes bytes) {
  constexpr std::size_t kKeyframes = 4, kPoints = 64;
  const auto fresh = [] {
    struct Memory {
      Arena arena{1 << 20};
      LocalMap map{arena, kKeyframes, kPoints};
    };
    return std::make_unique<Memory>();
  };
  const auto first = fresh();
  const Status read = stillmap::read_keyframes(std::as_bytes(bytes), first->map);
  if (!read.ok()) {
    require(first->map.newest_keyframe() == nullptr);
    return require_error(read.error(), "");
  }
  // What was taken in can be written and read again.
  std::vector<std::byte> all, part(KeyframeWriter::kLargestRecord);
  for (KeyframeWriter writer; !writer.done(first->map);) {
    const std::size_t size = writer.write(first->map, {}, part);
    all.insert(all.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(size));
  }
  require(stillmap::read_keyframes(all, fresh()->map).ok());
  const KeyframeCounts before = count_keyframes(std::as_bytes(bytes)).value(),
                       after = count_keyframes(all).value();
  require(before.keyframes == after.keyframes && before.points == after.points);
}

}  // namespace stillmap::fuzz
