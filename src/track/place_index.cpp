// SPDX-License-Identifier: Apache-2.0
#include "track/place_index.h"

#include <algorithm>
#include <cstdlib>
#include <numeric>

#include "core/check.h"
#include "track/descriptor_pattern.h"

namespace stillmap {

namespace {

constexpr int kMaxDistance = 24;  // Hamming, of 256: nearer than most corners' nearest stranger

/// The descriptor's bits, those first that come out 0 as often as 1. A patch is turned until its bright side
/// is at +x, so a pair that lies along x nearly always compares the same way (the mean of a bit correlates
/// with its pair's extent in x by 0.96 on real pictures), and keys of such bits fall into few buckets.
std::array<std::uint8_t, DescriptorPattern::kBits> most_even_bits() {
  const DescriptorPattern pattern;
  const DescriptorPattern::Pairs& pairs = pattern.at_angle(0);
  std::array<std::uint8_t, DescriptorPattern::kBits> bits{};
  std::iota(bits.begin(), bits.end(), std::uint8_t{0});
  const auto extent = [&](std::uint8_t bit) { return std::abs(pairs[bit].x1 - pairs[bit].x0); };
  std::stable_sort(bits.begin(), bits.end(),
                   [&](std::uint8_t a, std::uint8_t b) { return extent(a) < extent(b); });
  return bits;
}

}  // namespace

std::uint16_t PlaceIndex::Table::key_of(const Descriptor& d) const {
  std::uint32_t key = 0;
  for (const std::uint8_t bit : bits) key = key << 1 | (d.bits[bit / 64] >> bit % 64 & 1);
  return static_cast<std::uint16_t>(key);
}

PlaceIndex::PlaceIndex(Arena& arena, std::size_t keyframes, std::size_t features)
    : keyframes_(keyframes),
      features_(features),
      places_(arena.take<std::span<const Descriptor>>("places", keyframes)) {
  STILLMAP_CHECK(keyframes < 0xffff && features < 0xffff);
  const auto even = most_even_bits();
  for (std::size_t t = 0; t < kTables; ++t) {
    Table& table = tables_[t];
    for (std::size_t i = 0; i < kKeyBits; ++i) table.bits[i] = even[kTables * i + t];
    table.heads = arena.take<std::uint32_t>("places.buckets", std::size_t{1} << kBucketBits);
    table.next = arena.take<std::uint32_t>("places.chains", keyframes * features);
    table.before = arena.take<std::uint32_t>("places.chains_back", keyframes * features);
    table.keys = arena.take<std::uint16_t>("places.keys", keyframes * features);
  }
  clear();
}

void PlaceIndex::clear() {
  for (Table& table : tables_) std::fill(table.heads.begin(), table.heads.end(), kEnd);
  std::ranges::fill(places_, std::span<const Descriptor>{});
}

void PlaceIndex::take_out(Table& table, Node node) {
  const Node before = table.before[at(node)], next = table.next[at(node)];
  if (before == kEnd) return;
  const bool first = before == node;
  (first ? table.head(table.keys[at(node)]) : table.next[at(before)]) = next;
  if (next != kEnd) table.before[at(next)] = first ? next : before;
}

void PlaceIndex::remove(std::size_t slot) {
  const auto first = static_cast<Node>(slot << 16);
  for (Table& table : tables_) {
    for (Node i = 0; i < places_[slot].size(); ++i) take_out(table, first + i);
  }
  places_[slot] = {};
}

void PlaceIndex::insert(std::size_t slot, std::span<const Descriptor> descriptors) {
  remove(slot);
  descriptors = descriptors.first(std::min(descriptors.size(), features_));
  places_[slot] = descriptors;
  const auto first = static_cast<Node>(slot << 16);
  for (Table& table : tables_) {
    for (Node i = 0; i < descriptors.size(); ++i) {
      const Node node = first + i;
      const std::uint16_t key = table.key_of(descriptors[i]);
      Node& head = table.head(key);
      // This keyframe's nodes are the chain's first: what it repeats is kept once.
      Node own = head;
      while (own != kEnd && slot_of(own) == slot && table.keys[at(own)] != key) own = table.next[at(own)];
      const bool repeats = own != kEnd && slot_of(own) == slot;
      table.before[at(node)] = repeats ? kEnd : node;
      if (repeats) continue;
      table.keys[at(node)] = key;
      table.next[at(node)] = head;
      if (head != kEnd) table.before[at(head)] = node;
      head = node;
    }
  }
}

PlaceQuery::PlaceQuery(Arena& arena, const PlaceIndex& index)
    : index_(index),
      votes_(arena.take<Votes>("places.votes", index.keyframes())),
      resembled_(arena.take<std::uint32_t>("places.resembled", index.keyframes())),
      candidates_(arena.take<PlaceCandidate>("places.candidates", index.keyframes())) {}

void PlaceQuery::begin(std::span<const Descriptor> frame) {
  frame_ = frame;
  voted_ = 0;
  visited_ = 0;
  std::ranges::fill(votes_, Votes{});
}

bool PlaceQuery::vote(std::uint64_t visits) {
  const std::uint64_t before = visited_;
  while (voted_ < frame_.size() && visited_ - before < visits) {
    const Descriptor& d = frame_[voted_++];
    resembled_.clear();
    index_.for_each_alike(d, [&](std::size_t slot, const Descriptor& other) {
      ++visited_;
      Votes& votes = votes_[slot];
      if (votes.last_voter == voted_ || hamming(d, other) > kMaxDistance) return;
      votes.last_voter = voted_;
      ++votes.features;
      static_cast<void>(resembled_.try_push_back(static_cast<std::uint32_t>(slot)));
    });
    const double share = 1 / static_cast<double>(resembled_.size());
    for (const std::uint32_t slot : resembled_) votes_[slot].share += share;
  }
  return voted_ == frame_.size();
}

std::span<const PlaceCandidate> PlaceQuery::ranked() {
  candidates_.clear();
  for (std::size_t slot = 0; slot < votes_.size(); ++slot) {
    const Votes& votes = votes_[slot];
    if (votes.features == 0) continue;
    const double score = votes.share / static_cast<double>(frame_.size());
    static_cast<void>(candidates_.try_push_back({slot, votes.features, score}));
  }
  std::ranges::sort(candidates_, [](const PlaceCandidate& a, const PlaceCandidate& b) {
    return a.score != b.score ? a.score > b.score : a.slot < b.slot;
  });
  return candidates_;
}

}  // namespace stillmap
