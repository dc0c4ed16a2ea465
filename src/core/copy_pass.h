// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <span>

namespace stillmap {

/// Hands something large to another thread while its owner goes on changing it: one buffer's worth at a time,
/// filled by the owner when the reader has asked. Neither side waits.
template <class T>
class CopyPass {
 public:
  explicit CopyPass(std::span<T> buffer) : buffer_(buffer) {}

  /// Owner's thread, now and then. Where the reader has asked, calls `fill(bool first, std::span<T> buffer)`,
  /// which gives how much it filled and whether that was the last.
  struct Filled {
    std::size_t size = 0;
    bool last = false;
  };
  template <class Fill>
  void serve(Fill&& fill) {
    const State state = state_.load(std::memory_order_acquire);
    if (state != State::WantFirst && state != State::WantMore) return;
    filled_ = fill(state == State::WantFirst, buffer_);
    state_.store(State::Ready, std::memory_order_release);
  }

  /// Reader's thread. Asks for the first part, when no pass is under way.
  void begin() {
    if (state_.load(std::memory_order_acquire) == State::Idle)
      state_.store(State::WantFirst, std::memory_order_release);
  }
  /// Reader's thread. The next part, or none yet (empty and not `last`). `next` gives it back.
  struct Part {
    std::span<const T> items;
    bool last = false;
  };
  Part ready() const {
    if (state_.load(std::memory_order_acquire) != State::Ready) return {};
    return {buffer_.first(filled_.size), filled_.last};
  }
  /// Reader's thread, done with what `ready` gave: asks for the next part, or ends the pass.
  void next() {
    if (state_.load(std::memory_order_acquire) != State::Ready) return;
    state_.store(filled_.last ? State::Idle : State::WantMore, std::memory_order_release);
  }

 private:
  enum class State : int { Idle, WantFirst, WantMore, Ready };
  std::span<T> buffer_;
  std::atomic<State> state_{State::Idle};  // the reader's, but in the Want states the owner's
  Filled filled_;                          // as state_
};

}  // namespace stillmap
