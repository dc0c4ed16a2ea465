// SPDX-License-Identifier: Apache-2.0
#include "eval/accuracy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <random>
#include <sstream>

#include "tests/support/shared_folder.h"
#include "tests/support/temporary_folder.h"

namespace stillmap {
namespace {

using testing::HasSubstr;

constexpr Nanoseconds kStart_ns = 1305031239529662000;
constexpr Nanoseconds kFrame_ns = 33'333'333;

Nanoseconds ns(double seconds) {
  return static_cast<Nanoseconds>(std::llround(seconds * 1e9));
}

/// A curved walk with turns, at any moment.
StampedPose truth_at(double s) {
  const Vec3 turn{0.7 * std::sin(1.3 * s), 0.9 * s, 0.4 * std::cos(0.8 * s)};
  return {kStart_ns + ns(s), {exp_so3(turn), {std::sin(s), 0.3 * s, std::cos(0.7 * s)}}};
}

std::vector<StampedPose> truth(int poses = 600) {
  std::vector<StampedPose> out;
  for (int i = 0; i < poses; ++i) out.push_back(truth_at(0.01 * i));
  return out;
}

/// Every n-th pose of the truth, in another world frame: a perfect estimate.
std::vector<StampedPose> perfect(const std::vector<StampedPose>& groundtruth, std::size_t every = 10) {
  const Pose T_other_world{exp_so3({1, -2, 0.5}), {10, -20, 30}};
  std::vector<StampedPose> out;
  for (std::size_t i = 0; i < groundtruth.size(); i += every) {
    out.push_back({groundtruth[i].stamp_ns, T_other_world * groundtruth[i].T_world_camera});
  }
  return out;
}

Accuracy accuracy_of(const std::vector<StampedPose>& groundtruth, const std::vector<StampedPose>& estimate,
                     const std::vector<Nanoseconds>& frames = {}) {
  const auto result = evaluate(groundtruth, estimate, frames);
  EXPECT_TRUE(result.ok()) << result.error().message;
  return result.ok() ? result.value() : Accuracy{};
}

TEST(Accuracy, APerfectEstimateInAnotherFrameHasNoError) {
  const Accuracy a = accuracy_of(truth(), perfect(truth()));
  EXPECT_LT(a.ate_rmse_m, 1e-9);
  EXPECT_LT(a.ate_max_m, 1e-9);
  EXPECT_LT(a.rpe_1s_rmse_m, 1e-9);
  EXPECT_LT(a.rpe_1s_rmse_deg, 1e-6);
  EXPECT_LT(a.rpe_frame_rmse_m, 1e-9);
  EXPECT_EQ(a.matched_poses, 60u);
}

TEST(Accuracy, ScaleIsAnError) {
  // Straight along x from 0 to 5.9 m, estimated at 110 %: each second is 0.1 m too long.
  std::vector<StampedPose> groundtruth, estimate;
  for (int i = 0; i < 60; ++i) {
    groundtruth.push_back({ns(0.1 * i), {{}, {0.1 * i, 0, 0}}});
    estimate.push_back({ns(0.1 * i), {{}, {0.11 * i, 0, 0}}});
  }
  const Accuracy a = accuracy_of(groundtruth, estimate);
  EXPECT_NEAR(a.rpe_1s_rmse_m, 0.1, 1e-12);
  EXPECT_NEAR(a.rpe_frame_rmse_m, 0.01, 1e-12);
  EXPECT_NEAR(a.rpe_1s_rmse_deg, 0, 1e-9);
  EXPECT_NEAR(a.ate_max_m, 0.01 * 29.5, 1e-12);
  EXPECT_NEAR(a.ate_rmse_m, 0.01 * std::sqrt((60.0 * 60 - 1) / 12), 1e-12);
}

TEST(Accuracy, ATurnThatWasMissedIsInDegrees) {
  std::vector<StampedPose> groundtruth, estimate;
  for (int i = 0; i < 50; ++i) {
    groundtruth.push_back({ns(0.1 * i), {exp_so3({0, 0.02 * i, 0}), {0.1 * i, 0, std::sin(0.1 * i)}}});
    estimate.push_back({ns(0.1 * i), {{}, groundtruth.back().T_world_camera.t}});
  }
  EXPECT_NEAR(accuracy_of(groundtruth, estimate).rpe_1s_rmse_deg, 0.2 * 180 / M_PI, 1e-9);
}

TEST(Accuracy, TheWindowIsTwentyMillisecondsInclusive) {
  const std::vector<StampedPose> sparse = perfect(truth(), 10);
  for (const auto& [late_ns, matched] :
       {std::pair<Nanoseconds, std::size_t>{20'000'000, 60}, {20'000'001, 0}}) {
    std::vector<StampedPose> late = sparse;
    for (StampedPose& p : late) p.stamp_ns += late_ns;
    const auto result = evaluate(sparse, late, {});
    EXPECT_EQ(result.ok() ? result.value().matched_poses : 0, matched);
  }
}

TEST(Accuracy, CoverageCountsFramesThatHaveGroundTruth) {
  const std::vector<StampedPose> groundtruth = truth(300);  // 3 s
  std::vector<Nanoseconds> frames;
  std::vector<StampedPose> estimate;
  for (int i = 0; i < 120; ++i)
    frames.push_back(kStart_ns + i * kFrame_ns);  // 4 s, the last of them without truth
  for (int i = 0; i < 120; ++i) {
    StampedPose p = truth_at(to_seconds(i * kFrame_ns));
    if (i < 45) estimate.push_back(p);  // lost after 1.5 s
  }
  const Accuracy a = accuracy_of(groundtruth, estimate, frames);
  EXPECT_EQ(a.matched_poses, 45u);
  EXPECT_NEAR(a.coverage, 45.0 / 91, 1e-12) << "91 frames are within 20 ms of 0 to 2.99 s";
}

TEST(Accuracy, WithoutFramesThereIsNoCoverage) {
  EXPECT_TRUE(std::isnan(accuracy_of(truth(), perfect(truth())).coverage));
}

TEST(Accuracy, AGapIsNotMeasuredAsASecond) {
  // 0.5 s of poses, a gap of 3 s, 0.5 s of poses: no two are a second apart.
  std::vector<StampedPose> estimate = perfect(truth());
  estimate.erase(estimate.begin() + 5, estimate.begin() + 35);
  estimate.resize(10);
  const Accuracy a = accuracy_of(truth(), estimate);
  EXPECT_TRUE(std::isnan(a.rpe_1s_rmse_m));
  EXPECT_TRUE(std::isnan(a.rpe_1s_rmse_deg));
  EXPECT_LT(a.rpe_frame_rmse_m, 1e-9);
}

TEST(Accuracy, PositionsOnALineOrInOnePointAreNoProblem) {
  std::vector<StampedPose> line, point;
  for (int i = 0; i < 30; ++i) {
    line.push_back({ns(0.1 * i), {{}, {0, 0.2 * i, 0}}});
    point.push_back({ns(0.1 * i), {exp_so3({0, 0.1 * i, 0}), {1, 2, 3}}});
  }
  EXPECT_LT(accuracy_of(line, perfect(line, 1)).ate_max_m, 1e-9);
  EXPECT_LT(accuracy_of(point, perfect(point, 1)).ate_max_m, 1e-9);
}

TEST(Accuracy, ErrorsSayWhatIsWrong) {
  const auto error = [](const std::vector<StampedPose>& g, const std::vector<StampedPose>& e) {
    const auto result = evaluate(g, e, {});
    EXPECT_FALSE(result.ok());
    if (result.ok()) return std::string();
    EXPECT_EQ(result.error().exit_code, ExitCode::UnreadableInput);
    return result.error().message;
  };
  std::vector<StampedPose> other_day = perfect(truth());
  for (StampedPose& p : other_day) p.stamp_ns += ns(86400);
  EXPECT_THAT(error(truth(), other_day), HasSubstr("only 0 of 60 poses have ground truth within 20 ms"));
  const std::vector<StampedPose> whole = perfect(truth());
  EXPECT_THAT(error(truth(), {whole[0], whole[1]}), HasSubstr("only 2 of 2"));
  EXPECT_THAT(error({}, whole), HasSubstr("ground truth empty"));
  EXPECT_THAT(error(truth(), {}), HasSubstr("only 0 of 0"));
  EXPECT_THAT(error(truth(), {whole[1], whole[0], whole[2]}), HasSubstr("estimate: the stamps do not rise"));
  std::vector<StampedPose> broken = whole;
  broken[3].T_world_camera.t.y = std::nan("");
  EXPECT_THAT(error(truth(), broken), HasSubstr("not finite"));
  EXPECT_THAT(error(broken, whole),
              HasSubstr("ground truth: the pose at 1305031239.829662000 s is not finite"));
}

// ---- against an independent implementation
// -----------------------------------------------------------------

constexpr const char* kPython = "/usr/bin/python3";

bool have_numpy() {
  return std::system((std::string(kPython) + " -c 'import numpy' >/dev/null 2>&1").c_str()) == 0;
}

void expect_agreement(const std::string& groundtruth_path, const std::string& estimate_path) {
  const auto groundtruth = read_trajectory(groundtruth_path), estimate = read_trajectory(estimate_path);
  ASSERT_TRUE(groundtruth.ok()) << groundtruth.error().message;
  ASSERT_TRUE(estimate.ok()) << estimate.error().message;
  const Accuracy own = accuracy_of(groundtruth.value(), estimate.value());
  const std::string command = std::string(kPython) +
                              " " STILLMAP_SOURCE_DIR "/tests/eval/reference_accuracy.py '" +
                              groundtruth_path + "' '" + estimate_path + "'";
  FILE* output = popen(command.c_str(), "r");
  ASSERT_NE(output, nullptr);
  std::array<char, 512> line{};
  const char* got = std::fgets(line.data(), static_cast<int>(line.size()), output);
  ASSERT_EQ(pclose(output), 0);
  ASSERT_NE(got, nullptr);
  std::istringstream words(line.data());
  std::array<double, 6> other{};
  for (double& value : other) {
    std::string word;
    words >> word;
    value = std::stod(word);
  }
  EXPECT_NEAR(own.ate_rmse_m, other[0], 1e-6);
  EXPECT_NEAR(own.ate_max_m, other[1], 1e-6);
  EXPECT_NEAR(own.rpe_1s_rmse_m, other[2], 1e-6);
  EXPECT_NEAR(own.rpe_1s_rmse_deg, other[3], 1e-6);
  EXPECT_NEAR(own.rpe_frame_rmse_m, other[4], 1e-6);
  EXPECT_EQ(static_cast<double>(own.matched_poses), other[5]);
}

/// The ground truth as a tracker would see it: in another frame, at 30 Hz, with noise and drift, with lost
/// frames.
std::vector<StampedPose> degraded(const std::vector<StampedPose>& groundtruth, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  const Pose T_other_world{exp_so3({noise(random), noise(random), noise(random)}), {5, noise(random), -3}};
  std::vector<StampedPose> out;
  Nanoseconds next_ns = groundtruth.front().stamp_ns;
  double drift = 0;
  for (const StampedPose& p : groundtruth) {
    if (p.stamp_ns < next_ns) continue;
    next_ns = p.stamp_ns + kFrame_ns;
    drift += 0.002;
    if (random() % 10 == 0) continue;
    const Vec3 turn = 0.01 * Vec3{noise(random), noise(random), noise(random) + drift};
    const Vec3 shift = 0.02 * Vec3{noise(random) + drift, noise(random), noise(random)};
    const Nanoseconds jitter_ns = static_cast<Nanoseconds>(4e6 * noise(random));
    out.push_back({p.stamp_ns + jitter_ns, T_other_world * p.T_world_camera * Pose{exp_so3(turn), shift}});
  }
  return out;
}

class Reference : public testing::Test {
 protected:
  std::string write(const char* name, const std::vector<StampedPose>& poses) {
    const std::string path = folder_ / name;
    EXPECT_TRUE(write_trajectory(path, poses, "test").ok());
    return path;
  }
  test::TemporaryFolder folder_;
};

TEST_F(Reference, AgreesOnRandomTrajectories) {
  if (!have_numpy()) GTEST_SKIP() << "needs python3-numpy";
  for (unsigned seed = 1; seed <= 8; ++seed) {
    SCOPED_TRACE(seed);
    const std::vector<StampedPose> groundtruth = truth(400 + 50 * static_cast<int>(seed));
    expect_agreement(write("g.txt", groundtruth), write("e.txt", degraded(groundtruth, seed)));
  }
}

TEST_F(Reference, AgreesOnRealTrajectories) {
  STILLMAP_NEEDS_SHARED();
  if (!have_numpy()) GTEST_SKIP() << "needs python3-numpy";
  for (const char* log : {"fr1_rpy", "office_walk"}) {
    SCOPED_TRACE(log);
    const std::string path = (test::shared_folder() / "data" / log / "groundtruth.txt").string();
    const auto groundtruth = read_trajectory(path);
    ASSERT_TRUE(groundtruth.ok()) << groundtruth.error().message;
    expect_agreement(path, write("e.txt", degraded(groundtruth.value(), 7)));
  }
}

}  // namespace
}  // namespace stillmap
