// SPDX-License-Identifier: Apache-2.0
// Tracks a recorded log and prints each pose: Stillmap's tracker inside another program.
//
//   example CAMERA.toml LOG_FOLDER
#include <cstdio>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/frame_pool.h"
#include "runtime/source.h"
#include "track/tracker.h"

namespace {

int refuse(const stillmap::Error& error) {
  std::fprintf(stderr, "example: %s\n", error.message.c_str());
  return static_cast<int>(error.exit_code);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return refuse({stillmap::ExitCode::WrongConfig, "usage: example CAMERA.toml LOG_FOLDER"});
  const auto loaded = stillmap::load_config(std::vector<std::string>{argv[1]}, {});
  if (!loaded.ok()) return refuse(loaded.error());
  const stillmap::Config& config = loaded.value().config;

  auto source = stillmap::open_source("tum:" + std::string(argv[2]), config, 1);
  if (!source.ok()) return refuse(source.error());
  stillmap::RgbdDriver& driver = *source.value().driver;
  if (const auto started = driver.start(); !started.ok()) return refuse(started.error());

  // All memory is taken here, as much as a rehearsal asks for: nothing below asks the heap for any.
  stillmap::Arena rehearsal;
  static_cast<void>(stillmap::FramePool(rehearsal, 2, config.camera.width, config.camera.height));
  static_cast<void>(stillmap::Tracker(rehearsal, config));
  stillmap::Arena arena(rehearsal.bytes_planned());
  stillmap::FramePool frames(arena, 2, config.camera.width, config.camera.height);
  stillmap::Tracker tracker(arena, config);
  const stillmap::DynamicMask nothing_moves;

  for (std::uint64_t sequence = 0;;) {
    stillmap::FrameHandle handle = frames.acquire();
    stillmap::FrameSlot& frame = handle.writable();
    const stillmap::GrabResult grabbed = driver.grab(frame, stillmap::monotonic_now() + 1'000'000'000);
    if (grabbed.status == stillmap::GrabStatus::EndOfStream) return 0;
    if (grabbed.status != stillmap::GrabStatus::Frame) continue;
    frame.sequence = sequence++;

    const stillmap::TrackingResult& result = tracker.track(frame, nothing_moves);
    // Keyframes are adjusted and loops closed beside tracking. Another thread may do it; a robot's should.
    tracker.adjustment().work();
    tracker.loops().work();
    if (!result.has_pose()) continue;
    const stillmap::Vec3 t = result.T_map_camera().t;
    std::printf("%.6f %8.4f %8.4f %8.4f\n", stillmap::to_seconds(frame.colour_ns), t.x, t.y, t.z);
  }
}
