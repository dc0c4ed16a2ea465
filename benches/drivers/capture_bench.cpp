// SPDX-License-Identifier: Apache-2.0
// What a driver does with a picture pair of 640x480 on the capturing thread, beside the least that could be
// done: copying the bytes. And what the recorder does with one.
#include <benchmark/benchmark.h>

#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "core/jpeg.h"
#include "drivers/paired/registration.h"
#include "drivers/pictures/raw_picture.h"
#include "drivers/recorder/recorder.h"

namespace stillmap {
namespace {

constexpr int kWidth = 640, kHeight = 480;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;

/// A room's worth of smooth surfaces with steps and holes between them, and a little noise.
struct Room {
  Room() : colour(kPixels), depth(kPixels) {
    std::uint32_t noise = 1;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        noise = noise * 1664525 + 1013904223;
        const int grain = static_cast<int>(noise >> 28), step = (x / 90 + y / 110) % 4;
        const auto at = static_cast<std::size_t>(y * kWidth + x);
        colour[at] = {static_cast<std::uint8_t>(x / 4 + grain), static_cast<std::uint8_t>(60 * step + grain),
                      static_cast<std::uint8_t>(y / 3 + grain)};
        depth[at] = static_cast<std::uint16_t>(x % 90 < 6 ? 0 : 1200 + 700 * step + y / 2 + grain);
      }
    }
  }
  ImageView<const Bgr> picture() const { return {colour.data(), kWidth, kHeight, kWidth}; }
  ImageView<const std::uint16_t> readings() const { return {depth.data(), kWidth, kHeight, kWidth}; }
  std::vector<Bgr> colour;
  std::vector<std::uint16_t> depth;
};

CameraModel camera(double f, double k1) {
  CameraModel c;
  c.width = kWidth, c.height = kHeight;
  c.fx = c.fy = f;
  c.cx = kWidth / 2.0, c.cy = kHeight / 2.0;
  c.k1 = k1, c.k2 = -k1 / 2, c.p1 = 0.001, c.p2 = -0.001;
  return c;
}

void register_depth(benchmark::State& state) {
  const Room room;
  DepthRegistration registration(camera(615, 0.12), camera(385, 0.02), Pose{{}, {0.015, 0, 0}});
  std::vector<std::uint16_t> into(kPixels);
  for (auto _ : state) registration.apply(room.readings(), {into.data(), kWidth, kHeight, kWidth});
}
void copy_depth_baseline(benchmark::State& state) {
  const Room room;
  std::vector<std::uint16_t> into(kPixels);
  for (auto _ : state) {
    std::memcpy(into.data(), room.depth.data(), kPixels * sizeof into[0]);
    benchmark::ClobberMemory();
  }
}

void convert(benchmark::State& state, PixelFormat format, std::size_t stride) {
  const Room room;
  std::vector<std::byte> bytes(kPixels * 3);
  std::memcpy(bytes.data(), room.colour.data(), bytes.size());
  std::size_t used = bytes.size();
  if (format == PixelFormat::Mjpg) {
    JpegEncoder encoder(Scratch(JpegEncoder::memory_bytes(kWidth)), kWidth, kHeight);
    used = encoder.encode(room.picture(), 90, bytes);
  }
  const RawPicture raw{format, kWidth, kHeight, {{{bytes.data(), used, stride}}}};
  ColourConverter converter(format, kWidth, kHeight);
  std::vector<Bgr> into(kPixels);
  for (auto _ : state) {
    if (converter.convert(raw, {into.data(), kWidth, kHeight, kWidth}) != DecodeStatus::Ok)
      state.SkipWithError("not converted");
  }
}
void colour_yuyv(benchmark::State& state) {
  convert(state, PixelFormat::Yuyv, 2 * kWidth);
}
void colour_nv12(benchmark::State& state) {
  convert(state, PixelFormat::Nv12, kWidth);
}
void colour_rgb3(benchmark::State& state) {
  convert(state, PixelFormat::Rgb, 3 * kWidth);
}
void colour_mjpg(benchmark::State& state) {
  convert(state, PixelFormat::Mjpg, 0);
}
void colour_bgr3_baseline_copy(benchmark::State& state) {
  convert(state, PixelFormat::Bgr, 3 * kWidth);
}

void record(benchmark::State& state, bool exact_colour) {
  Room room;
  const std::filesystem::path folder = "/dev/shm/stillmap-capture-bench";
  std::filesystem::remove_all(folder);
  Recorder recorder({.folder = folder.string(),
                     .width = kWidth,
                     .height = kHeight,
                     .exact_colour = exact_colour,
                     .camera_profile = ""});
  if (!recorder.open().ok()) return state.SkipWithError("cannot record into /dev/shm");
  FrameSlot slot;
  slot.colour = {room.colour.data(), kWidth, kHeight, kWidth};
  slot.depth = {room.depth.data(), kWidth, kHeight, kWidth};
  for (auto _ : state) {
    // The same names over and over, so that the folder stays small.
    if (!recorder.write(slot)) state.SkipWithError("not written");
  }
  recorder.close();
  std::filesystem::remove_all(folder);
}
void record_jpeg(benchmark::State& state) {
  record(state, false);
}
void record_png(benchmark::State& state) {
  record(state, true);
}

BENCHMARK(register_depth)->Unit(benchmark::kMicrosecond);
BENCHMARK(copy_depth_baseline)->Unit(benchmark::kMicrosecond);
BENCHMARK(colour_yuyv)->Unit(benchmark::kMicrosecond);
BENCHMARK(colour_nv12)->Unit(benchmark::kMicrosecond);
BENCHMARK(colour_rgb3)->Unit(benchmark::kMicrosecond);
BENCHMARK(colour_mjpg)->Unit(benchmark::kMicrosecond);
BENCHMARK(colour_bgr3_baseline_copy)->Unit(benchmark::kMicrosecond);
BENCHMARK(record_jpeg)->Unit(benchmark::kMicrosecond);
BENCHMARK(record_png)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace stillmap
