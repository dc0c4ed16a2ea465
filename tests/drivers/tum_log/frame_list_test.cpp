// SPDX-License-Identifier: Apache-2.0
#include "drivers/tum_log/frame_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/pictures/picture_files.h"

namespace stillmap {
namespace {

using testing::HasSubstr;

class FrameList : public testing::Test {
 protected:
  void write(const char* name, const std::string& text) { folder_.write(name, text); }
  Result<std::vector<ListedFrame>> read() { return read_frame_list(folder_.path().string()); }
  std::string error() {
    const auto list = read();
    EXPECT_FALSE(list.ok());
    if (list.ok()) return "";
    EXPECT_EQ(list.error().exit_code, ExitCode::UnreadableInput);
    return list.error().message;
  }
  /// "colour>depth" of each frame in ms, or the reason.
  std::string pairs() {
    const auto list = read();
    if (!list.ok()) return list.error().message;
    std::string text;
    for (const ListedFrame& f : list.value()) {
      text += std::to_string(f.colour_ns / 1'000'000) + ">" +
              (f.known_unusable ? to_string(*f.known_unusable) : std::to_string(f.depth_ns / 1'000'000)) +
              " ";
    }
    return text;
  }
  test::TemporaryFolder folder_;
};

TEST_F(FrameList, AssociationsDecideWherePresent) {
  write("associations.txt",
        "# c\n1.5 rgb/a.png 1.7 depth/b.png\n2 rgb/c.png 2.0 depth/d.png extra columns\n");
  write("rgb.txt", "nonsense");
  const auto list = read();
  ASSERT_TRUE(list.ok()) << list.error().message;
  ASSERT_EQ(list.value().size(), 2u);
  EXPECT_EQ(list.value()[0].colour_ns, 1'500'000'000);
  EXPECT_EQ(list.value()[0].depth_ns, 1'700'000'000) << "the file decides, the window does not";
  EXPECT_EQ(list.value()[0].colour_path, (folder_.path() / "rgb/a.png").string());
  EXPECT_EQ(list.value()[1].depth_path, (folder_.path() / "depth/d.png").string());
}

TEST_F(FrameList, NearestPairsFirstOneToOneWithinTwentyMilliseconds) {
  // 1.000 is nearest to 1.008, but 1.010 is nearer to it and takes it; 1.000 falls back to 1.015.
  write("rgb.txt", "1.000 a\n1.010 b\n2.000 c\n3.000 d\n4.000 e\n");
  write("depth.txt", "1.008 A\n1.015 B\n2.020 C\n3.021 D\n");
  EXPECT_EQ(pairs(), "1000>1015 1010>1008 2000>2020 3000>no_depth_match 4000>no_depth_match ");
}

TEST_F(FrameList, ADenseListIsRefusedBeforeAllItsPairsAreMade) {
  std::string list;
  for (int i = 0; i < 64; ++i) list += "1." + std::to_string(100'000 + i) + " p\n";
  write("rgb.txt", list);
  write("depth.txt", list);
  EXPECT_TRUE(read().ok());
  write("depth.txt", list + "1.1002 p\n");
  EXPECT_THAT(error(),
              testing::AllOf(HasSubstr("depth.txt"), HasSubstr("more than 64"), HasSubstr("in seconds")));
}

TEST_F(FrameList, DepthNeedNotBeSortedAndTiesGoToTheEarlierFrame) {
  write("rgb.txt", "1.000 a\n1.020 b\n");
  write("depth.txt", "5.0 Z\n1.010 B\n");
  EXPECT_EQ(pairs(), "1000>1010 1020>no_depth_match ");
}

TEST_F(FrameList, TextAsItComesFromOtherSystems) {
  write("rgb.txt",
        "\xEF\xBB\xBF# comment\r\n\r\n  1.000\trgb/a.png\r\n#x\n1.033,rgb/b.png , more\r\n\n1.066 rgb/c.png");
  write("depth.txt", "1.000 A\r\n1.033 B\r\n1.066 C");
  EXPECT_EQ(pairs(), "1000>1000 1033>1033 1066>1066 ");
  EXPECT_EQ(read().value()[1].colour_path, (folder_.path() / "rgb/b.png").string());
}

TEST_F(FrameList, StampsThatDoNotRiseAreJumps) {
  write("rgb.txt", "1.0 a\n2.0 b\n1.5 c\n2.0 d\n2.1 e\n");
  write("depth.txt", "1.0 A\n2.0 B\n1.5 C\n2.0 D\n2.1 E\n");
  EXPECT_EQ(pairs(), "1000>1000 2000>2000 1500>time_jump 2000>time_jump 2100>2100 ");
}

TEST_F(FrameList, ALastLineThatIsCutOffIsPassedOver) {
  const std::string whole = "1.000 rgb/1.jpg 1.010 depth/1.png\n", last = "2.000 rgb/2.jpg 2.010 depth/2.png";
  for (const std::size_t length : {0u, 3u, 5u, 12u, 16u, 20u, 21u}) {
    write("associations.txt", whole + last.substr(0, length));
    EXPECT_EQ(pairs(), "1000>1010 ") << length;
  }
  write("associations.txt", whole + last);
  EXPECT_EQ(pairs(), "1000>1010 2000>2010 ");
  write("associations.txt", whole + "2.000 rgb/2.jpg\n");
  EXPECT_THAT(error(), HasSubstr("associations.txt:2"));
}

TEST_F(FrameList, ErrorsNameTheThingAndTheMend) {
  EXPECT_THAT(error(),
              testing::AllOf(HasSubstr(folder_.path().string()), HasSubstr("rgb.txt and depth.txt")));
  write("rgb.txt", "1.0 a\n");
  EXPECT_THAT(error(), HasSubstr("depth.txt"));
  write("depth.txt", "# nothing\n\n1.0\n");
  EXPECT_THAT(error(), HasSubstr("depth.txt:3: expected 'stamp file'"));
  write("depth.txt", "yesterday A\n");
  EXPECT_THAT(error(), HasSubstr("depth.txt:1:"));
  write("associations.txt", "1.0 a 1.0 A\n1.1 b 1.1\n");
  EXPECT_THAT(error(), HasSubstr("associations.txt:2: expected 'stamp colour-file stamp depth-file'"));
  std::filesystem::remove(folder_.path() / "associations.txt");
  std::filesystem::create_directory(folder_.path() / "associations.txt");
  EXPECT_THAT(error(), HasSubstr("associations.txt: cannot be read"));
}

TEST(FrameListFolder, MissingFolderIsNamed) {
  const auto list = read_frame_list("/no/such/log");
  ASSERT_FALSE(list.ok());
  EXPECT_EQ(list.error().exit_code, ExitCode::UnreadableInput);
  EXPECT_THAT(list.error().message, testing::AllOf(HasSubstr("/no/such/log"), HasSubstr("tum:DIR")));
}

}  // namespace
}  // namespace stillmap
