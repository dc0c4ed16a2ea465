// SPDX-License-Identifier: Apache-2.0
#include "core/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "tests/support/temporary_folder.h"

namespace stillmap {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::string kCamera = STILLMAP_SOURCE_DIR "/firmware-config/cameras/tum-fr1.toml";

class ConfigFiles : public testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& text) { return folder_.write(name, text); }
  static Result<LoadedConfig> load(std::vector<std::string> files, std::vector<std::string> sets = {}) {
    files.insert(files.begin(), kCamera);
    return load_config(files, sets);
  }
  static Config config(std::vector<std::string> files, std::vector<std::string> sets = {}) {
    const auto loaded = load(std::move(files), std::move(sets));
    EXPECT_TRUE(loaded.ok()) << loaded.error().message;
    return loaded.ok() ? loaded.value().config : Config{};
  }
  static std::string error(std::vector<std::string> files, std::vector<std::string> sets = {}) {
    const auto loaded = load(std::move(files), std::move(sets));
    EXPECT_FALSE(loaded.ok());
    return loaded.ok() ? "" : loaded.error().message;
  }
  static ConfigEntry entry(const LoadedConfig& loaded, const std::string& key) {
    const auto found = std::find_if(loaded.entries.begin(), loaded.entries.end(),
                                    [&](const ConfigEntry& e) { return e.key == key; });
    EXPECT_NE(found, loaded.entries.end()) << key;
    return found == loaded.entries.end() ? ConfigEntry{} : *found;
  }
  test::TemporaryFolder folder_;
};

TEST_F(ConfigFiles, ACameraIsDescribedWhereOneOfItsOwnKeysIsSet) {
  const std::string board = STILLMAP_SOURCE_DIR "/firmware-config/boards/raspberry-pi-4.toml";
  const auto describes = [](std::vector<std::string> files) { return describes_camera(files); };
  EXPECT_FALSE(describes({}));
  EXPECT_FALSE(describes({board}));
  EXPECT_FALSE(describes({board, write("robot.toml", "[camera]\nstall_s = 2\n")}));
  EXPECT_FALSE(describes({write("broken.toml", "[camera\n"), folder_.path(), "/no/such/file"}));
  EXPECT_TRUE(describes({kCamera, board}));
  EXPECT_TRUE(describes({board, write("part.toml", "[camera]\nfx = 500\n")}));
}

TEST_F(ConfigFiles, LaterFilesOverrideEarlierOnesAndSetOverridesAll) {
  const std::string a = write("a.toml", "[track]\nfeatures = 500\nlevels = 4\n[map]\nvoxel_m = 0.1\n");
  const std::string b = write("b.toml", "[track]\nfeatures = 600\n[map]\nvoxel_m = 0.2\n");
  const Config c = config({a, b}, {"map.voxel_m=0.3", "map.voxel_m=0.35"});
  EXPECT_EQ(c.track.features, 600);
  EXPECT_EQ(c.track.levels, 4);
  EXPECT_DOUBLE_EQ(c.map.voxel_m, 0.35);
  EXPECT_DOUBLE_EQ(c.camera.fx, 517.3);
  EXPECT_EQ(config({b, a}).track.features, 500);
}

TEST_F(ConfigFiles, TheDumpSaysWhereEachValueComesFrom) {
  const std::string a = write("a.toml", "track.features = 500\n");
  const auto loaded = load({a}, {"detector.model=none", "camera.T_base_camera=[0, 0, 1, 0, 0, 0, 1]"});
  ASSERT_TRUE(loaded.ok()) << loaded.error().message;
  const auto check = [&](const char* key, const char* value, const std::string& origin) {
    EXPECT_EQ(entry(loaded.value(), key).value, value);
    EXPECT_EQ(entry(loaded.value(), key).origin, origin) << key;
  };
  check("track.features", "500", a);
  check("camera.fx", "517.3", kCamera);
  check("detector.model", "\"none\"", "--set");
  check("map.voxel_m", "0.04", "default");
  check("track.dynamic_rule", "\"silhouette\"", "default");
  check("camera.T_base_camera", "[0, 0, 1, 0, 0, 0, 1]", "--set");
  EXPECT_EQ(entry(loaded.value(), "classes.names").origin, "built in");
  EXPECT_EQ(entry(loaded.value(), "map.voxel_m").unit, "m");
}

TEST_F(ConfigFiles, SetTakesBareWordsPathsAndToml) {
  EXPECT_EQ(config({}, {"detector.model=none"}).detector.model, "none");
  EXPECT_EQ(config({}, {"detector.model=../models/a b.onnx"}).detector.model, "../models/a b.onnx");
  EXPECT_EQ(config({}, {"detector.model=\"quoted.onnx\""}).detector.model, "quoted.onnx");
  EXPECT_EQ(config({}, {"stream.listen=0.0.0.0:9000"}).stream.listen, "0.0.0.0:9000");
  EXPECT_EQ(config({}, {"stream.listen=off"}).stream.listen, "off");
  EXPECT_EQ(config({}, {"track.dynamic_rule=paper"}).track.dynamic_rule, DynamicRule::Paper);
  EXPECT_EQ(config({}, {"track.dynamic_rule=off"}).track.dynamic_rule, DynamicRule::Off);
  EXPECT_EQ(config({}, {"track.features = 1200"}).track.features, 1200);
  EXPECT_EQ(config({}, {"map.voxel_m=1e-2"}).map.voxel_m, 0.01);
  EXPECT_EQ(config({}, {"map.voxel_m=0.05"}).map.voxel_m, 0.05);
  EXPECT_EQ(config({}, {"detector.model=a=b"}).detector.model, "a=b");
  EXPECT_THAT(config({}, {"classes.dynamic=[\"person\"]"}).classes.dynamic, testing::ElementsAre("person"));
}

TEST_F(ConfigFiles, ATextIsDumpedAsTomlThatReadsBackTheSame) {
  for (const std::string text :
       {R"(Bob"s cam)", R"(C:\cam)", "two\nlines\tand\x01\x7f", "# no comment", "\u00fc"}) {
    const auto loaded = load({}, {"camera.name=" + text});
    ASSERT_TRUE(loaded.ok()) << loaded.error().message;
    EXPECT_EQ(loaded.value().config.mount.name, text);
    const std::string dumped = entry(loaded.value(), "camera.name").value;
    EXPECT_EQ(dumped.find('\n'), std::string::npos) << "one line a key";
    EXPECT_EQ(config({write("again.toml", "camera.name = " + dumped + "\n")}).mount.name, text) << dumped;
  }
  EXPECT_THAT(error({}, {"camera.name=\xff\xfe"}), HasSubstr("camera.name")) << "what no TOML file can hold";
}

TEST_F(ConfigFiles, LettersBeyondAsciiStandInQuotesAndCommentsOnly) {
  EXPECT_EQ(config({write("a.toml", "# \u00fcber\n[detector]\nmodel = '/h\u00f6me/\u3042'")}).detector.model,
            "/h\u00f6me/\u3042");
  for (const char* text :
       {"\u0239D t!", "\u00fc = 1", "track.features = \u00fc", "track.features = 5 \u3042"})
    EXPECT_THAT(error({write("b.toml", text)}), HasSubstr("b.toml")) << text;
}

TEST_F(ConfigFiles, SetRefusesWhatIsNoOverride) {
  for (const char* text : {"track.features", "=5", "", "a b=1", "#track.features=5", "track.=5"}) {
    EXPECT_THAT(error({}, {text}), HasSubstr(std::string("--set ") + text + ":")) << text;
  }
  EXPECT_THAT(error({}, {"track.features="}), HasSubstr("does not fit"));
  EXPECT_THAT(error({}, {"camera.T_base_camera=[0.05, -1, ['a', inf]]"}),
              HasSubstr("= [0.05, -1, ['a', inf]] does not fit"));
  EXPECT_THAT(error({}, {"camera.readout_s=0x7fffffffffffffff"}), HasSubstr("does not fit"));
  EXPECT_THAT(error({}, {"track.features={a = 0.05}"}), HasSubstr("= a table does not fit"));
  EXPECT_THAT(error({}, {"track.dynamic_rule=maybe"}), HasSubstr("\"silhouette\", \"paper\" or \"off\""));
}

TEST_F(ConfigFiles, PathsInAFileAreRelativeToIt) {
  EXPECT_EQ(config({write("sub/a.toml", "detector.model = 'models/m.onnx'")}).detector.model,
            folder_ / "sub/models/m.onnx");
  EXPECT_EQ(config({write("sub/b.toml", "detector.model = '../m.onnx'")}).detector.model, folder_ / "m.onnx");
  EXPECT_EQ(config({write("sub/c.toml", "detector.model = 'm.onnx'")}).detector.model,
            folder_ / "sub/m.onnx");
  EXPECT_EQ(config({write("sub/d.toml", "detector.model = '/opt/m.onnx'")}).detector.model, "/opt/m.onnx");
  EXPECT_EQ(config({write("sub/e.toml", "detector.model = 'none'")}).detector.model, "none");
  EXPECT_EQ(config({write("sub/f.toml", "detector.model = 'auto'")}).detector.model, "auto");
}

TEST_F(ConfigFiles, FileErrorsNameTheFileAndTheLine) {
  EXPECT_THAT(error({"/no/such.toml"}), HasSubstr("/no/such.toml: no such configuration file"));
  EXPECT_THAT(error({folder_.path()}), HasSubstr("no such configuration file"));
  EXPECT_THAT(error({""}),
              AllOf(HasSubstr("--config names no file"), HasSubstr("/etc/stillmap/stillmap.env")));
  const std::string broken = write("broken.toml", "[track]\nfeatures = 5 00\n");
  EXPECT_THAT(error({broken}), HasSubstr(broken + ":2: not valid TOML"));
  const std::string twice = write("twice.toml", "[track]\nfeatures = 500\nfeatures = 600\n");
  EXPECT_THAT(error({twice}), HasSubstr("not valid TOML"));
  const std::string unknown = write("unknown.toml", "[track]\nfaetures = 500\n");
  EXPECT_THAT(error({unknown}), AllOf(HasSubstr(unknown), HasSubstr("did you mean 'track.features'?")));
  const std::string alien = write("alien.toml", "[wheels]\ncircumference_of_the_left_one = 1\n");
  EXPECT_THAT(error({alien}), AllOf(HasSubstr("unknown key 'wheels."), HasSubstr("--dump")));
  const std::string range = write("range.toml", "camera.fx = 1\n");
  EXPECT_THAT(error({range}),
              AllOf(HasSubstr(range), HasSubstr("'camera.fx' = 1 "), HasSubstr("from 50 to 5000 px")));
  EXPECT_THAT(error({std::string(300, 'a')}), HasSubstr("no such configuration file"));
  std::filesystem::create_symlink("circle.toml", folder_ / "circle.toml");
  EXPECT_THAT(error({folder_ / "circle.toml"}), HasSubstr("no such configuration file"));
  std::string deep = "a";
  for (int i = 0; i < 16'000; ++i) deep += ".a";
  EXPECT_THAT(error({write("deep.toml", deep + " = 1")}), HasSubstr("unknown key 'a.a.a.a'"));
  EXPECT_THAT(error({write("large.toml", "#" + std::string(1 << 16, 'x'))}), HasSubstr("larger than 64 KB"));
  const std::string flat = write("flat.toml", "camera = 5\n");
  EXPECT_THAT(error({flat}), HasSubstr("unknown key 'camera'"));
}

TEST_F(ConfigFiles, ValuesThatDoNotGoTogetherAreRefused) {
  EXPECT_THAT(error({}, {"camera.depth_min_m=9"}), HasSubstr("must be less than camera.depth_max_m = 8 m"));
  EXPECT_THAT(error({}, {"camera.cx=640"}), HasSubstr("outside the 640 x 480 px picture"));
  EXPECT_THAT(error({}, {"camera.cy=480"}), HasSubstr("outside the 640 x 480 px picture"));
  EXPECT_THAT(error({}, {"detector.input_width=100"}), HasSubstr("multiples of 32"));
  EXPECT_THAT(error({}, {"detector.input_height=100"}), HasSubstr("multiples of 32"));
  EXPECT_THAT(error({}, {"detector.sha256=abc"}), HasSubstr("64 lower-case hexadecimal digits"));
  EXPECT_THAT(error({}, {"detector.sha256=" + std::string(64, 'G')}),
              HasSubstr("64 lower-case hexadecimal digits"));
  EXPECT_EQ(config({}, {"detector.sha256=" + std::string(64, 'a')}).detector.sha256, std::string(64, 'a'));
  EXPECT_THAT(error({}, {"track.without=[\"loops\", \"luck\"]"}),
              HasSubstr("track.without: \"luck\" is none of [\"carried_boxes\""));
  EXPECT_THAT(error({}, {"track.weak_inliers=10"}),
              HasSubstr("must not be less than track.min_inliers = 20"));
  EXPECT_THAT(error({}, {"classes.static=[\"person\"]"}), HasSubstr("'person' is listed twice"));
  EXPECT_THAT(error({}, {"camera.T_base_camera=[0, 0, 0, 0, 0, 0, 0.5]"}), HasSubstr("unit quaternion"));
  EXPECT_THAT(error({}, {"camera.T_base_camera=[0, 0, 0, 0, 0, 1]"}), HasSubstr("unit quaternion"));
}

TEST_F(ConfigFiles, ALensThatFoldsThePictureIsRefused) {
  EXPECT_THAT(error({}, {"camera.k1=-2"}),
              AllOf(HasSubstr("camera.k1, k2, p1, p2, k3 fold the picture"), HasSubstr("calibrate again")));
  EXPECT_THAT(error({}, {"camera.k3=-9", "camera.k2=0"}), HasSubstr("fold the picture"));
  EXPECT_THAT(error({}, {"camera.p1=0.9"}), HasSubstr("fold the picture"));
  EXPECT_EQ(config({}, {"camera.k1=-0.3", "camera.k2=0.1", "camera.k3=0"}).camera.k1, -0.3);
}

TEST_F(ConfigFiles, ADepthCameraOfItsOwnIsDescribedWholly) {
  const std::vector<std::string> whole{"camera.depth.width=320",
                                       "camera.depth.height=240",
                                       "camera.depth.fx=290",
                                       "camera.depth.fy=290",
                                       "camera.depth.cx=160",
                                       "camera.depth.cy=120",
                                       "camera.depth.T_colour_depth=[0.025, 0, 0, 0, 0, 0, 1]"};
  const Config c = config({}, whole);
  EXPECT_EQ(c.device.depth.width, 320);
  EXPECT_DOUBLE_EQ(pose_from(*c.device.T_colour_depth).t.x, 0.025);
  for (std::size_t left_out = 1; left_out < whole.size(); ++left_out) {
    std::vector<std::string> rest = whole;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(left_out));
    EXPECT_THAT(error({}, rest), HasSubstr("asks for registration, which needs")) << whole[left_out];
  }
  std::vector<std::string> folded = whole;
  folded.emplace_back("camera.depth.k1=-3");
  EXPECT_THAT(error({}, folded), HasSubstr("camera.depth.k1, k2, p1, p2, k3 fold"));
}

TEST_F(ConfigFiles, RecordedColourIsJpegOrPng) {
  EXPECT_EQ(config({}, {"record.colour=png"}).record.colour, "png");
  EXPECT_THAT(error({}, {"record.colour=webp"}), HasSubstr("\"jpeg\" or \"png\""));
}

TEST_F(ConfigFiles, AWordThatIsNoneOfAKeysIsRefusedWithTheFileAndAllWords) {
  for (const auto& [key, expected] : std::vector<std::pair<std::string, std::string>>{
           {"record.colour", "\"jpeg\" or \"png\""},
           {"detector.decoder", "\"nanodet_plus\", \"nanodet\", \"yolov5\", \"yolov8\" or \"yolox\""},
           {"detector.colour_order", "\"bgr\" or \"rgb\""},
           {"stream.preview", "\"masked\", \"off\" or \"full\""},
           {"stream.full_preview_to", "\"loopback\" or \"network\""},
           {"track.dynamic_rule", "\"silhouette\", \"paper\" or \"off\""}}) {
    const std::string file = write("word.toml", key + " = \"gif\"\n");
    EXPECT_THAT(error({file}), AllOf(HasSubstr(file), HasSubstr("'" + key + "' = "), HasSubstr(expected)));
  }
}

TEST_F(ConfigFiles, TheBuiltInClassesAreCocosAndSorted) {
  const Config c = config({});
  EXPECT_EQ(c.classes.names.size(), 80u);
  EXPECT_EQ(c.classes.names[0], "person");
  for (const auto* list : {&c.classes.dynamic, &c.classes.semi_static, &c.classes.pure_static}) {
    EXPECT_FALSE(list->empty());
    for (const std::string& name : *list) EXPECT_THAT(c.classes.names, testing::Contains(name));
  }
}

TEST(ShippedConfigs, EveryCameraFileLoadsAlone) {
  int files = 0;
  for (const auto& file :
       std::filesystem::directory_iterator(STILLMAP_SOURCE_DIR "/firmware-config/cameras")) {
    const auto loaded = load_config(std::vector<std::string>{file.path().string()}, {});
    EXPECT_TRUE(loaded.ok()) << loaded.error().message;
    ++files;
  }
  EXPECT_GE(files, 9);
}

TEST(ShippedConfigs, EveryClassFileLoadsWithACamera) {
  for (const auto& file :
       std::filesystem::directory_iterator(STILLMAP_SOURCE_DIR "/firmware-config/classes")) {
    const auto loaded = load_config(std::vector<std::string>{kCamera, file.path().string()}, {});
    EXPECT_TRUE(loaded.ok()) << loaded.error().message;
  }
}

}  // namespace
}  // namespace stillmap
