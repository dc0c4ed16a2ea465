// SPDX-License-Identifier: Apache-2.0
#include "track/keyframe_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include "track/keyframe_copier.h"

namespace stillmap {
namespace {

struct KeyframeFile : testing::Test {
  static constexpr std::size_t kKeyframes = 8, kPoints = 1500;
  struct Memory {
    Arena arena{4 << 20};
    LocalMap map;
    Memory(std::size_t keyframes, std::size_t points) : map(arena, keyframes, points) {}
  };

  KeyframeFile() {
    map().begin_segment();
    for (int i = 0; i < 1000; ++i) {
      if (i == 500) map().begin_segment();
      MapPoint point;
      point.p_odom = {0.01 * i, 1, 2};
      point.information = {1, 0, 0, 2, 0, 3};
      point.view_direction = {1, 0, 0};
      point.descriptor.bits = {static_cast<std::uint64_t>(i), 2, 3, 4};
      point.reference_distance_m = 1.5;
      point.reference_octave = 3;
      point.suspect = i % 2 == 0;
      point.visible = 7;
      point.found = 5;
      refs.push_back(map().add_point(point));
    }
    map().begin_keyframe_ids_after(100);
    for (int k = 0; k < 6; ++k) {
      map().enter_segment(k < 3 ? 1 : 2);
      Keyframe& keyframe = map().add_keyframe();
      keyframe.sequence = 100 + static_cast<std::uint64_t>(k);
      keyframe.stamp_ns = 5'000'000'000 + k;
      keyframe.T_odom_camera = {exp_so3({0, 0.1 * k, 0}), {1.0 * k, 0, 0}};
      keyframe.tracked_points = 40 + k;
      for (std::size_t i = 0; i < 300; ++i) {
        EXPECT_TRUE(keyframe.features.try_push_back(
            {0.001f * static_cast<float>(i), 0.5f, 2, 4, refs[100 * static_cast<std::size_t>(k) + i]}));
        keyframe.descriptors[i].bits = {i, static_cast<std::uint64_t>(k), 0, 1};
      }
    }
    map().remove_point(
        static_cast<std::size_t>(refs[5].slot));  // the first keyframe's reference to it is stale
  }
  LocalMap& map() { return memory->map; }

  std::vector<std::byte> written(const Pose& T_map_odom = {}) {
    std::vector<std::byte> all, part(KeyframeWriter::kLargestRecord);
    for (KeyframeWriter writer; !writer.done(map());) {
      const std::size_t size = writer.write(map(), T_map_odom, part);
      EXPECT_GT(size, 0u);
      all.insert(all.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(size));
    }
    return all;
  }

  std::unique_ptr<Memory> memory = std::make_unique<Memory>(kKeyframes, kPoints);
  std::vector<PointRef> refs;
};

TEST_F(KeyframeFile, ComesBackInTheMapFrame) {
  const Pose T_map_odom{exp_so3({0, 0, M_PI / 2}), {0, 0, 5}};
  const std::vector<std::byte> bytes = written(T_map_odom);
  const auto back = std::make_unique<Memory>(kKeyframes, kPoints);
  const Status status = read_keyframes(bytes, back->map);
  ASSERT_TRUE(status.ok()) << status.error().message;
  EXPECT_EQ(count_keyframes(bytes).value().points, 999u);
  EXPECT_EQ(count_keyframes(bytes).value().keyframes, 6u);
  int seen = 0;
  for (std::size_t k = 0; k < 6; ++k) {
    const Keyframe &a = map().keyframes()[k], &b = back->map.keyframes()[k];
    ASSERT_TRUE(b.alive);
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(b.segment, k < 3 ? 1u : 2u);
    EXPECT_EQ(a.sequence, b.sequence);
    EXPECT_EQ(a.stamp_ns, b.stamp_ns);
    EXPECT_EQ(a.tracked_points, b.tracked_points);
    EXPECT_LT(norm((T_map_odom * a.T_odom_camera).t - b.T_odom_camera.t), 1e-12);
    ASSERT_EQ(a.features.size(), b.features.size());
    for (std::size_t i = 0; i < a.features.size(); ++i) {
      EXPECT_EQ(a.features[i].ray_x, b.features[i].ray_x);
      EXPECT_EQ(a.features[i].octave, b.features[i].octave);
      EXPECT_EQ(a.descriptors[i].bits, b.descriptors[i].bits);
      const MapPoint *p = map().find(a.features[i].point), *q = back->map.find(b.features[i].point);
      ASSERT_EQ(p == nullptr, q == nullptr) << k << ' ' << i;
      if (p == nullptr) continue;
      ++seen;
      EXPECT_EQ(p->descriptor.bits, q->descriptor.bits);
      EXPECT_LT(norm(T_map_odom * p->p_odom - q->p_odom), 1e-12);
      EXPECT_NEAR(q->view_direction.y, 1, 1e-12);
      EXPECT_NEAR(q->information[0], 2, 1e-12);  // what was along y is along x
      EXPECT_NEAR(q->information[3], 1, 1e-12);
      EXPECT_EQ(p->segment, q->segment);
      EXPECT_EQ(p->suspect, q->suspect);
      EXPECT_EQ(p->visible, q->visible);
      EXPECT_EQ(p->found, q->found);
      EXPECT_EQ(p->reference_octave, q->reference_octave);
    }
  }
  EXPECT_EQ(seen, 6 * 300 - 1);
  EXPECT_EQ(back->map.segment(), 2u) << "the newest keyframe's";
  EXPECT_EQ(back->map.add_keyframe().id, 107u) << "new keyframes have new ids";
  back->map.begin_segment();
  EXPECT_EQ(back->map.segment(), 3u) << "and new segments too";
}

TEST_F(KeyframeFile, TooLittleRoomIsSaidWithTheKeys) {
  const std::vector<std::byte> bytes = written();
  for (const auto& [keyframes, points] : {std::pair{5, 1500}, {8, 998}}) {
    Memory small(static_cast<std::size_t>(keyframes), static_cast<std::size_t>(points));
    const Status status = read_keyframes(bytes, small.map);
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().exit_code, ExitCode::WrongConfig);
    EXPECT_NE(status.error().message.find("6 keyframes and 999 points"), std::string::npos);
    EXPECT_NE(status.error().message.find("track.keyframes"), std::string::npos);
    EXPECT_EQ(small.map.newest_keyframe(), nullptr);
  }
}

TEST_F(KeyframeFile, CutOrForeignBytesAreRefusedWhole) {
  const std::vector<std::byte> bytes = written();
  const auto refused = [&](std::span<const std::byte> these) {
    const auto back = std::make_unique<Memory>(kKeyframes, kPoints);
    const Status status = read_keyframes(these, back->map);
    EXPECT_EQ(back->map.newest_keyframe() == nullptr, !status.ok() || these.empty());
    return !status.ok();
  };
  int whole = 0;
  for (std::size_t size = 1; size < bytes.size(); size += 997)
    whole += !refused(std::span(bytes).first(size));
  EXPECT_LE(whole, 2) << "a cut between two records is found by the file's checksum";
  EXPECT_TRUE(refused(std::vector<std::byte>(5000, std::byte{7})));
  std::vector<std::byte> wrong = bytes;
  wrong[124] = std::byte{255};  // the first keyframe's features
  wrong[125] = std::byte{255};
  EXPECT_TRUE(refused(wrong));
  EXPECT_FALSE(refused({}));
}

TEST_F(KeyframeFile, WhatTheTrackerCouldNotLiveWithIsRefused) {
  constexpr std::size_t kHead = 136, kFeature = 56, kKeyframe = kHead + 300 * kFeature,
                        kPoints0 = 6 * kKeyframe;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const double infinite = std::numeric_limits<double>::infinity();
  const auto refused = [&](std::size_t at, auto value) {
    std::vector<std::byte> bytes = written();
    std::memcpy(bytes.data() + at, &value, sizeof(value));
    const auto back = std::make_unique<Memory>(kKeyframes, kPoints);
    return !read_keyframes(bytes, back->map).ok() && back->map.newest_keyframe() == nullptr;
  };
  EXPECT_FALSE(refused(8, std::uint64_t{1} << 60)) << "any sequence number is good";
  EXPECT_TRUE(refused(4, std::uint32_t{0})) << "id";
  EXPECT_TRUE(refused(4, ~std::uint32_t{0})) << "id that leaves no later one";
  EXPECT_TRUE(refused(24, 2.0)) << "rotation that stretches";
  EXPECT_TRUE(refused(kHead, nan)) << "ray of a feature";
  EXPECT_TRUE(refused(kKeyframe + kHead + 8, -1.f)) << "depth";
  EXPECT_TRUE(refused(kHead + 12, std::uint32_t{8})) << "octave";
  EXPECT_TRUE(refused(kPoints0 + 8, infinite)) << "place of a point";
  EXPECT_TRUE(refused(kPoints0 + 104, 0.0)) << "distance that it was seen from";
  EXPECT_TRUE(refused(kPoints0 + 112, std::uint32_t{8})) << "its octave";
  EXPECT_TRUE(refused(128, ~std::uint32_t{0})) << "a segment that leaves no later one";
  EXPECT_TRUE(refused(kPoints0 + 160, ~std::uint32_t{0})) << "that of a point";
}

TEST_F(KeyframeFile, ACopierGivesTheSameBytesInBoundedParts) {
  Arena arena(KeyframeWriter::kLargestRecord + 4096);
  KeyframeCopier copier(arena);
  copier.begin();
  std::vector<std::byte> all;
  int parts = 0;
  for (bool last = false; !last; ++parts) {
    copier.serve(map(), {});
    const KeyframeCopier::Part part = copier.ready();
    all.insert(all.end(), part.items.begin(), part.items.end());
    last = part.last;
    copier.next();
  }
  EXPECT_GT(parts, 3);
  EXPECT_EQ(all, written());
}

}  // namespace
}  // namespace stillmap
