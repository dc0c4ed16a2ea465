// SPDX-License-Identifier: Apache-2.0
#include "map/map_copier.h"

#include <algorithm>

namespace stillmap {

void MapCopier::serve(const BlockTable& table) {
  const State state = state_.load(std::memory_order_acquire);
  if (state != State::WantFirst && state != State::WantMore) return;
  if (state == State::WantFirst) next_block_ = 0;
  for (copied_ = 0; copied_ < copies_.size() && next_block_ < table.size(); ++next_block_) {
    if (!table.found(next_block_)) continue;
    copies_[copied_].block = table.block(next_block_);
    std::ranges::copy(table.voxels(next_block_), copies_[copied_].voxels.begin());
    ++copied_;
  }
  last_ = next_block_ >= table.size();
  state_.store(State::Ready, std::memory_order_release);
}

void MapCopier::begin() {
  if (state_.load(std::memory_order_acquire) == State::Idle)
    state_.store(State::WantFirst, std::memory_order_release);
}

MapCopier::Copies MapCopier::ready() const {
  if (state_.load(std::memory_order_acquire) != State::Ready) return {};
  return {copies_.first(copied_), last_};
}

void MapCopier::next() {
  if (state_.load(std::memory_order_acquire) != State::Ready) return;
  state_.store(last_ ? State::Idle : State::WantMore, std::memory_order_release);
}

}  // namespace stillmap
