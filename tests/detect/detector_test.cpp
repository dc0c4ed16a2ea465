// SPDX-License-Identifier: Apache-2.0
#include "detect/detector.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "detect/model_file.h"
#include "tests/detect/tiny_onnx.h"
#include "tests/support/read_image.h"
#include "tests/support/shared_folder.h"
#include "tests/support/temporary_folder.h"

namespace stillmap {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

Config config_of(int width, int height) {
  const auto key = [](const char* name, int value) {
    return "camera." + std::string(name) + "=" + std::to_string(value);
  };
  const std::vector<std::string> keys{key("width", width),
                                      key("height", height),
                                      key("fx", 500),
                                      key("fy", 500),
                                      key("cx", width / 2),
                                      key("cy", height / 2),
                                      key("depth_units_per_m", 1000)};
  return load_config({}, keys).value().config;
}

FrameSlot frame_of(const test::Image<Bgr>& colour) {
  FrameSlot frame;
  frame.sequence = 41;
  frame.colour_ns = 12345;
  // The detector only reads; a frame's own view is writable because drivers fill it.
  frame.colour = {const_cast<Bgr*>(colour.pixels.data()), colour.width, colour.height, colour.width};
  return frame;
}

class DetectorTest : public ::testing::Test {
 protected:
  std::string write(const std::string& bytes) const { return folder_.write("net.onnx", bytes); }
  static Result<std::unique_ptr<Detector>> open(const Config& config, const std::string& path) {
    const Result<ModelFile> model = read_model(path);
    if (!model.ok()) return model.error();
    return Detector::open(config, model.value());
  }
  static void expect_refused(const Config& config, const std::string& path, ExitCode code,
                             const std::string& words) {
    const auto opened = open(config, path);
    ASSERT_FALSE(opened.ok());
    EXPECT_EQ(opened.error().exit_code, code);
    EXPECT_THAT(opened.error().message, AllOf(HasSubstr(words), Not(HasSubstr("\n"))));
  }
  test::TemporaryFolder folder_;
};

/// Two classes at stride 8. Blue squares are of class 0, red ones of class 1, each with a box of one stride
/// around its corner; what is blue is 2.7 after normalisation, red 2.2, black about -2.
test::TinyOnnx blue_and_red(int class_count = 2, int distance_planes = 32) {
  test::TinyOnnx net(256, 320);
  std::vector<float> class_bias(static_cast<std::size_t>(class_count), -30.f),
      class_weight(class_bias.size() * 3, 0.f);
  class_bias[0] = class_bias[1] = -5;
  class_weight[0] = 3;      // class 0, blue
  class_weight[3 + 2] = 3;  // class 1, red
  net.add_output("cls_8", class_count, 8, class_bias, class_weight);
  std::vector<float> bins(static_cast<std::size_t>(distance_planes), -20.f);
  for (std::size_t side = 0; side < 4; ++side) bins[side * 8 + 1] = 20;
  net.add_output("reg_8", distance_planes, 8, bins, std::vector<float>(bins.size() * 3, 0.f));
  return net;
}

Config two_classes(int width = 640, int height = 480) {
  Config config = config_of(width, height);
  config.classes = {{"blue", "red"}, {"blue"}, {"red"}, {}};
  return config;
}

TEST_F(DetectorTest, FindsColouredSquaresWhereTheyAre) {
  const auto opened = open(two_classes(), write(blue_and_red().bytes()));
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  Detector& detector = *opened.value();
  EXPECT_THAT(detector.class_warnings(), IsEmpty());

  // One cell is 16 px of the picture; the bar above the picture is 8 px of the input, so one cell.
  test::Image<Bgr> colour(640, 480);
  for (int y = 160; y < 176; ++y) {
    for (int x = 320; x < 336; ++x) colour.view().at(x, y) = {255, 0, 0};
    for (int x = 48; x < 64; ++x) colour.view().at(x, y) = {0, 0, 255};
  }
  Detections found;
  ASSERT_TRUE(detector.run(frame_of(colour), found));
  EXPECT_EQ(found.sequence, 41u);
  EXPECT_EQ(found.stamp_ns, 12345);
  ASSERT_EQ(found.items.size(), 2u);
  const Detection& blue = found.items[0];
  EXPECT_EQ(blue.class_id, 0);
  EXPECT_EQ(blue.kind, ClassKind::Dynamic);
  EXPECT_NEAR(blue.box.x0, 304, 0.1);
  EXPECT_NEAR(blue.box.y0, 144, 0.1);
  EXPECT_NEAR(blue.box.x1, 336, 0.1);
  EXPECT_NEAR(blue.box.y1, 176, 0.1);
  EXPECT_EQ(found.items[1].class_id, 1);
  EXPECT_EQ(found.items[1].kind, ClassKind::SemiStatic);
  EXPECT_NEAR(found.items[1].box.x0, 32, 0.1);

  ASSERT_TRUE(detector.run(frame_of(test::Image<Bgr>(640, 480)), found));
  EXPECT_TRUE(found.items.empty()) << "nothing of the picture before stays";
}

TEST_F(DetectorTest, ReadsPicturesThatArePartOfWiderRows) {
  const auto opened = open(two_classes(), write(blue_and_red().bytes()));
  ASSERT_TRUE(opened.ok());
  test::Image<Bgr> colour(700, 480);
  for (int y = 160; y < 176; ++y) std::fill_n(colour.view().row(y) + 320, 16, Bgr{255, 0, 0});
  FrameSlot frame = frame_of(colour);
  frame.colour.width = 640;
  Detections found;
  ASSERT_TRUE(opened.value()->run(frame, found));
  ASSERT_EQ(found.items.size(), 1u);
  EXPECT_NEAR(found.items[0].box.y1, 176, 0.1);
}

TEST_F(DetectorTest, WarnsOfClassesThatTheModelDoesNotKnow) {
  Config config = two_classes();
  config.classes.dynamic.push_back("person");
  const auto opened = open(config, write(blue_and_red().bytes()));
  ASSERT_TRUE(opened.ok());
  EXPECT_THAT(opened.value()->class_warnings(), HasSubstr("'person'"));
}

TEST_F(DetectorTest, RefusesAnotherNumberOfClasses) {
  expect_refused(two_classes(), write(blue_and_red(3).bytes()), ExitCode::WrongConfig,
                 "classes.names: 2 names, but '" + folder_ / "net.onnx" + "' knows 3 classes");
}

TEST_F(DetectorTest, RefusesOutputsOfAnotherKind) {
  expect_refused(two_classes(), write(blue_and_red(2, 35).bytes()), ExitCode::UnreadableInput, "wrong shape");
  test::TinyOnnx half(256, 320);
  half.add_output("cls_8", 2, 8, {0, 0}, std::vector<float>(6));
  expect_refused(two_classes(), write(half.bytes()), ExitCode::UnreadableInput, "only one of cls_ and reg_");
  test::TinyOnnx other(256, 320);
  other.add_output("boxes", 2, 8, {0, 0}, std::vector<float>(6));
  expect_refused(two_classes(), write(other.bytes()), ExitCode::UnreadableInput, "has no outputs cls_8");
}

TEST_F(DetectorTest, RefusesFilesThatAreNoNetwork) {
  const Config config = config_of(640, 480);
  expect_refused(config, write("This is not a network.\n"), ExitCode::UnreadableInput,
                 "no network that can be run");
  expect_refused(config, write(""), ExitCode::UnreadableInput, "scripts/get_model.sh");
  expect_refused(config, "/nonexistent/net.onnx", ExitCode::UnreadableInput, "/nonexistent/net.onnx");
  const std::string whole = blue_and_red().bytes();
  for (std::size_t size = 1; size < whole.size(); size += 97) {
    EXPECT_FALSE(open(two_classes(), write(whole.substr(0, size))).ok()) << size;
  }
}

/// A float network as YOLOv8's export writes it, at 64 px a cell: class 0 is as sure as the cell is red.
test::TinyOnnx yolo_of_red() {
  test::TinyOnnx net(256, 320);
  std::vector<float> weight(6 * 3, 0.f);
  weight[4 * 3] = 1;  // the first plane
  net.add_output("output0", 6, 64, {160, 128, 40, 20, 0, 0}, weight, {1, 6, 20});
  return net;
}

constexpr const char* kYoloManifest = R"([detector]
decoder = "yolov8"
sha256 = "%"
input_width = 320
input_height = 256
strides = [64]
colour_order = "rgb"
mean = [0, 0, 0]
deviation = [255, 255, 255]
pad = 114
[classes]
names = ["person", "cat"]
)";

TEST_F(DetectorTest, AManifestTellsWhatTheNetworkIs) {
  const std::string bytes = yolo_of_red().bytes(), path = write(bytes);
  std::string manifest = kYoloManifest;
  manifest.replace(manifest.find('%'), 1, sha256_of(bytes));
  folder_.write("net.toml", manifest);
  const std::vector<std::string> files{STILLMAP_SOURCE_DIR "/firmware-config/cameras/tum-fr1.toml"};
  const std::vector<std::string> keys{"detector.model=" + path};
  const auto loaded = load_config_of_model(files, keys);
  ASSERT_TRUE(loaded.ok()) << loaded.error().message;
  const Config& config = loaded.value().config;
  ASSERT_TRUE(find_model(config.detector).ok());
  const auto opened = open(config, path);
  ASSERT_TRUE(opened.ok()) << opened.error().message;

  test::Image<Bgr> colour(640, 480);
  Detections found;
  ASSERT_TRUE(opened.value()->run(frame_of(colour), found));
  EXPECT_TRUE(found.items.empty()) << "the bars' grey, 114 of 255 in 8 of 64 rows, makes no object";
  for (int y = 112; y < 240; ++y) std::fill_n(colour.view().row(y) + 256, 128, Bgr{40, 0, 204});
  ASSERT_TRUE(opened.value()->run(frame_of(colour), found));
  ASSERT_EQ(found.items.size(), 1u);
  EXPECT_EQ(found.items[0].class_id, 0);
  EXPECT_EQ(found.items[0].kind, ClassKind::Dynamic);
  EXPECT_NEAR(found.items[0].score, 0.8, 0.01);
  EXPECT_NEAR(found.items[0].box.x0, 280, 0.1);
  EXPECT_NEAR(found.items[0].box.y0, 220, 0.1);
  EXPECT_NEAR(found.items[0].box.x1, 360, 0.1);
  EXPECT_NEAR(found.items[0].box.y1, 260, 0.1);
}

TEST_F(DetectorTest, RunsWhatWasVerifiedWhateverBecomesOfTheFile) {
  const std::string bytes = blue_and_red().bytes();
  Config config = two_classes();
  config.detector.model = write(bytes);
  config.detector.sha256 = sha256_of(bytes);
  const Result<ModelFile> model = find_model(config.detector);
  ASSERT_TRUE(model.ok()) << model.error().message;
  write("This is not a network.\n");
  const auto opened = Detector::open(config, model.value());
  EXPECT_TRUE(opened.ok()) << opened.error().message;
}

TEST_F(DetectorTest, RefusesANetworkThatIsNotAsTheManifestSays) {
  const std::string path = write(yolo_of_red().bytes());
  Config config = two_classes();
  config.detector.decoder = "yolov8";
  config.detector.strides = {64};
  EXPECT_TRUE(open(config, path).ok());
  config.detector.decoder = "yolox";
  expect_refused(config, path, ExitCode::UnreadableInput, "has no output [1, 20, 7], but [1, 6, 20]");
  expect_refused(config, path, ExitCode::UnreadableInput, "say in '" + folder_ / "net.toml" + "'");
  config.detector.decoder = "yolov8";
  config.detector.strides = {32, 64};
  expect_refused(config, path, ExitCode::UnreadableInput, "has no output [1, 6, 100], but [1, 6, 20]");
  config.detector.strides = {64};
  config.classes.names.push_back("green");
  expect_refused(config, path, ExitCode::WrongConfig, "classes.names: 3 names, but");
}

std::filesystem::path real_model() {
  return test::shared_folder() / "models/nanodet_plus_m/nanodet_plus_m_int8.onnx";
}

TEST_F(DetectorTest, RefusesATornDownloadOfTheRealNetwork) {
  STILLMAP_NEEDS_SHARED();
  std::ifstream in(real_model(), std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  for (const double share : {0.1, 0.5, 0.9, 0.999}) {
    const auto size = static_cast<std::size_t>(share * static_cast<double>(bytes.size()));
    EXPECT_FALSE(open(config_of(640, 480), write(bytes.substr(0, size))).ok()) << share;
  }
}

TEST_F(DetectorTest, RefusesTheRealNetworkWithTheClassesOfAnother) {
  STILLMAP_NEEDS_SHARED();
  expect_refused(two_classes(), real_model(), ExitCode::WrongConfig,
                 "add --config with the class file of this model");
}

/// The share of the walkers' pixels that lie in a person's box.
TEST_F(DetectorTest, RealNetworkCoversTheWalker) {
  STILLMAP_NEEDS_SHARED();
  const Config config = config_of(640, 480);
  const auto opened = open(config, real_model());
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  const std::filesystem::path folder = test::shared_folder() / "data/fr1_rpy_walkers";
  const std::string stamp = "1305031240.029620";
  const test::Image<Bgr> colour = test::read_colour(folder / "rgb" / (stamp + ".jpg"));
  const test::Image<std::uint8_t> truth = test::read_grey(folder / "mask" / (stamp + ".png"));
  Detections first, second;
  ASSERT_TRUE(opened.value()->run(frame_of(colour), first));
  int walker = 0, covered = 0;
  for (int y = 0; y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      if (truth.view().at(x, y) == 0) continue;
      ++walker;
      covered += std::any_of(first.items.begin(), first.items.end(), [&](const Detection& d) {
        return config.classes.names[d.class_id] == "person" && d.box.contains(x, y);
      });
    }
  }
  ASSERT_GT(walker, 5000);
  EXPECT_GT(covered, walker * 9 / 10);
  ASSERT_TRUE(opened.value()->run(frame_of(colour), second));
  ASSERT_EQ(second.items.size(), first.items.size());
  for (std::size_t i = 0; i < first.items.size(); ++i) EXPECT_EQ(second.items[i].score, first.items[i].score);
}

}  // namespace
}  // namespace stillmap
