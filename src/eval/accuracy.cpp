// SPDX-License-Identifier: Apache-2.0
#include "eval/accuracy.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "core/absolute_orientation.h"
#include "core/text_table.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kMatchWindow_ns = 20'000'000;
constexpr Nanoseconds kSecond_ns = 1'000'000'000;
constexpr Nanoseconds kSecondTolerance_ns = 100'000'000;

/// One estimated pose and the ground truth of its moment.
struct Match {
  Nanoseconds stamp_ns;  // the estimate's
  Pose truth, estimate;
};

Nanoseconds stamp_of(const StampedPose& p) {
  return p.stamp_ns;
}
Nanoseconds stamp_of(const Match& m) {
  return m.stamp_ns;
}

/// Index of the item nearest in time; the earlier of two equally near. `items` must not be empty.
template <class Items>
std::size_t nearest(const Items& items, Nanoseconds stamp_ns) {
  const auto after = std::lower_bound(items.begin(), items.end(), stamp_ns,
                                      [](const auto& item, Nanoseconds t) { return stamp_of(item) < t; });
  const auto i = static_cast<std::size_t>(after - items.begin());
  if (i == items.size()) return i - 1;
  return i > 0 && stamp_ns - stamp_of(items[i - 1]) <= stamp_of(items[i]) - stamp_ns ? i - 1 : i;
}

bool has_truth(std::span<const StampedPose> groundtruth, Nanoseconds stamp_ns) {
  const Nanoseconds truth_ns = groundtruth[nearest(groundtruth, stamp_ns)].stamp_ns;
  return std::abs(truth_ns - stamp_ns) <= kMatchWindow_ns;
}

std::vector<Match> match(std::span<const StampedPose> groundtruth, std::span<const StampedPose> estimate) {
  std::vector<Match> matches;
  for (const StampedPose& p : estimate) {
    if (groundtruth.empty() || !has_truth(groundtruth, p.stamp_ns)) continue;
    matches.push_back(
        {p.stamp_ns, groundtruth[nearest(groundtruth, p.stamp_ns)].T_world_camera, p.T_world_camera});
  }
  return matches;
}

/// The rigid transform that takes the estimate's positions nearest to the truth's; of a path along a line one
/// of many.
Pose alignment(std::span<const Match> matches) {
  std::vector<Vec3> estimate, truth;
  for (const Match& m : matches) {
    estimate.push_back(m.estimate.t);
    truth.push_back(m.truth.t);
  }
  return absolute_orientation(estimate, truth).T_to_from;
}

/// Root mean square and maximum of values as they come.
struct ErrorSum {
  double squares = 0, max = 0;
  std::size_t count = 0;
  void add(double v) {
    squares += v * v;
    max = std::max(max, v);
    ++count;
  }
  double rmse() const {
    return count == 0 ? std::numeric_limits<double>::quiet_NaN()
                      : std::sqrt(squares / static_cast<double>(count));
  }
};

/// E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j) with truth Q and estimate P (Sturm et al. 2012, eq. 1).
Pose relative_error(const Match& i, const Match& j) {
  return inverse(inverse(i.truth) * j.truth) * (inverse(i.estimate) * j.estimate);
}

void relative_errors(const std::vector<Match>& matches, Accuracy& accuracy) {
  ErrorSum second_m, second_deg, frame_m;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (i + 1 < matches.size()) frame_m.add(norm(relative_error(matches[i], matches[i + 1]).t));
    const std::size_t j = nearest(matches, matches[i].stamp_ns + kSecond_ns);
    const Nanoseconds span_ns = matches[j].stamp_ns - matches[i].stamp_ns;
    if (j + 1 == matches.size() || std::abs(span_ns - kSecond_ns) > kSecondTolerance_ns) continue;
    const Pose error = relative_error(matches[i], matches[j]);
    second_m.add(norm(error.t));
    second_deg.add(norm(log_so3(error.R)) * 180 / std::numbers::pi);
  }
  accuracy.rpe_1s_rmse_m = second_m.rmse();
  accuracy.rpe_1s_rmse_deg = second_deg.rmse();
  accuracy.rpe_frame_rmse_m = frame_m.rmse();
}

double coverage_of(std::span<const StampedPose> groundtruth, std::size_t matches,
                   std::span<const Nanoseconds> frame_stamps) {
  if (frame_stamps.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto possible = std::count_if(frame_stamps.begin(), frame_stamps.end(),
                                      [&](Nanoseconds t) { return has_truth(groundtruth, t); });
  return std::min(1.0, static_cast<double>(matches) / std::max(static_cast<double>(possible), 1.0));
}

Error wrong(std::string message) {
  return {ExitCode::UnreadableInput, std::move(message)};
}

/// Nothing, or why the trajectory cannot be compared.
Status check(const char* name, std::span<const StampedPose> poses) {
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!is_finite(poses[i].T_world_camera)) {
      return wrong(std::string(name) + ": the pose at " + stamp_text(poses[i].stamp_ns) + " s is not finite");
    }
    if (i > 0 && poses[i].stamp_ns <= poses[i - 1].stamp_ns) {
      return wrong(std::string(name) + ": the stamps do not rise at " + stamp_text(poses[i].stamp_ns) + " s");
    }
  }
  return {};
}

std::string span_text(std::span<const StampedPose> poses) {
  if (poses.empty()) return "empty";
  return stamp_text(poses.front().stamp_ns) + " to " + stamp_text(poses.back().stamp_ns) + " s";
}

}  // namespace

Result<Accuracy> evaluate(std::span<const StampedPose> groundtruth, std::span<const StampedPose> estimate,
                          std::span<const Nanoseconds> frame_stamps) {
  if (Status s = check("ground truth", groundtruth); !s.ok()) return s.error();
  if (Status s = check("estimate", estimate); !s.ok()) return s.error();
  const std::vector<Match> matches = match(groundtruth, estimate);
  if (matches.size() < 3) {
    return wrong(
        "accuracy: only " + std::to_string(matches.size()) + " of " + std::to_string(estimate.size()) +
        " poses have ground truth within 20 ms, at least 3 are needed (estimate " + span_text(estimate) +
        ", ground truth " + span_text(groundtruth) + "); give the ground truth of this very log");
  }
  Accuracy accuracy;
  accuracy.matched_poses = matches.size();
  accuracy.coverage = coverage_of(groundtruth, matches.size(), frame_stamps);
  const Pose T_truth_estimate = alignment(matches);
  ErrorSum absolute;
  for (const Match& m : matches) absolute.add(norm(T_truth_estimate * m.estimate.t - m.truth.t));
  accuracy.ate_rmse_m = absolute.rmse();
  accuracy.ate_max_m = absolute.max;
  relative_errors(matches, accuracy);
  return accuracy;
}

}  // namespace stillmap
