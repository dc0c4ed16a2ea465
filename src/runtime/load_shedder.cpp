// SPDX-License-Identifier: Apache-2.0
#include "runtime/load_shedder.h"

#include <algorithm>

namespace stillmap {

LoadShedder::Change LoadShedder::note(Nanoseconds latency, bool lost_frames) {
  if (warm_up_ > 0) {
    --warm_up_;
    return Change::None;
  }
  const bool late = lost_frames || latency > period_;
  const bool calm = !late && static_cast<double>(latency) < kCalmShare * static_cast<double>(period_);
  late_ += late;
  calm_ = late ? std::max(calm_ - kCalmCostOfLate, 0) : calm_ + calm;
  since_raise_ = std::min(since_raise_ + 1, kCalmToRaise);
  if (++seen_ == kWindow || late_ == kLateToLower) {
    const bool lower = late_ == kLateToLower && step_ + 1 < static_cast<int>(kSheddingPlan.size());
    seen_ = late_ = 0;
    if (lower) {
      const bool raised_too_early = last_ == Change::Raised && since_raise_ < kCalmToRaise;
      if (raised_too_early) patience_ = std::min(2 * patience_, kMostPatience);
      calm_ = 0;
      ++step_;
      return last_ = Change::Lowered;
    }
  }
  if (step_ == 0 || calm_ < kCalmToRaise * patience_) return Change::None;
  if (last_ == Change::Raised) patience_ = std::max(patience_ / 2, 1);
  calm_ = since_raise_ = 0;
  --step_;
  return last_ = Change::Raised;
}

}  // namespace stillmap
