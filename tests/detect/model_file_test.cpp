// SPDX-License-Identifier: Apache-2.0
#include "detect/model_file.h"

#include <gmock/gmock.h>
#include <stdlib.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/support/shared_folder.h"

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
    folder_ = std::filesystem::temp_directory_path() / ("stillmap_models_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_ / "given");
    std::filesystem::current_path(folder_);
    setenv("STILLMAP_MODELS", (folder_ / "given").c_str(), 1);
  }
  void TearDown() override {
    unsetenv("STILLMAP_MODELS");
    std::filesystem::current_path(before_);
    std::filesystem::remove_all(folder_);
  }
  std::string write(const std::filesystem::path& name, const std::string& text) {
    std::filesystem::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
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
  std::filesystem::path before_, folder_;
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
  EXPECT_THAT(found.value().warning,
              AllOf(HasSubstr("scripts/get_model.sh"), HasSubstr((folder_ / "given").string())));
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
  expect_refused(find(folder_), ExitCode::UnreadableInput, "is a folder");
  expect_refused(find(""), ExitCode::UnreadableInput, "cannot be read");
  if (geteuid() != 0) {
    const std::string file = write("locked.onnx", "abc");
    std::filesystem::permissions(file, std::filesystem::perms::none);
    expect_refused(find(file), ExitCode::UnreadableInput, "Permission denied");
  }
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
