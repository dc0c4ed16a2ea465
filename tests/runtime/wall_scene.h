// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "core/config.h"
#include "core/frame_pool.h"
#include "core/random.h"

namespace stillmap::test {

/// A camera that moves sideways along a patterned wall at 2 m, and a blue thing at 1 m that goes its own way.
/// Cheap to draw, and easy to track.
class WallScene {
 public:
  static constexpr int kWidth = 320, kHeight = 240, kStep_px = 2;
  static constexpr double kFocal_px = 300, kWall_m = 2, kThing_m = 1;
  static constexpr Nanoseconds kFrame_ns = 33'333'333;

  WallScene() : wall_(kWallWidth * kHeight) {
    Random random(11);
    for (int y = 0; y < kHeight; y += kTile) {
      for (int x = 0; x < kWallWidth; x += kTile) {
        const auto grey = static_cast<std::uint8_t>(random.below(256));
        for (int i = 0; i < kTile * kTile; ++i) at(x + i % kTile, y + i / kTile) = {0, grey, grey};
      }
    }
  }

  static Nanoseconds stamp_ns(int index) { return 1'000'000'000 + index * kFrame_ns; }
  /// Where the camera is in its first frame.
  static Pose T_first_camera(int index) { return {{}, {index * kStep_px * kWall_m / kFocal_px, 0, 0}}; }
  /// Where the thing is in the picture; 60 px wide and 120 px high.
  static Box thing(int index) {
    const auto x = static_cast<float>(40 + index % 100 * 2);
    return {x, 80, x + 60, 200};
  }

  void draw(int index, FrameSlot& slot) const {
    slot.colour_ns = slot.depth_ns = stamp_ns(index);
    const Box b = thing(index);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const bool on_thing = b.contains(x, y);
        slot.colour.at(x, y) = on_thing ? Bgr{255, 0, 0} : wall(x + index * kStep_px, y);
        slot.depth.at(x, y) = static_cast<std::uint16_t>(1000 * (on_thing ? kThing_m : kWall_m));
      }
    }
  }

  static Config config() {
    const auto loaded =
        load_config({}, std::vector<std::string>{
                            "camera.width=320", "camera.height=240", "camera.fx=300", "camera.fy=300",
                            "camera.cx=159.5", "camera.cy=119.5", "camera.depth_units_per_m=1000",
                            "detector.model=none", "detector.input_width=320", "detector.input_height=256",
                            "classes.names=['blue']", "classes.dynamic=['blue']", "classes.semi_static=[]",
                            "classes.static=[]", "map.capacity_voxels=200000", "stream.listen=off"});
    return loaded.value().config;
  }

 private:
  static constexpr int kWallWidth = 4096, kTile = 8;
  Bgr& at(int x, int y) { return wall_[static_cast<std::size_t>(y * kWallWidth + x)]; }
  Bgr wall(int x, int y) const { return wall_[static_cast<std::size_t>(y * kWallWidth + x % kWallWidth)]; }
  std::vector<Bgr> wall_;
};

}  // namespace stillmap::test
