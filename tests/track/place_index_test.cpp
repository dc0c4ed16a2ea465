// SPDX-License-Identifier: Apache-2.0
#include "track/place_index.h"

#include <gtest/gtest.h>

#include <vector>

#include "scene.h"
#include "track/feature_extractor.h"

namespace stillmap {
namespace {

using Descriptors = std::vector<Descriptor>;

constexpr std::size_t kKeyframes = 12, kFeatures = 400;

Descriptors random_view(Random& random, std::size_t count = kFeatures) {
  Descriptors view(count);
  for (Descriptor& d : view) d = test::random_descriptor(random);
  return view;
}

/// The same corners under another light: each bit flips with this share.
Descriptors seen_again(Descriptors view, Random& random, double share) {
  for (Descriptor& d : view) {
    for (int bit = 0; bit < 256; ++bit) {
      if (random.uniform() < share)
        d.bits[static_cast<std::size_t>(bit / 64)] ^= std::uint64_t{1} << bit % 64;
    }
  }
  return view;
}

class PlaceIndexTest : public testing::Test {
 protected:
  void insert(std::size_t slot, Descriptors view) {
    views[slot] = std::move(view);
    index.insert(slot, views[slot]);
  }
  void fill() {
    for (std::size_t slot = 0; slot < kKeyframes; ++slot) insert(slot, random_view(random));
  }
  Arena arena{std::size_t{16} << 20};
  PlaceIndex index{arena, kKeyframes, kFeatures};
  PlaceQuery query{arena, index};
  std::vector<Descriptors> views{kKeyframes};
  Random random{5};
};

TEST_F(PlaceIndexTest, EveryKeyframeIsRecognisedUnderNoise) {
  fill();
  for (std::size_t slot = 0; slot < kKeyframes; ++slot) {
    const auto found = query.ask(seen_again(views[slot], random, 0.06));
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found[0].slot, slot);
    EXPECT_GT(found[0].score, 0.6) << "as many bits flip between real pictures: most corners keep one key";
    EXPECT_NEAR(found[0].score, static_cast<double>(found[0].features) / kFeatures, 1e-9)
        << "none to share with";
    for (const PlaceCandidate& other : found.subspan(1)) EXPECT_LT(other.score, 0.01) << "other corners";
  }
}

TEST_F(PlaceIndexTest, AnUnknownPlaceScoresNearNothing) {
  fill();
  const auto found = query.ask(random_view(random));
  for (const PlaceCandidate& c : found) EXPECT_LT(c.score, 0.01) << c.slot;
}

TEST_F(PlaceIndexTest, KeyframesShareAFeaturesVoteAndComeByScore) {
  const Descriptors view = random_view(random, 300);
  insert(7, Descriptors(view.begin(), view.begin() + 100));
  insert(2, view);
  insert(9, Descriptors(view.begin(), view.begin() + 200));
  insert(4, view);
  const auto found = query.ask(view);
  ASSERT_EQ(found.size(), 4u);
  constexpr double kAll = 100.0 / 4 / 300, kThree = 100.0 / 3 / 300, kTwo = 100.0 / 2 / 300;
  EXPECT_EQ(found[0].slot, 2u);
  EXPECT_NEAR(found[0].score, kAll + kThree + kTwo, 1e-9);
  EXPECT_EQ(found[1].slot, 4u) << "equal: by slot";
  EXPECT_NEAR(found[1].score, kAll + kThree + kTwo, 1e-9);
  EXPECT_EQ(found[2].slot, 9u);
  EXPECT_NEAR(found[2].score, kAll + kThree, 1e-9);
  EXPECT_EQ(found[2].features, 200);
  EXPECT_EQ(found[3].slot, 7u);
  EXPECT_NEAR(found[3].score, kAll, 1e-9);
}

TEST_F(PlaceIndexTest, BitByBitIsAsAllAtOnce) {
  fill();
  const Descriptors frame = seen_again(views[7], random, 0.06);
  const auto at_once = query.ask(frame);
  PlaceQuery slow{arena, index};
  slow.begin(frame);
  int calls = 1;
  while (!slow.vote(query.visited() / 5 + 1)) ++calls;
  EXPECT_EQ(calls, 5);
  const auto bit_by_bit = slow.ranked();
  ASSERT_EQ(bit_by_bit.size(), at_once.size());
  for (std::size_t i = 0; i < at_once.size(); ++i) {
    EXPECT_EQ(bit_by_bit[i].slot, at_once[i].slot);
    EXPECT_EQ(bit_by_bit[i].score, at_once[i].score);
  }
}

TEST_F(PlaceIndexTest, AFeatureCountsOnceForAKeyframe) {
  // Agrees in every key with all of the keyframe's features.
  const Descriptor d = test::random_descriptor(random);
  insert(0, Descriptors(kFeatures, d));
  const auto found = query.ask(Descriptors(3, d));
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].features, 3);
}

TEST_F(PlaceIndexTest, AFarDescriptorInTheSameBucketDoesNotVote) {
  Descriptor d = test::random_descriptor(random);
  insert(0, {d});
  int met = 0;
  for (int round = 0; round < 40; ++round) {
    Descriptors other = seen_again({d}, random, 0.15);
    if (hamming(other[0], d) < 30) continue;
    EXPECT_TRUE(query.ask(other).empty());
    met += query.visited() > 0;
  }
  EXPECT_GT(met, 0);
}

TEST_F(PlaceIndexTest, AReusedSlotForgetsWhatItHeld) {
  fill();
  const Descriptors old = views[3];
  // The ring writes a new keyframe over the old one's descriptors before the index hears of it.
  views[3] = random_view(random);
  index.insert(3, views[3]);
  for (const PlaceCandidate& c : query.ask(old)) EXPECT_LT(c.score, 0.01) << c.slot;
  EXPECT_EQ(query.ask(views[3])[0].slot, 3u);
  index.remove(3);
  for (const PlaceCandidate& c : query.ask(views[3])) EXPECT_NE(c.slot, 3u);
  for (const std::size_t slot : {0u, 2u, 4u, 11u}) {
    ASSERT_FALSE(query.ask(views[slot]).empty());
    EXPECT_EQ(query.ask(views[slot])[0].features, static_cast<int>(kFeatures)) << "neighbours keep theirs";
  }
  index.clear();
  EXPECT_TRUE(query.ask(views[0]).empty());
}

TEST_F(PlaceIndexTest, ManyReplacementsLeaveNothingBehind) {
  for (int round = 0; round < 40; ++round)
    insert(static_cast<std::size_t>(round) % kKeyframes, random_view(random, 200));
  PlaceIndex fresh{arena, kKeyframes, kFeatures};
  for (std::size_t slot = 0; slot < kKeyframes; ++slot) fresh.insert(slot, views[slot]);
  const Descriptors frame = seen_again(views[5], random, 0.15);
  PlaceQuery of_fresh{arena, fresh};
  const auto a = query.ask(frame), b = of_fresh.ask(frame);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].slot, b[i].slot);
    EXPECT_EQ(a[i].score, b[i].score);
  }
  EXPECT_EQ(query.visited(), of_fresh.visited());
}

/// Wallpaper, or an attack: every corner everywhere looks the same.
TEST_F(PlaceIndexTest, EqualDescriptorsDoNotMakeItSlow) {
  const Descriptor d = test::random_descriptor(random);
  for (std::size_t slot = 0; slot < kKeyframes; ++slot) insert(slot, Descriptors(kFeatures, d));
  const auto found = query.ask(Descriptors(kFeatures, d));
  ASSERT_EQ(found.size(), kKeyframes);
  for (const PlaceCandidate& c : found) EXPECT_EQ(c.features, static_cast<int>(kFeatures));
  EXPECT_LE(query.visited(), kFeatures * PlaceIndex::kTables * kKeyframes) << "not times features once more";
  for (std::size_t slot = 0; slot < kKeyframes; ++slot) index.remove(slot);
  EXPECT_TRUE(query.ask(Descriptors(kFeatures, d)).empty());
}

TEST_F(PlaceIndexTest, NothingAndTooMuch) {
  EXPECT_TRUE(query.ask({}).empty());
  EXPECT_TRUE(query.ask(random_view(random)).empty()) << "an empty index";
  insert(0, {});
  EXPECT_TRUE(query.ask(random_view(random)).empty());
  insert(0, random_view(random, kFeatures + 50));
  EXPECT_EQ(query.ask(views[0])[0].features, static_cast<int>(kFeatures))
      << "what is over capacity is left out";
}

TEST(PlaceIndex, ThePlanIsWhatItTakes) {
  Arena plan;
  const PlaceIndex planned(plan, 64, 1200);
  const PlaceQuery planned_query(plan, planned);
  EXPECT_LT(plan.bytes_planned(), std::size_t{4} << 20);
  Arena arena(plan.bytes_planned());
  const PlaceIndex index(arena, 64, 1200);
  const PlaceQuery query(arena, index);
  EXPECT_EQ(arena.bytes_planned(), plan.bytes_planned());
}

/// Real corners of a rendered room: the keyframe seen from nearest wins clearly.
TEST(PlaceIndex, RenderedViewsAreRecognised) {
  const Config config = test::synthetic_config();
  Arena arena(test::kArenaBytes);
  FeatureExtractor extractor(arena, config.track, config.camera);
  FrameFeatures frame(arena, 1200);
  PlaceIndex index(arena, 8, 1200);
  PlaceQuery query(arena, index);
  synthetic::SyntheticLog log({.seed = 3, .people = 0});
  std::vector<Descriptors> views;
  const auto extract = [&](int picture) {
    const test::Scene scene(log, picture);
    extractor.extract(scene.grey.view(), frame);
  };
  constexpr int kApart = 60;  // pictures between two keyframes
  for (int k = 0; k < 3; ++k) {
    extract(kApart * k);
    views.emplace_back(frame.descriptors.begin(), frame.descriptors.end());
  }
  for (std::size_t k = 0; k < views.size(); ++k) index.insert(k, views[k]);
  for (std::size_t k = 0; k < views.size(); ++k) {
    extract(kApart * static_cast<int>(k) + 6);
    const auto found = query.ask(frame.descriptors);
    ASSERT_GE(found.size(), 2u);
    EXPECT_EQ(found[0].slot, k);
    EXPECT_GT(found[0].score, 1.5 * found[1].score) << k;
  }
}

}  // namespace
}  // namespace stillmap
