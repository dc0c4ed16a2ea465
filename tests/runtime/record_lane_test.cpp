// SPDX-License-Identifier: Apache-2.0
#include "runtime/record_lane.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

TEST(RecordLane, ALogsProfileIsItsCamerasWithoutTheDepthCameraAndWithoutWhatIsUnknown) {
  const auto entry = [](const char* key, const char* value) { return ConfigEntry{key, value, "", "", ""}; };
  LoadedConfig loaded;
  loaded.entries = {entry("camera.fx", "525"),         entry("camera.readout_s", "(unknown)"),
                    entry("camera.depth.width", "64"), entry("camera.depth_units_per_m", "1000"),
                    entry("map.voxel_m", "0.04"),      entry("camera.name", "\"mine\"")};
  EXPECT_EQ(recorded_profile(loaded),
            "# The camera of this log, as it was set when it was recorded.\ncamera.fx = 525\n"
            "camera.depth_units_per_m = 1000\ncamera.name = \"mine\"\n");
}

}  // namespace
}  // namespace stillmap
