// SPDX-License-Identifier: Apache-2.0
#include "detect/model_file.h"

#include <gmock/gmock.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/support/shared_folder.h"
#include "tests/support/temporary_folder.h"

namespace stillmap {
namespace {

using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// The SHA-256 of "abc" (FIPS 180-2, appendix B.1).
constexpr const char* kAbc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

/// A folder of its own as working directory and as $STILLMAP_MODELS, both put back afterwards.
class ModelFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    before_ = std::filesystem::current_path();
    std::filesystem::create_directories(folder_ / "given");
    std::filesystem::current_path(folder_.path());
    setenv("STILLMAP_MODELS", (folder_ / "given").c_str(), 1);
  }
  void TearDown() override {
    unsetenv("STILLMAP_MODELS");
    std::filesystem::current_path(before_);
  }
  std::string write(const std::filesystem::path& name, const std::string& text) const {
    return folder_.write(name, text);
  }
  static Result<ModelFile> find(const std::string& model, const std::string& sha256 = "") {
    Config::Detector detector;
    detector.model = model;
    detector.sha256 = sha256;
    return find_model(detector);
  }
  static void expect_refused(const Result<ModelFile>& result, ExitCode code, const std::string& words) {
    ASSERT_FALSE(result.ok());
    EXPECT_EQ(result.error().exit_code, code);
    EXPECT_THAT(result.error().message, AllOf(HasSubstr(words), Not(HasSubstr("\n"))));
  }
  std::filesystem::path before_;
  test::TemporaryFolder folder_;
};

TEST_F(ModelFileTest, NoneIsNoFileAndNoWarning) {
  const Result<ModelFile> found = find("none");
  ASSERT_TRUE(found.ok());
  EXPECT_THAT(found.value().path, IsEmpty());
  EXPECT_THAT(found.value().warning, IsEmpty());
}

TEST_F(ModelFileTest, AutoWithoutAFileWarnsAndGoesOn) {
  const Result<ModelFile> found = find("auto");
  ASSERT_TRUE(found.ok()) << found.error().message;
  if (!found.value().path.empty()) GTEST_SKIP() << "the checkout has a model of its own";
  EXPECT_THAT(found.value().warning, AllOf(HasSubstr("scripts/get_model.sh"), HasSubstr(folder_ / "given")));
}

TEST_F(ModelFileTest, AutoLooksFirstWhereTheEnvironmentSays) {
  write("models/nanodet_plus_m_int8.onnx", "abc");
  EXPECT_THAT(find("auto", kAbc).value().path, EndsWith("models/nanodet_plus_m_int8.onnx"));
  write("given/nanodet_plus_m_int8.onnx", "abc");
  EXPECT_THAT(find("auto", kAbc).value().path, EndsWith("given/nanodet_plus_m_int8.onnx"));
}

TEST_F(ModelFileTest, AutoTakesOnlyTheDefaultNetwork) {
  write("given/nanodet_plus_m_int8.onnx", "abc");
  expect_refused(find("auto"), ExitCode::UnreadableInput,
                 std::string("expected ") + kDefaultModelSha256 + ", found " + kAbc);
}

TEST_F(ModelFileTest, ComparesTheChecksumWhereOneIsGiven) {
  const std::string file = write("my.onnx", "abc");
  EXPECT_EQ(find(file).value().sha256, kAbc);
  std::string upper(kAbc);
  for (char& c : upper) c = static_cast<char>(std::toupper(c));
  EXPECT_TRUE(find(file, upper).ok());
  write("my.onnx", "abd");
  expect_refused(find(file, kAbc), ExitCode::UnreadableInput, std::string("expected ") + kAbc);
}

TEST_F(ModelFileTest, RefusesWhatIsNoChecksum) {
  const std::string file = write("my.onnx", "abc");
  for (const char* bad :
       {"b38d", "sha256:b38dc42b", "zz7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"}) {
    expect_refused(find(file, bad), ExitCode::WrongConfig, "64 hex digits");
  }
}

TEST_F(ModelFileTest, RefusesWhatCannotBeRead) {
  expect_refused(find("absent.onnx"), ExitCode::UnreadableInput,
                 "'absent.onnx' cannot be read (No such file");
  expect_refused(find(folder_.path()), ExitCode::UnreadableInput, "is a folder");
  expect_refused(find("/dev/zero"), ExitCode::UnreadableInput, "or a device");
  ASSERT_EQ(mkfifo((folder_ / "pipe.onnx").c_str(), 0600), 0);
  expect_refused(find("pipe.onnx"), ExitCode::UnreadableInput, "a pipe");
  expect_refused(find(""), ExitCode::UnreadableInput, "cannot be read");
  if (geteuid() != 0) {
    const std::string file = write("locked.onnx", "abc");
    std::filesystem::permissions(file, std::filesystem::perms::none);
    expect_refused(find(file), ExitCode::UnreadableInput, "Permission denied");
  }
}

const std::vector<std::string> kCamera{STILLMAP_SOURCE_DIR "/firmware-config/cameras/tum-fr1.toml"};

/// Everything that a manifest must say, line by line.
std::vector<std::string> manifest_lines() {
  return {"decoder = 'yolox'", "sha256 = '" + std::string(kAbc) + "'",
          "input_width = 416", "input_height = 416",
          "strides = [8, 16]", "colour_order = 'rgb'",
          "mean = [0, 0, 0]",  "deviation = [1, 1, 1]"};
}
std::string manifest_text(const std::vector<std::string>& lines) {
  std::string text = "[detector]\n";
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

TEST_F(ModelFileTest, AManifestLiesBeneathWhatTheUserSays) {
  const std::string model = write("net.onnx", "abc");
  write("net.toml", manifest_text(manifest_lines()) + "pad = 9\n[classes]\nnames = ['person', 'vest']\n");
  const std::string own = write("own.toml", "[detector]\nmodel = 'net.onnx'\npad = 7\n");
  const auto loaded = load_config_of_model(std::vector{kCamera[0], own},
                                           std::vector<std::string>{"detector.input_width=320"});
  ASSERT_TRUE(loaded.ok()) << loaded.error().message;
  const Config::Detector& d = loaded.value().config.detector;
  EXPECT_EQ(d.decoder, "yolox");
  EXPECT_THAT(d.strides, testing::ElementsAre(8, 16));
  EXPECT_THAT(d.deviation, testing::ElementsAre(1, 1, 1));
  EXPECT_EQ(d.input_width, 320);
  EXPECT_EQ(d.input_height, 416);
  EXPECT_EQ(d.pad, 7);
  EXPECT_THAT(loaded.value().config.classes.names, testing::ElementsAre("person", "vest"));
  EXPECT_TRUE(find_model(d).ok());
  write("net.onnx", "abd");
  expect_refused(find_model(d), ExitCode::UnreadableInput, std::string("detector.sha256) expected ") + kAbc);
}

TEST_F(ModelFileTest, AManifestOfTheInstalledNetworkReplacesItsChecksum) {
  write("given/nanodet_plus_m_int8.onnx", "abc");
  write("given/nanodet_plus_m_int8.toml", manifest_text(manifest_lines()));
  const auto loaded = load_config_of_model(kCamera, {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().message;
  EXPECT_EQ(find_model(loaded.value().config.detector).value().sha256, kAbc);
  write("given/nanodet_plus_m_int8.toml", manifest_text(manifest_lines()) + "model = 'other.onnx'\n");
  const auto another = load_config_of_model(kCamera, {});
  ASSERT_FALSE(another.ok());
  EXPECT_THAT(another.error().message, HasSubstr("key 'detector.model' is not the model's; move it"));
}

TEST_F(ModelFileTest, WithoutAManifestItIsNanodetPlus) {
  for (const std::string& model : {write("net.onnx", "abc"), std::string("none"), std::string("auto")}) {
    const auto loaded = load_config_of_model(kCamera, std::vector<std::string>{"detector.model=" + model});
    ASSERT_TRUE(loaded.ok()) << loaded.error().message;
    EXPECT_EQ(loaded.value().config.detector.decoder, "nanodet_plus");
    EXPECT_EQ(loaded.value().config.detector.input_width, 320);
    EXPECT_EQ(loaded.value().config.classes.names.size(), 80u);
  }
}

TEST_F(ModelFileTest, RefusesAWrongManifestByKeyExpectationAndMend) {
  const std::vector<std::string> keys{"detector.model=" + write("net.onnx", "abc")};
  const auto expect = [&](const std::string& text, std::initializer_list<const char*> words) {
    const std::string manifest = write("net.toml", text);
    const auto loaded = load_config_of_model(kCamera, keys);
    ASSERT_FALSE(loaded.ok()) << text;
    EXPECT_EQ(loaded.error().exit_code, ExitCode::WrongConfig);
    EXPECT_THAT(loaded.error().message, AllOf(HasSubstr("manifest of '"), Not(HasSubstr("\n"))));
    for (const char* word : words) EXPECT_THAT(loaded.error().message, HasSubstr(word)) << text;
  };
  const std::vector<std::string> whole = manifest_lines();
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::vector<std::string> lines = whole;
    lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(i));
    const std::string key =
        "key 'detector." + whole[i].substr(0, whole[i].find(' ')) + "' is missing; expected ";
    expect(manifest_text(lines), {key.c_str(), "net.toml", "firmware-config/models"});
  }
  const std::string text = manifest_text(whole);
  expect(text + "pad = 300", {"net.toml", "detector.pad", "from 0 to 255 grey levels"});
  expect(text + "anchors = 3", {"net.toml", "unknown key 'detector.anchors'"});
  expect(text + "[track]\nfeatures = 500", {"net.toml", "track.features", "move it"});
  expect("decoder = ", {"net.toml:1", "not valid TOML"});
  std::vector<std::string> lines = whole;
  lines[0] = "decoder = 'yolo'";
  expect(manifest_text(lines), {"detector.decoder", "yolov5", "net.onnx"});
  lines = whole;
  lines[1] = "sha256 = ''";
  expect(manifest_text(lines), {"detector.sha256", "is missing"});
}

TEST_F(ModelFileTest, KnowsTheDefaultNetwork) {
  STILLMAP_NEEDS_SHARED();
  const std::filesystem::path real = test::shared_folder() / "models/nanodet_plus_m";
  setenv("STILLMAP_MODELS", real.c_str(), 1);
  const Result<ModelFile> found = find("auto");
  ASSERT_TRUE(found.ok()) << found.error().message;
  EXPECT_EQ(found.value().path, real / kDefaultModelName);
  EXPECT_EQ(found.value().sha256, kDefaultModelSha256);
}

}  // namespace
}  // namespace stillmap
