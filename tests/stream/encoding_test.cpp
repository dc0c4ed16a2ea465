// SPDX-License-Identifier: Apache-2.0
#include "stream/encoding.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "wire_reader.h"

namespace stillmap::stream {
namespace {

using test::WireMessage;
constexpr Nanoseconds kStamp = 1'700'000'000'123'456'789;

StreamPose some_pose() {
  StreamPose pose;
  pose.stamp_ns = kStamp;
  pose.T_map_odom = {rotation_from({.w = std::sqrt(0.5), .z = std::sqrt(0.5)}), {1, 2, 3}};
  pose.T_odom_base.t = {4, 0, 0};
  pose.T_base_camera = {rotation_from({.w = 0.5, .x = -0.5, .y = 0.5, .z = -0.5}), {0, 0, 0.5}};
  pose.epoch = 300;
  return pose;
}

void expect_xyz(const WireMessage& v, double x, double y, double z) {
  EXPECT_NEAR(v.number<double>(1), x, 1e-12);
  EXPECT_NEAR(v.number<double>(2), y, 1e-12);
  EXPECT_NEAR(v.number<double>(3), z, 1e-12);
}

TEST(Encoding, MessageHeaderIsLittleEndianOpcodeIdStamp) {
  std::array<std::uint8_t, kMessageHeaderBytes> header{};
  write_message_header(header, 0x01020304, 0x1122334455667788);
  EXPECT_THAT(header, testing::ElementsAre(1, 4, 3, 2, 1, 0x88, 0x77, 0x66, 0x55, 0x44, 0x33, 0x22, 0x11));
}

TEST(Encoding, PoseIsTheCameraInTheMap) {
  std::array<std::uint8_t, kMaxPoseBytes> buffer{};
  const WireMessage message{std::span(buffer).first(encode_pose(some_pose(), buffer))};
  ASSERT_FALSE(message.broken());
  EXPECT_EQ(message.message(1).number<std::uint64_t>(1), 1'700'000'000U);
  EXPECT_EQ(message.message(1).number<std::uint64_t>(2), 123'456'789U);
  EXPECT_EQ(message.text(2), "map");
  EXPECT_EQ(message.number<std::uint64_t>(1000), 300U);
  expect_xyz(message.message(3).message(1), 1, 2 + 4, 3.5);  // 90 degrees about z: x of odom is y of map
  const Quaternion expected = quaternion_from(some_pose().T_map_odom.R * some_pose().T_base_camera.R);
  expect_xyz(message.message(3).message(2), expected.x, expected.y, expected.z);
  EXPECT_NEAR(message.message(3).message(2).number<double>(4), expected.w, 1e-12);
}

TEST(Encoding, TransformsAreTheChainFromMapToCamera) {
  std::array<std::uint8_t, kMaxTransformsBytes> buffer{};
  const WireMessage message{std::span(buffer).first(encode_transforms(some_pose(), buffer))};
  ASSERT_FALSE(message.broken());
  ASSERT_EQ(message.count(1), 3U);
  EXPECT_EQ(message.number<std::uint64_t>(1000), 300U);
  const char* const names[] = {"map", "odom", "base", "camera"};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(message.message(1, i).message(1).number<std::uint64_t>(2), 123'456'789U);
    EXPECT_EQ(message.message(1, i).text(2), names[i]);
    EXPECT_EQ(message.message(1, i).text(3), names[i + 1]);
  }
  expect_xyz(message.message(1, 0).message(4), 1, 2, 3);
  expect_xyz(message.message(1, 0).message(5), 0, 0, std::sqrt(0.5));
  expect_xyz(message.message(1, 1).message(4), 4, 0, 0);
  expect_xyz(message.message(1, 2).message(5), -0.5, 0.5, -0.5);
  EXPECT_NEAR(message.message(1, 2).message(5).number<double>(4), 0.5, 1e-12);
}

TEST(Encoding, StampsBeforeTheEpochCountForward) {
  StreamPose pose;
  pose.stamp_ns = -1;
  std::array<std::uint8_t, kMaxPoseBytes> buffer{};
  const WireMessage message{std::span(buffer).first(encode_pose(pose, buffer))};
  EXPECT_EQ(message.message(1).number<std::int64_t>(1), -1);
  EXPECT_EQ(message.message(1).number<std::int64_t>(2), 999'999'999);
}

TEST(Encoding, TheLargestValuesFit) {
  constexpr double kHuge = std::numeric_limits<double>::max();
  StreamPose pose;
  pose.stamp_ns = std::numeric_limits<Nanoseconds>::min();
  pose.epoch = std::numeric_limits<std::uint32_t>::max();
  for (Pose* T : {&pose.T_map_odom, &pose.T_odom_base, &pose.T_base_camera}) {
    T->t = {kHuge, -kHuge, std::nan("")};
    T->R = some_pose().T_base_camera.R;
  }
  std::array<std::uint8_t, kMaxTransformsBytes> transforms{};
  std::array<std::uint8_t, kMaxPoseBytes> poses{};
  std::array<std::uint8_t, kMaxCloudEnvelopeBytes> envelope{};
  EXPECT_LE(encode_transforms(pose, transforms), transforms.size());
  EXPECT_LE(encode_pose(pose, poses), poses.size());
  EXPECT_LE(encode_cloud_envelope(kMaxCloudPoints, pose.stamp_ns, pose.epoch, envelope), envelope.size());
}

TEST(Encoding, CloudEnvelopeAndPointsAreOnePointCloud) {
  const std::array<CloudPoint, 2> points{{{1, 2, 3, 10, 20, 30, 255}, {-1, -2, -3, 40, 50, 60, 255}}};
  std::array<std::uint8_t, kMaxCloudEnvelopeBytes> envelope{};
  const std::size_t bytes = encode_cloud_envelope(points.size(), kStamp, 300, envelope);
  std::vector<std::uint8_t> whole(envelope.begin(), envelope.begin() + static_cast<std::ptrdiff_t>(bytes));
  const auto* raw = reinterpret_cast<const std::uint8_t*>(points.data());
  whole.insert(whole.end(), raw, raw + sizeof(points));

  const WireMessage message(whole);
  ASSERT_FALSE(message.broken());
  EXPECT_EQ(message.text(2), "map");
  EXPECT_EQ(message.number<std::uint64_t>(1000), 300U);
  EXPECT_EQ(message.message(3).message(2).number<double>(4), 1.0);  // identity
  EXPECT_EQ(message.number<std::uint32_t>(4), 16U);
  ASSERT_EQ(message.count(5), 7U);
  const char* const names[] = {"x", "y", "z", "red", "green", "blue", "alpha"};
  const std::uint32_t offsets[] = {0, 4, 8, 12, 13, 14, 15}, types[] = {7, 7, 7, 1, 1, 1, 1};
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_EQ(message.message(5, i).text(1), names[i]);
    EXPECT_EQ(message.message(5, i).number<std::uint32_t>(2), offsets[i]);
    EXPECT_EQ(message.message(5, i).number<std::uint32_t>(3), types[i]);
  }
  EXPECT_EQ(message.text(6), std::string(reinterpret_cast<const char*>(raw), sizeof(points)));
}

TEST(Encoding, AnEmptyCloudIsAMessageToo) {
  std::array<std::uint8_t, kMaxCloudEnvelopeBytes> envelope{};
  const WireMessage message{std::span(envelope).first(encode_cloud_envelope(0, kStamp, 0, envelope))};
  EXPECT_FALSE(message.broken());
  EXPECT_EQ(message.count(6), 1U);
  EXPECT_EQ(message.text(6), "");
}

}  // namespace
}  // namespace stillmap::stream
