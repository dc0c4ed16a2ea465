// SPDX-License-Identifier: Apache-2.0
#include "stream/publisher.h"

#include <gtest/gtest.h>

#include <random>

#include "stream/scene_encoding.h"
#include "tests/support/heap_calls.h"
#include "wire_reader.h"

namespace stillmap::stream {
namespace {

constexpr Nanoseconds kStep = 100'000'000;

Config camera_config(int width = 640, int height = 480, const char* preview = "masked") {
  Config config;
  config.camera = {
      .width = width, .height = height, .fx = 500, .fy = 500, .cx = width / 2.0, .cy = height / 2.0};
  config.classes.names = {"person", "chair"};
  config.stream.preview = preview;
  return config;
}

/// A publisher whose clients want what the test says, with pictures of noise.
struct PublisherTest : testing::Test {
  explicit PublisherTest(Config c = camera_config()) : config(std::move(c)) {
    std::minstd_rand random(1);
    for (auto* handle : {&frame, &next_frame}) {
      *handle = pool.acquire();
      const ImageView<Bgr>& colour = handle->writable().colour;
      for (int y = 0; y < colour.height; ++y) {
        for (int x = 0; x < colour.width; ++x)
          colour.at(x, y) = {static_cast<std::uint8_t>(random()), static_cast<std::uint8_t>(random()),
                             static_cast<std::uint8_t>(random())};
      }
      handle->writable().sequence = handle == &frame ? 1 : 2;
    }
  }
  void round() {
    now += kStep;
    publisher.round(now, [this](Channel c) { return std::ranges::find(wanted, c) != wanted.end(); });
  }
  void scene(std::uint64_t sequence) {
    StreamScene made;
    made.sequence = sequence;
    made.stamp_ns = 5;
    publisher.scene(made);
  }
  std::uint64_t messages(Channel channel) const { return feed.topic(channel).end(); }
  test::WireMessage last(Channel channel) const {
    return test::WireMessage(feed.topic(channel).payload(messages(channel) - 1));
  }

  Config config;
  Arena arena{32 << 20};
  FramePool pool{arena, 3, config.camera.width, config.camera.height};
  FrameHandle frame, next_frame;
  Counters counters;
  Feed feed{{}, true, {}};
  Publisher publisher{arena, config, feed, counters};
  std::vector<Channel> wanted;
  Nanoseconds now = 1'000'000'000;
};

TEST_F(PublisherTest, NothingIsEncodedThatNobodyWants) {
  for (int i = 0; i < 3; ++i) {
    publisher.pose({.stamp_ns = 1});
    publisher.health({.state = "tracking"});
    scene(1);
    round();
    EXPECT_FALSE(publisher.scene_wanted());
    EXPECT_FALSE(publisher.picture_wanted());
  }
  for (std::uint32_t id = 1; id <= kChannelCount; ++id)
    EXPECT_EQ(messages(static_cast<Channel>(id)), 0U) << id;
  wanted = {Channel::Pose, Channel::Health};
  round();
  EXPECT_EQ(messages(Channel::Pose), 1U) << "the newest, at once";
  EXPECT_EQ(messages(Channel::Health), 1U);
  round();
  EXPECT_EQ(messages(Channel::Pose), 1U) << "and once";
}

TEST_F(PublisherTest, WhoComesLaterBeginsWithWhatIsTrueNow) {
  wanted = {Channel::Pose, Channel::Objects};
  publisher.pose({.stamp_ns = 1});
  scene(1);
  round();
  wanted.clear();
  publisher.pose({.stamp_ns = 2});
  round();
  EXPECT_EQ(feed.topic(Channel::Objects).begin(1), feed.topic(Channel::Objects).end())
      << "old objects are gone";
  EXPECT_EQ(feed.topic(Channel::Pose).begin(1), feed.topic(Channel::Pose).end());
  wanted = {Channel::Pose};
  round();
  EXPECT_EQ(feed.topic(Channel::Pose).item(messages(Channel::Pose) - 1).stamp_ns, 2);
}

TEST_F(PublisherTest, APictureLeavesWithItsScene) {
  wanted = {Channel::Picture, Channel::Annotations};
  round();
  ASSERT_TRUE(publisher.picture_wanted());
  publisher.picture(*frame, {});
  EXPECT_FALSE(publisher.picture_wanted()) << "one at a time";
  round();
  EXPECT_EQ(messages(Channel::Picture), 0U) << "the tracker may still be at it";
  scene(1);
  round();
  EXPECT_EQ(messages(Channel::Picture), 1U);
  EXPECT_EQ(last(Channel::Picture).text(3), "jpeg");
  EXPECT_EQ(feed.topic(Channel::Annotations).item(messages(Channel::Annotations) - 1).stamp_ns, 5);
}

TEST_F(PublisherTest, APictureOfWhichNotAllIsKnownStaysHere) {
  wanted = {Channel::Picture};
  round();
  publisher.picture(*frame, {});
  scene(2);  // the tracker never saw this frame
  round();
  EXPECT_EQ(messages(Channel::Picture), 0U);
  EXPECT_EQ(counters.pictures_withheld.load(), 1U);
  // Nor does one leave when the tracker is silent.
  round();
  ASSERT_TRUE(publisher.picture_wanted());
  frame.reset();
  next_frame.writable().sequence = 9;
  publisher.picture(*next_frame, {});
  for (int i = 0; i < 6; ++i) round();
  EXPECT_EQ(counters.pictures_withheld.load(), 2U);
  EXPECT_EQ(messages(Channel::Picture), 0U);
  next_frame.reset();
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(pool.acquire()) << "the frames are let go of";
}

TEST_F(PublisherTest, NobodyLeftLetsGoOfTheFrame) {
  wanted = {Channel::Picture};
  round();
  publisher.picture(*frame, {});
  wanted.clear();
  round();
  frame.reset();
  EXPECT_TRUE(pool.acquire());
}

TEST_F(PublisherTest, WithoutPicturesAnnotationsComeByThemselves) {
  wanted = {Channel::Annotations};
  round();
  EXPECT_TRUE(publisher.scene_wanted());
  for (std::uint64_t i = 1; i <= 3; ++i) {
    scene(i);
    round();
  }
  EXPECT_EQ(messages(Channel::Annotations), 3U);
}

TEST_F(PublisherTest, ClassesThatMoveAndPeopleArePixelatedWhateverTheirKind) {
  const auto bytes_with = [&](std::uint16_t class_id, ClassKind kind) {
    wanted = {Channel::Picture};
    round();
    Detections own;
    EXPECT_TRUE(own.items.try_push_back({.box = {0, 0, 640, 480}, .class_id = class_id, .kind = kind}));
    publisher.picture(*frame, own);
    scene(1);
    round();
    return last(Channel::Picture).text(2).size();
  };
  // Noise that is pixelated needs hardly any bytes.
  const std::size_t chair = bytes_with(1, ClassKind::SemiStatic);
  EXPECT_LT(bytes_with(1, ClassKind::Dynamic), chair / 4);
  EXPECT_LT(bytes_with(0, ClassKind::Ignored), chair / 4) << "a person, by name";
}

TEST_F(PublisherTest, TheMostThatAFrameHoldsFitsAndCostsNoHeap) {
  wanted = {Channel::Objects,    Channel::Annotations, Channel::Picture, Channel::Pose,
            Channel::Transforms, Channel::Health,      Channel::Log,     Channel::Calibration};
  StreamScene full;
  full.has_pose = true;
  full.sequence = 1;
  full.stamp_ns = 1'700'000'000'999'999'999;
  full.T_map_camera.t = {1e5, -1e5, 1e5};
  while (full.objects.try_push_back({.id = 4'000'000'000,
                                     .kind = ClassKind::Dynamic,
                                     .score = 0.123F,
                                     .box = {1.3F, 2.7F, 633.1F, 477.7F},
                                     .near_m = 1.1F,
                                     .far_m = 7.7F,
                                     .velocity_m_s = {1.234, -2.345, 0.123},
                                     .age_ns = 123'456'789'000}))
    continue;
  while (full.features.try_push_back({639, 479, Label::SemiStatic})) continue;
  round();
  const auto go = [&] {
    publisher.pose({.stamp_ns = full.stamp_ns});
    publisher.health({.state = "initializing"});
    publisher.log(LogLevel::Warning, "a name that is too long for it", std::string(300, 'x'));
    publisher.scene(full);
    publisher.picture(*frame, {});
    round();
    round();
  };
  go();
  const long calls = test::heap_calls();
  for (int i = 0; i < 5; ++i) {
    publisher.pose({.stamp_ns = full.stamp_ns});
    publisher.scene(full);
    publisher.picture(*frame, {});
    round();
    round();
  }
  EXPECT_EQ(test::heap_calls(), calls);
  EXPECT_GE(messages(Channel::Picture), 5U) << "noise, the most that a picture can be, fits";
  EXPECT_EQ(last(Channel::Objects).count(2), 64U);
  EXPECT_EQ(last(Channel::Annotations).count(2), 4U + 64U);
  EXPECT_EQ(last(Channel::Log).text(3).size(), 199U);
}

struct LargePublisherTest : PublisherTest {
  LargePublisherTest() : PublisherTest(camera_config(1280, 960, "full")) {}
};

TEST_F(LargePublisherTest, LargePicturesBecomeSmallOnesWithACalibrationToMatch) {
  wanted = {Channel::Picture, Channel::Calibration};
  round();
  publisher.picture(*frame, {});
  scene(1);
  round();
  EXPECT_EQ(messages(Channel::Picture), 1U);
  EXPECT_EQ(last(Channel::Calibration).number<std::uint32_t>(2), 320U);
  EXPECT_EQ(last(Channel::Calibration).number<std::uint32_t>(3), 240U);
}

}  // namespace
}  // namespace stillmap::stream
