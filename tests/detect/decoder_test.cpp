// SPDX-License-Identifier: Apache-2.0
#include "detect/decoder.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <set>

namespace stillmap {
namespace {

/// The shipped manifests hold one of each family, and all that a manifest must say but the checksum.
TEST(MakeDecoder, KnowsWhatTheShippedManifestsName) {
  std::set<std::string> names;
  for (const auto& entry :
       std::filesystem::directory_iterator(STILLMAP_SOURCE_DIR "/firmware-config/models")) {
    const std::vector<std::string> files{STILLMAP_SOURCE_DIR "/firmware-config/cameras/tum-fr1.toml",
                                         entry.path()};
    const auto loaded = load_config(files, {});
    ASSERT_TRUE(loaded.ok()) << loaded.error().message;
    const Config::Detector& d = loaded.value().config.detector;
    names.insert(d.decoder);
    EXPECT_NE(make_decoder(d.decoder, {80, d.input_width, d.input_height, d.strides, 0.35}), nullptr);
    EXPECT_FALSE(d.strides.empty()) << entry.path();
  }
  EXPECT_THAT(names, testing::ElementsAre("nanodet", "nanodet_plus", "yolov5", "yolov8", "yolox"));
}

TEST(ChooseFlat, CountsCellsByRoundingUp) {
  const DecoderSetup setup{80, 416, 416, {8, 16, 32, 64}, 0.35};
  EXPECT_EQ(count_cells(setup), 3598u);  // as published for NanoDet-Plus at 416 x 416
  EXPECT_EQ(grid_of(setup, 64).columns, 7u);
}

}  // namespace
}  // namespace stillmap
