// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "core/arena.h"
#include "core/feature.h"

namespace stillmap {

/// A keyframe that a frame may show again.
struct PlaceCandidate {
  std::size_t slot = 0;  ///< the keyframe's
  int features = 0;      ///< of the frame that resemble one of the keyframe's
  double score = 0;      ///< the keyframe's part of the frame's votes, 0 to 1
};

/// Recognises places by descriptors alone, without a vocabulary: locality-sensitive hashing (Indyk and
/// Motwani, STOC 1998). Descriptors that agree in all sixteen bits of one of a few keys are compared in full.
/// Each feature has one vote, which the keyframes that it resembles share: what is seen everywhere says
/// nothing. Used by one thread; no heap after construction.
///
/// Time is bounded whatever the descriptors are: a bucket holds one feature per keyframe at most.
class PlaceIndex {
 public:
  /// For `keyframes` keyframes with `features` features each (both below 65536); features beyond that are
  /// left out.
  PlaceIndex(Arena& arena, std::size_t keyframes, std::size_t features);

  /// Keyframe `slot` looks like this now; what it looked like before is forgotten. The descriptors are not
  /// copied: they must stay as they are as long as queries come and the slot is neither inserted again nor
  /// removed. (The ring may write a new keyframe over them before it is inserted.)
  void insert(std::size_t slot, std::span<const Descriptor> descriptors);
  void remove(std::size_t slot);
  void clear();

  std::size_t keyframes() const { return keyframes_; }
  /// What is inserted as this keyframe.
  std::span<const Descriptor> descriptors(std::size_t slot) const { return places_[slot]; }
  /// Calls `visit(slot, descriptor)` for every feature whose key agrees with this descriptor's in one table:
  /// a keyframe may come several times, and what it shows may look different all the same. All tables at
  /// once: every step along a chain waits for memory, of several chains for all of them together.
  template <class Visit>
  void for_each_alike(const Descriptor& d, Visit&& visit) const {
    std::array<std::uint16_t, kTables> keys;
    std::array<Node, kTables> nodes;
    for (std::size_t t = 0; t < kTables; ++t) {
      keys[t] = tables_[t].key_of(d);
      nodes[t] = tables_[t].head(keys[t]);
    }
    for (bool more = true; more;) {
      more = false;
      for (std::size_t t = 0; t < kTables; ++t) {
        const Node node = nodes[t];
        if (node == kEnd) continue;
        more = true;
        nodes[t] = tables_[t].next[at(node)];
        if (tables_[t].keys[at(node)] == keys[t])
          visit(slot_of(node), places_[slot_of(node)][feature_of(node)]);
      }
    }
  }

  static constexpr std::size_t kTables = 5, kKeyBits = 16;

 private:
  // Chains are shared by keys that differ in their first bits alone: a quarter of the memory, and a look at
  // the key for each node.
  static constexpr std::size_t kBucketBits = 14;
  /// One feature of one keyframe: slot << 16 | feature. Links of this form need no division to follow.
  using Node = std::uint32_t;
  static constexpr Node kEnd = ~Node{0};
  /// Chains of nodes by the last bits of their keys, the newest first. Dense arrays: what is walked along
  /// must stay in the cache.
  struct Table {
    std::array<std::uint8_t, kKeyBits> bits{};  // of the descriptor, that make the key
    std::span<Node> heads;                      // by kBucketBits of the key
    std::span<Node> next;                       // by node
    std::span<Node> before;         // by node: itself where it is the first; kEnd where it is in no chain
    std::span<std::uint16_t> keys;  // by node: its descriptor may be gone when it is taken out
    std::uint16_t key_of(const Descriptor& d) const;
    Node& head(std::uint16_t key) const { return heads[key % (std::size_t{1} << kBucketBits)]; }
  };
  static std::size_t slot_of(Node node) { return node >> 16; }
  static std::size_t feature_of(Node node) { return node & 0xffff; }
  std::size_t at(Node node) const { return slot_of(node) * features_ + feature_of(node); }
  void take_out(Table& table, Node node);

  std::size_t keyframes_, features_;
  std::array<Table, kTables> tables_;
  std::span<std::span<const Descriptor>> places_;
};

/// Which keyframes of an index a frame resembles. All at once, or over as many frames as the time of one
/// allows. No heap after construction.
class PlaceQuery {
 public:
  /// `index` must outlive the query.
  PlaceQuery(Arena& arena, const PlaceIndex& index);

  /// Best score first, ties by slot. Valid until the next call.
  std::span<const PlaceCandidate> ask(std::span<const Descriptor> frame) {
    begin(frame);
    vote(std::numeric_limits<std::uint64_t>::max());
    return ranked();
  }
  /// The same bit by bit: the descriptors must stay as they are until all have voted. A keyframe that is
  /// inserted meanwhile has the votes of what was in its slot before, too.
  void begin(std::span<const Descriptor> frame);
  /// The next features vote, until `visits` more have been met in buckets. True once all have voted.
  bool vote(std::uint64_t visits);
  std::span<const PlaceCandidate> ranked();

  /// Features that have been met in buckets: what its time is made of.
  std::uint64_t visited() const { return visited_; }

 private:
  struct Votes {
    int features = 0;
    double share = 0;
    std::size_t last_voter = 0;  // counted from 1
  };

  const PlaceIndex& index_;
  std::span<Votes> votes_;                // by slot
  ArenaVector<std::uint32_t> resembled_;  // keyframes, by the feature that votes
  ArenaVector<PlaceCandidate> candidates_;
  std::span<const Descriptor> frame_;
  std::size_t voted_ = 0;
  std::uint64_t visited_ = 0;
};

}  // namespace stillmap
