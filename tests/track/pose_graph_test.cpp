// SPDX-License-Identifier: Apache-2.0
#include "track/pose_graph.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "scene.h"

namespace stillmap {
namespace {

using test::angle_between;
using test::gaussian_vec;

std::array<double, 36> information(double sigma_rad, double sigma_m) {
  std::array<double, 36> m{};
  for (std::size_t i = 0; i < 6; ++i) m[7 * i] = 1 / (i < 3 ? sigma_rad * sigma_rad : sigma_m * sigma_m);
  return m;
}

Pose noise(Random& random, double sigma_rad, double sigma_m) {
  return {exp_so3(gaussian_vec(random, sigma_rad)), gaussian_vec(random, sigma_m)};
}

Pose some_pose(Random& random) {
  return noise(random, 1, 2);
}

Pose perturbed(const Pose& T, std::size_t axis, double by) {
  std::array<double, 6> d{};
  d[axis] = by;
  return T * Pose{exp_so3({d[0], d[1], d[2]}), {d[3], d[4], d[5]}};
}

TEST(PoseGraphResidual, VanishesWhereTheNodesAgree) {
  Random random(1);
  const Pose a = some_pose(random), b = some_pose(random);
  const PoseGraphResidual r = pose_graph_residual({.T_a_b = inverse(a) * b}, a, b);
  for (const double v : r.value) EXPECT_NEAR(v, 0, 1e-12);
}

TEST(PoseGraphResidual, DerivativesAreTheNumericalOnes) {
  Random random(2);
  for (int round = 0; round < 20; ++round) {
    const Pose a = some_pose(random), b = some_pose(random);
    const PoseGraphEdge edge{.T_a_b = round == 0 ? inverse(a) * b : inverse(a) * b * noise(random, 0.4, 0.5)};
    const PoseGraphResidual r = pose_graph_residual(edge, a, b);
    constexpr double kStep = 1e-6;
    for (std::size_t axis = 0; axis < 6; ++axis) {
      const auto a_up = pose_graph_residual(edge, perturbed(a, axis, kStep), b).value;
      const auto a_down = pose_graph_residual(edge, perturbed(a, axis, -kStep), b).value;
      const auto b_up = pose_graph_residual(edge, a, perturbed(b, axis, kStep)).value;
      const auto b_down = pose_graph_residual(edge, a, perturbed(b, axis, -kStep)).value;
      for (std::size_t row = 0; row < 6; ++row) {
        EXPECT_NEAR(r.by_a[6 * row + axis], (a_up[row] - a_down[row]) / (2 * kStep), 1e-6) << row << axis;
        EXPECT_NEAR(r.by_b[6 * row + axis], (b_up[row] - b_down[row]) / (2 * kStep), 1e-6) << row << axis;
      }
    }
  }
}

/// A camera that walks `rounds` times around a table, with odometry that drifts.
class Walk {
 public:
  static constexpr double kOdometry_rad = 0.004, kOdometry_m = 0.01, kLoop_rad = 0.005, kLoop_m = 0.01;

  Walk(std::size_t nodes, int neighbours, int rounds = 1, std::uint64_t seed = 3)
      : graph(arena, nodes, 4 * nodes + 64),
        random(seed),
        per_round(nodes / static_cast<std::size_t>(rounds)) {
    for (std::size_t i = 0; i < nodes; ++i) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(per_round);
      truth.push_back(
          {exp_so3({0, 0, angle}), {3 * std::cos(angle), 3 * std::sin(angle), 0.1 * std::sin(3 * angle)}});
    }
    Pose drifted = truth[0];
    for (std::size_t i = 0; i < nodes; ++i) {
      if (i > 0) drifted = drifted * (inverse(truth[i - 1]) * truth[i] * odometry_noise());
      graph.add_node(drifted, i == 0);
    }
    // What joins two nodes is measured once, and the start is what the first neighbours say.
    for (std::uint32_t i = 1; i < nodes; ++i) {
      for (int back = 1; back <= neighbours && static_cast<std::uint32_t>(back) <= i; ++back) {
        const std::uint32_t from = i - static_cast<std::uint32_t>(back);
        const Pose T = back == 1 ? inverse(graph.pose(from)) * graph.pose(i)
                                 : inverse(truth[from]) * truth[i] * odometry_noise();
        EXPECT_TRUE(graph.add_edge({from, i, T, information(kOdometry_rad, kOdometry_m)}));
      }
    }
  }
  void add_loop(std::uint32_t a, std::uint32_t b, const Pose& error = {}) {
    const Pose T = noise(random, kLoop_rad, kLoop_m) * error * inverse(truth[a]) * truth[b];
    EXPECT_TRUE(graph.add_edge({a, b, T, information(kLoop_rad, kLoop_m), true}));
  }
  double rmse_m() const {
    double squared = 0;
    for (std::uint32_t i = 0; i < truth.size(); ++i) {
      const Vec3 d = graph.pose(i).t - truth[i].t;
      squared += dot(d, d);
    }
    return std::sqrt(squared / static_cast<double>(truth.size()));
  }

  Arena arena{std::size_t{16} << 20};
  PoseGraph graph;
  std::vector<Pose> truth;
  Random random;
  std::size_t per_round;

 private:
  Pose odometry_noise() { return noise(random, kOdometry_rad, kOdometry_m); }
};

TEST(PoseGraph, ALoopMendsDrift) {
  Walk walk(100, 1);
  const double drift = walk.rmse_m();
  ASSERT_GT(drift, 0.1);
  const auto last = static_cast<std::uint32_t>(walk.truth.size() - 1);
  walk.add_loop(0, last);
  walk.add_loop(last - 3, 2);
  const PoseGraphResult result = walk.graph.solve();
  EXPECT_EQ(result.state, PoseGraphState::Converged);
  EXPECT_EQ(result.refused_loops, 0);
  EXPECT_LT(result.cost, result.cost_before);
  EXPECT_LT(walk.rmse_m(), 0.75 * drift) << "half way round the odometry's own error is left";
  EXPECT_LT(norm(walk.graph.pose(last).t - walk.truth[last].t), 0.04);
  EXPECT_LT(angle_between(walk.graph.pose(last), walk.truth[last]), 0.02);
  EXPECT_EQ(norm(walk.graph.pose(0).t - walk.truth[0].t), 0) << "the fixed node stays";
}

/// The least squares of linear edges is known: the loop's error spreads by the edges' variances.
TEST(PoseGraph, AChainSharesTheErrorByVariance) {
  Arena arena(std::size_t{1} << 20);
  PoseGraph graph(arena, 3, 3);
  graph.add_node({}, true);
  graph.add_node({{}, {1, 0, 0}});
  graph.add_node({{}, {2, 0, 0}});
  ASSERT_TRUE(graph.add_edge({0, 1, {{}, {1, 0, 0}}, information(0.01, 0.1)}));
  ASSERT_TRUE(graph.add_edge({1, 2, {{}, {1, 0, 0}}, information(0.01, 0.2)}));
  ASSERT_TRUE(graph.add_edge({0, 2, {{}, {2.6, 0, 0}}, information(0.01, 0.1)}));
  EXPECT_EQ(graph.solve().state, PoseGraphState::Converged);
  // Variances 1 + 4 against 1: the long way takes 5/6 of the 0.6 m, one fifth of it on the first edge.
  EXPECT_NEAR(graph.pose(1).t.x, 1 + 0.6 * 5 / 6 / 5, 1e-5);
  EXPECT_NEAR(graph.pose(2).t.x, 2 + 0.6 * 5 / 6, 1e-5);
}

TEST(PoseGraph, AWrongLoopAmongGoodOnesIsRefused) {
  Walk good(120, 2), with_wrong(120, 2);
  for (Walk* walk : {&good, &with_wrong}) {
    for (std::uint32_t i = 0; i < 4; ++i) walk->add_loop(i, 116 + i);
  }
  with_wrong.add_loop(20, 80, {exp_so3({0.4, 0, 1}), {1, -0.5, 0.3}});
  with_wrong.add_loop(50, 100, {{}, {0, 1.5, 0}});
  EXPECT_EQ(good.graph.solve().refused_loops, 0);
  const PoseGraphResult result = with_wrong.graph.solve();
  EXPECT_EQ(result.state, PoseGraphState::Converged);
  EXPECT_EQ(result.refused_loops, 2);
  for (const PoseGraphEdge& e : with_wrong.graph.edges()) {
    if (!e.may_be_wrong) continue;
    EXPECT_EQ(e.weight > PoseGraph::kRefusedBelow, e.b >= 116) << e.a << " " << e.b;
  }
  EXPECT_LT(std::abs(with_wrong.rmse_m() - good.rmse_m()), 0.01);
}

/// Against odometry alone: a loop that would bend it beyond belief is not believed.
TEST(PoseGraph, AWrongLoopAloneIsRefused) {
  Walk walk(60, 2);
  const double before = walk.rmse_m();
  walk.add_loop(10, 40, {exp_so3({0, 0, 1.5}), {2, 1, 0}});
  EXPECT_EQ(walk.graph.solve().refused_loops, 1);
  EXPECT_LT(walk.rmse_m(), before + 0.05);
}

TEST(PoseGraph, TwoHundredNodesTakeFewSteps) {
  Walk walk(200, 3, 2);
  for (std::uint32_t i = 0; i < 100; ++i) {
    walk.add_loop(i, i + 100);
    if (i >= 2) walk.add_loop(i - 2, i + 100);
  }
  ASSERT_GE(walk.graph.edges().size(), 790u);
  const double drift = walk.rmse_m();
  const PoseGraphResult result = walk.graph.solve();
  EXPECT_EQ(result.state, PoseGraphState::Converged);
  EXPECT_LT(result.steps, 30);
  EXPECT_LE(result.refused_loops, 6) << "of 198, whose noise is beyond its 99 % quantile now and then";
  EXPECT_LT(walk.rmse_m(), 0.5 * drift);
}

TEST(PoseGraph, AJoinedSegmentFollowsItsOneLoop) {
  // Nodes 3 to 5 were tracked after a loss, from a wrong start; one loop ties them to node 1.
  Arena arena(std::size_t{1} << 20);
  PoseGraph graph(arena, 6, 8);
  std::vector<Pose> truth;
  for (int i = 0; i < 6; ++i) truth.push_back({exp_so3({0, 0.1 * i, 0}), {0.2 * i, 0, 0}});
  const Pose astray{exp_so3({0.3, -0.8, 0.2}), {4, 2, -1}};
  for (std::size_t i = 0; i < 6; ++i) graph.add_node(i < 3 ? truth[i] : astray * truth[i], i == 0);
  for (const std::uint32_t i : {0u, 1u, 3u, 4u})
    ASSERT_TRUE(graph.add_edge({i, i + 1, inverse(truth[i]) * truth[i + 1], information(0.01, 0.01)}));
  ASSERT_TRUE(graph.add_edge({1, 4, inverse(truth[1]) * truth[4], information(0.01, 0.02), true}));
  const PoseGraphResult result = graph.solve();
  EXPECT_EQ(result.state, PoseGraphState::Converged);
  EXPECT_EQ(result.refused_loops, 0);
  for (std::uint32_t i = 0; i < 6; ++i) {
    EXPECT_LT(norm(graph.pose(i).t - truth[i].t), 1e-3) << i;
    EXPECT_LT(angle_between(graph.pose(i), truth[i]), 1e-3) << i;
  }
}

TEST(PoseGraph, NothingToDoEndsInAState) {
  Arena arena(std::size_t{1} << 20);
  PoseGraph graph(arena, 4, 4);
  EXPECT_EQ(graph.solve().state, PoseGraphState::NothingToDo) << "no nodes";
  graph.add_node({}, true);
  graph.add_node({{}, {1, 0, 0}});
  EXPECT_EQ(graph.solve().state, PoseGraphState::NothingToDo) << "no edges";
  EXPECT_EQ(graph.result().unreached_nodes, 1);
  // Two nodes that know each other, and nobody else.
  const auto c = graph.add_node({{}, {5, 0, 0}}), d = graph.add_node({{}, {6, 0, 0}});
  ASSERT_TRUE(c && d);
  ASSERT_TRUE(graph.add_edge({*c, *d, {{}, {2, 0, 0}}, information(0.1, 0.1)}));
  EXPECT_EQ(graph.solve().state, PoseGraphState::NothingToDo);
  ASSERT_TRUE(graph.add_edge({0, 1, {{}, {1.5, 0, 0}}, information(0.1, 0.1)}));
  const PoseGraphResult result = graph.solve();
  EXPECT_EQ(result.state, PoseGraphState::Converged);
  EXPECT_EQ(result.unreached_nodes, 2);
  EXPECT_NEAR(graph.pose(1).t.x, 1.5, 1e-6);
  EXPECT_EQ(graph.pose(*d).t.x, 6) << "stays where it is";
  EXPECT_FALSE(graph.add_node({})) << "full";
  graph.clear();
  EXPECT_EQ(graph.solve().state, PoseGraphState::NothingToDo);
}

TEST(PoseGraph, ImpossibleEdgesAreRefused) {
  Arena arena(std::size_t{1} << 20);
  PoseGraph graph(arena, 2, 1);
  graph.add_node({}, true);
  graph.add_node({});
  const auto sound = information(1, 1);
  EXPECT_FALSE(graph.add_edge({0, 0, {}, sound}));
  EXPECT_FALSE(graph.add_edge({0, 2, {}, sound}));
  auto broken = sound;
  broken[7] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(graph.add_edge({0, 1, {}, broken}));
  EXPECT_FALSE(graph.add_edge({0, 1, {{}, {std::numeric_limits<double>::infinity(), 0, 0}}, sound}));
  EXPECT_TRUE(graph.add_edge({0, 1, {}, sound}));
  EXPECT_FALSE(graph.add_edge({1, 0, {}, sound})) << "full";
}

TEST(PoseGraph, InformationOfNothingMovesNothing) {
  Arena arena(std::size_t{1} << 20);
  PoseGraph graph(arena, 2, 1);
  graph.add_node({}, true);
  graph.add_node({{}, {1, 2, 3}});
  ASSERT_TRUE(graph.add_edge({0, 1, {}, {}}));
  EXPECT_NE(graph.solve().state, PoseGraphState::Running);
  EXPECT_TRUE(is_finite(graph.pose(1)));
  EXPECT_EQ(graph.pose(1).t.z, 3);
}

}  // namespace
}  // namespace stillmap
