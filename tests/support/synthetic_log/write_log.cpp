// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cinttypes>
#include <cstdio>
#include <fstream>
#include <future>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "core/jpeg.h"
#include "tests/support/synthetic_log/image_files.h"
#include "tests/support/synthetic_log/synthetic_log.h"

namespace stillmap::synthetic {

namespace {

namespace fs = std::filesystem;

Error cannot_write(const fs::path& what) {
  return {ExitCode::RunFailed,
          "cannot write " + what.string() + ": give --out a folder with free space that you may write to"};
}

std::string stamp_text(Nanoseconds stamp_ns) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%" PRId64 ".%06" PRId64, stamp_ns / 1'000'000'000,
                stamp_ns % 1'000'000'000 / 1000);
  return text.data();
}

std::string pose_text(const Pose& T) {
  const Quaternion q = quaternion_from(T.R);
  std::array<char, 200> text{};
  std::snprintf(text.data(), text.size(), "%.7f %.7f %.7f %.8f %.8f %.8f %.8f", T.t.x, T.t.y, T.t.z, q.x, q.y,
                q.z, q.w);
  return text.data();
}

bool write_bytes(const fs::path& file, std::span<const char> bytes) {
  std::ofstream out(file, std::ios::binary);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.flush();
  return out.good();
}

std::string ground_truth(const SyntheticLog& log) {
  constexpr Nanoseconds kStep_ns = 10'000'000;
  std::string text =
      "# ground truth trajectory of a synthetic log, camera to world (z up)\n# timestamp tx ty tz qx qy qz "
      "qw\n";
  const Nanoseconds last_ns = log.stamp_ns(log.options().frames) + kStep_ns;
  for (Nanoseconds t = log.stamp_ns(0) - kStep_ns; t <= last_ns; t += kStep_ns) {
    text += stamp_text(t) + " " + pose_text(log.T_world_camera(t)) + "\n";
  }
  return text;
}

struct FrameFiles {
  std::string stamp, rgb, depth;
};

FrameFiles files_of(Nanoseconds stamp_ns) {
  const std::string stamp = stamp_text(stamp_ns);
  return {stamp, "rgb/" + stamp + ".jpg", "depth/" + stamp + ".png"};
}

/// Renders and writes each `step`-th frame from `first` on.
Status write_frames(const SyntheticOptions& options, const fs::path& folder, int first, int step) {
  SyntheticLog log(options);
  const CameraModel camera = SyntheticLog::camera();
  std::vector<char> jpeg(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height) *
                         3);
  JpegEncoder encoder(Scratch(JpegEncoder::memory_bytes(camera.width)), camera.width, camera.height);
  SyntheticFrame frame;
  for (int i = first; i < options.frames; i += step) {
    log.render(i, frame);
    const FrameFiles files = files_of(frame.stamp_ns);
    const auto view = [&](const auto& pixels) {
      return ImageView<const std::decay_t<decltype(pixels[0])>>{pixels.data(), camera.width, camera.height,
                                                                camera.width};
    };
    const std::size_t bytes = encoder.encode(view(frame.colour), 94, std::as_writable_bytes(std::span(jpeg)));
    if (bytes == 0 || !write_bytes(folder / files.rgb, std::span(jpeg).first(bytes)))
      return cannot_write(folder / files.rgb);
    if (!write_png_grey16(folder / files.depth, view(frame.depth))) return cannot_write(folder / files.depth);
    const fs::path mask_file = folder / "mask" / (files.stamp + ".png");
    if (!write_png_grey8(mask_file, view(frame.mask))) return cannot_write(mask_file);
  }
  return {};
}

}  // namespace

Status write_synthetic_log(const SyntheticOptions& options, const fs::path& folder) {
  std::error_code error;
  for (const char* part : {"rgb", "depth", "mask"}) {
    fs::create_directories(folder / part, error);
    if (error) return cannot_write(folder / part);
  }
  if (!fs::is_empty(folder / "rgb", error)) {
    return Error{ExitCode::WrongConfig, folder.string() + " holds a log already: give --out a new folder"};
  }

  // Each thread paints the room's materials for itself, which takes as long as a few frames.
  const int threads =
      std::clamp(options.frames / 8, 1, std::max(1, static_cast<int>(std::thread::hardware_concurrency())));
  std::vector<std::future<Status>> parts;
  for (int i = 0; i < threads; ++i)
    parts.push_back(std::async(std::launch::async, write_frames, options, folder, i, threads));
  for (std::future<Status>& part : parts) {
    if (const Status written = part.get(); !written.ok()) return written;
  }

  const SyntheticLog log(options);
  std::string rgb = "# color images\n# timestamp filename\n", depth = "# depth maps\n# timestamp filename\n",
              associations;
  for (int i = 0; i < options.frames; ++i) {
    const FrameFiles files = files_of(log.stamp_ns(i));
    rgb += files.stamp + " " + files.rgb + "\n";
    depth += files.stamp + " " + files.depth + "\n";
    associations += files.stamp + " " + files.rgb + " " + files.stamp + " " + files.depth + "\n";
  }
  const std::array<std::pair<const char*, std::string>, 4> texts{{{"rgb.txt", rgb},
                                                                  {"depth.txt", depth},
                                                                  {"associations.txt", associations},
                                                                  {"groundtruth.txt", ground_truth(log)}}};
  for (const auto& [name, text] : texts) {
    if (!write_bytes(folder / name, text)) return cannot_write(folder / name);
  }
  return {};
}

}  // namespace stillmap::synthetic
