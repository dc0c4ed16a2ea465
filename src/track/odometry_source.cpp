// SPDX-License-Identifier: Apache-2.0
#include "track/odometry_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace stillmap {

namespace {

constexpr Nanoseconds kAhead_ns = 50'000'000;

}  // namespace

bool OdometrySource::try_push(const MotionDelta& delta) {
  const bool sure = std::isfinite(delta.sigma_rotation_rad) && std::isfinite(delta.sigma_translation_m) &&
                    delta.sigma_rotation_rad > 0 && delta.sigma_translation_m > 0;
  if (delta.to_ns <= delta.from_ns || !sure || !is_finite(delta.T_from_to)) return false;
  return waiting_.try_push(MotionDelta(delta));
}

void OdometrySource::take_waiting() {
  while (const std::optional<MotionDelta> delta = waiting_.try_pop()) {
    if (chain_.empty() || chain_[chain_.size() - 1].stamp_ns != delta->from_ns) {
      chain_.clear();
      Sample begin;
      begin.stamp_ns = delta->from_ns;
      static_cast<void>(chain_.try_push_back(begin));
    } else if (chain_.size() == chain_.capacity()) {
      const auto newer = static_cast<std::ptrdiff_t>(chain_.size() / 2);
      std::move(chain_.begin() + newer, chain_.end(), chain_.begin());
      chain_.truncate(chain_.size() / 2);
    }
    const Sample& before = chain_[chain_.size() - 1];
    Pose T_begin_base = before.T_begin_base * delta->T_from_to;
    T_begin_base.R = orthonormalized(T_begin_base.R);  // after hours of steps, too
    static_cast<void>(chain_.try_push_back(
        {delta->to_ns, T_begin_base,
         before.variance_rotation + delta->sigma_rotation_rad * delta->sigma_rotation_rad,
         before.variance_translation + delta->sigma_translation_m * delta->sigma_translation_m}));
  }
}

std::optional<OdometrySource::Sample> OdometrySource::at(Nanoseconds stamp_ns) const {
  if (chain_.size() < 2 || stamp_ns < chain_[0].stamp_ns ||
      stamp_ns > chain_[chain_.size() - 1].stamp_ns + kAhead_ns)
    return std::nullopt;
  // The first sample that is not before; beyond the end, the last step goes on.
  const auto not_before =
      std::lower_bound(chain_.begin() + 1, chain_.end() - 1, stamp_ns,
                       [](const Sample& sample, Nanoseconds stamp) { return sample.stamp_ns < stamp; });
  const Sample &a = *(not_before - 1), &b = *not_before;
  const double share = to_seconds(stamp_ns - a.stamp_ns) / to_seconds(b.stamp_ns - a.stamp_ns);
  const auto along = [share](double from, double to) { return from + share * (to - from); };
  return Sample{stamp_ns, interpolate(a.T_begin_base, b.T_begin_base, share),
                along(a.variance_rotation, b.variance_rotation),
                along(a.variance_translation, b.variance_translation)};
}

std::optional<MotionDelta> OdometrySource::between(Nanoseconds from_ns, Nanoseconds to_ns) {
  take_waiting();
  const std::optional<Sample> from = at(from_ns), to = at(to_ns);
  if (!from || !to) return std::nullopt;
  return MotionDelta{from_ns, to_ns, inverse(from->T_begin_base) * to->T_begin_base,
                     std::sqrt(std::abs(to->variance_rotation - from->variance_rotation)),
                     std::sqrt(std::abs(to->variance_translation - from->variance_translation))};
}

}  // namespace stillmap
