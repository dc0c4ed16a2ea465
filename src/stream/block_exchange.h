// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "stream/encoding.h"
#include "stream/handover.h"
#include "stream/stream_types.h"

namespace stillmap::stream {

/// What one client needs of the map's blocks next: those from slot `cursor` on that changed after `since`.
struct BlockRequest {
  std::uint64_t since = 0;
  std::uint32_t cursor = 0;
};

/// What the map's thread says beside the blocks.
struct BlockAnswer {
  std::uint32_t next = 0;     ///< the slot to go on with
  bool complete = false;      ///< there is none
  std::uint64_t version = 0;  ///< what the map's newest change counts as, of a scan that began no later
  std::uint32_t epoch = 0;    ///< the newest correction that the whole map follows
  double voxel_m = 0;
  Nanoseconds stamp_ns = 0;
};

/// One client's buffer for /map/blocks. The map's thread answers a request with as many blocks as fit; the
/// client is sent them, and the next request asks from where that answer ended. A pass through all slots
/// brings what has changed since the pass before began; a slow client's passes take longer, and each brings
/// the newest.
class BlockExchange {
 public:
  /// At start: `memory` is for the blocks of one message.
  void use(std::span<std::uint8_t> memory) { memory_ = memory; }

  /// Map thread. Whether there is a request, which is to be followed by add() and finish().
  bool begin() {
    if (!turn_.begin()) return false;
    used_ = 0;
    return true;
  }
  const BlockRequest& request() const { return request_; }
  /// Map thread. False, and nothing is stored, when the message is full.
  [[nodiscard]] bool add(const StreamBlock& block) {
    const std::size_t bytes = encode_block(block, memory_.subspan(used_));
    used_ += bytes;
    return bytes > 0;
  }
  /// Map thread.
  void finish(const BlockAnswer& answer) {
    answer_ = answer;
    turn_.finish();
  }

  /// Stream thread. Asks; the answer is there once `answered()`.
  void ask(const BlockRequest& request) {
    request_ = request;
    turn_.offer();
  }
  void reclaim() { turn_.reclaim(); }
  bool answered() const { return turn_.readable(); }
  /// Stream thread, once answered.
  std::span<const std::uint8_t> blocks() const { return memory_.first(used_); }
  const BlockAnswer& answer() const { return answer_; }

 private:
  Handover turn_;
  std::span<std::uint8_t> memory_;
  BlockRequest request_;
  std::size_t used_ = 0;
  BlockAnswer answer_;
};

}  // namespace stillmap::stream
