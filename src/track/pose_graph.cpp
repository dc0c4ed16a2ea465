// SPDX-License-Identifier: Apache-2.0
#include "track/pose_graph.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace stillmap {

namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr double kLoopLimit = 16.81;  // 99 % quantile of chi-square with six degrees of freedom
constexpr int kMostSteps = 60, kMostInnerSteps = 200;
constexpr double kInnerTolerance = 1e-4;  // of the gradient's norm
constexpr double kLeastInformation = 1e-9;
constexpr double kDamping = 1e-6, kMostDamping = 1;
constexpr double kSharpen = 2;       // per step
constexpr double kLeastGain = 1e-5;  // a step that gains less of the cost is the last

auto map(std::array<double, 36>& m) {
  return Eigen::Map<Matrix6>(m.data());
}
auto map(const std::array<double, 36>& m) {
  return Eigen::Map<const Matrix6>(m.data());
}
auto map(std::array<double, 6>& v) {
  return Eigen::Map<Vector6>(v.data());
}
auto map(const std::array<double, 6>& v) {
  return Eigen::Map<const Vector6>(v.data());
}
auto map(const Mat3& m) {
  return Eigen::Map<const Matrix3>(m.m.data());
}

Matrix3 skew(Vec3 v) {
  Matrix3 m;
  m << 0, -v.z, v.y, v.z, 0, -v.x, -v.y, v.x, 0;
  return m;
}

/// Of log(exp(w) * exp(v)) by w at w = 0: the inverse of SO(3)'s left Jacobian.
Matrix3 inverse_left_jacobian(Vec3 v) {
  const double angle = norm(v);
  const double k = angle < 1e-4 ? 1.0 / 12 : 1 / (angle * angle) - 1 / (2 * angle * std::tan(angle / 2));
  const Matrix3 V = skew(v);
  return Matrix3::Identity() - 0.5 * V + k * V * V;
}

Pose moved(const Pose& T, const std::array<double, 6>& d) {
  return {orthonormalized(T.R * exp_so3({d[0], d[1], d[2]})), T.t + T.R * Vec3{d[3], d[4], d[5]}};
}

Pose deviation(const PoseGraphEdge& edge, const Pose& T_world_a, const Pose& T_world_b) {
  return inverse(T_world_a) * T_world_b * inverse(edge.T_a_b);
}

/// Geman-McClure's cost of a squared residual, and its weight; convex where `sharpness` is large.
double limited(double squared, double sharpness) {
  return sharpness * kLoopLimit * squared / (sharpness * kLoopLimit + squared);
}
double limited_weight(double squared, double sharpness) {
  const double share = sharpness * kLoopLimit / (sharpness * kLoopLimit + squared);
  return share * share;
}

}  // namespace

PoseGraphResidual pose_graph_residual(const PoseGraphEdge& edge, const Pose& T_world_a,
                                      const Pose& T_world_b) {
  PoseGraphResidual r;
  const Pose T_a_b = inverse(T_world_a) * T_world_b, E = T_a_b * inverse(edge.T_a_b);
  const Vec3 w = log_so3(E.R);
  r.value = {w.x, w.y, w.z, E.t.x, E.t.y, E.t.z};
  const Matrix3 J = inverse_left_jacobian(w);
  // A right perturbation of b is, seen from a, a left one of E: rotated by T_a_b, about its origin.
  auto by_b = map(r.by_b), by_a = map(r.by_a);
  by_b.setZero();
  by_b.topLeftCorner<3, 3>() = J * map(T_a_b.R);
  by_b.bottomLeftCorner<3, 3>() = skew(T_a_b.t - E.t) * map(T_a_b.R);
  by_b.bottomRightCorner<3, 3>() = map(T_a_b.R);
  by_a.setZero();
  by_a.topLeftCorner<3, 3>() = -J;
  by_a.bottomLeftCorner<3, 3>() = skew(E.t);
  by_a.bottomRightCorner<3, 3>() = -Matrix3::Identity();
  return r;
}

PoseGraph::PoseGraph(Arena& arena, std::size_t nodes, std::size_t edges)
    : nodes_(arena.take<Node>("pose_graph.nodes", nodes)),
      edges_(arena.take<PoseGraphEdge>("pose_graph.edges", edges)),
      blocks_(arena.take<Block>("pose_graph.blocks", edges)),
      edge_order_(arena.take<std::uint32_t>("pose_graph.order", edges)),
      block_of_edge_(arena.take<std::uint32_t>("pose_graph.block_of_edge", edges)) {}

void PoseGraph::clear() {
  nodes_.clear();
  edges_.clear();
  result_ = {};
}

std::optional<std::uint32_t> PoseGraph::add_node(const Pose& T_world_node, bool fixed) {
  Node node;
  node.T = T_world_node;
  node.fixed = fixed;
  if (!nodes_.try_push_back(node)) return std::nullopt;
  return static_cast<std::uint32_t>(nodes_.size() - 1);
}

bool PoseGraph::add_edge(const PoseGraphEdge& edge) {
  if (edge.a == edge.b || edge.a >= nodes_.size() || edge.b >= nodes_.size()) return false;
  if (!is_finite(edge.T_a_b) || !map(edge.information).allFinite()) return false;
  return edges_.try_push_back(edge);
}

void PoseGraph::find_reachable() {
  for (Node& node : nodes_) node.free = false;
  // Both ends of an edge are reached when one is; as many rounds as the longest way, mostly few.
  const auto reached = [](const Node& n) { return n.fixed || n.free; };
  for (bool grows = true; grows;) {
    grows = false;
    for (const PoseGraphEdge& e : edges_) {
      Node &a = nodes_[e.a], &b = nodes_[e.b];
      if (reached(a) == reached(b)) continue;
      (reached(a) ? b : a).free = grows = true;
    }
  }
  for (const Node& node : nodes_) result_.unreached_nodes += !reached(node);
}

void PoseGraph::lay_out_blocks() {
  const std::span<std::uint32_t> order = edge_order_.first(edges_.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto place = [&](std::uint32_t e) {
    return std::tuple(std::max(edges_[e].a, edges_[e].b), std::min(edges_[e].a, edges_[e].b), e);
  };
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return place(a) < place(b); });
  blocks_.clear();
  for (const std::uint32_t e : order) {
    const auto [row, column, number] = place(e);
    const bool known = !blocks_.empty() && blocks_[blocks_.size() - 1].row == row &&
                       blocks_[blocks_.size() - 1].column == column;
    if (!known) static_cast<void>(blocks_.try_push_back({row, column}));
    block_of_edge_[number] = static_cast<std::uint32_t>(blocks_.size() - 1);
  }
  std::uint32_t next = 0;
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    nodes_[i].row_begin = next;
    while (next < blocks_.size() && blocks_[next].row == i) ++next;
    nodes_[i].row_end = next;
  }
}

double PoseGraph::squared_residual(const PoseGraphEdge& edge, const Pose& T_a, const Pose& T_b) const {
  const Pose E = deviation(edge, T_a, T_b);
  const Vec3 w = log_so3(E.R);
  const Vector6 r(w.x, w.y, w.z, E.t.x, E.t.y, E.t.z);
  return r.dot(map(edge.information) * r);
}

double PoseGraph::cost_of(bool trial) const {
  double cost = 0;
  for (const PoseGraphEdge& e : edges_) {
    const Node &a = nodes_[e.a], &b = nodes_[e.b];
    const double squared = trial ? squared_residual(e, a.trial, b.trial) : squared_residual(e, a.T, b.T);
    cost += e.may_be_wrong ? limited(squared, sharpness_) : squared;
  }
  return cost;
}

void PoseGraph::add_to_equations(PoseGraphEdge& edge, Block& block) {
  Node &a = nodes_[edge.a], &b = nodes_[edge.b];
  const PoseGraphResidual r = pose_graph_residual(edge, a.T, b.T);
  const Vector6 weighted = map(edge.information) * map(r.value);
  edge.weight = edge.may_be_wrong ? limited_weight(map(r.value).dot(weighted), sharpness_) : 1;
  const Matrix6 a_information = edge.weight * map(r.by_a).transpose() * map(edge.information);
  const Matrix6 b_information = edge.weight * map(r.by_b).transpose() * map(edge.information);
  if (a.free) {
    map(a.H) += a_information * map(r.by_a);
    map(a.gradient) += edge.weight * map(r.by_a).transpose() * weighted;
  }
  if (b.free) {
    map(b.H) += b_information * map(r.by_b);
    map(b.gradient) += edge.weight * map(r.by_b).transpose() * weighted;
  }
  if (!a.free || !b.free) return;
  if (block.row == edge.a) {
    map(block.H) += a_information * map(r.by_b);
  } else {
    map(block.H) += b_information * map(r.by_a);
  }
}

void PoseGraph::assemble() {
  for (Node& node : nodes_) {
    node.gradient.fill(0);
    map(node.H).setIdentity();
    // Nothing but this holds what no edge says anything about.
    if (node.free) map(node.H) *= kLeastInformation;
  }
  for (Block& block : blocks_) block.H.fill(0);
  for (std::size_t e = 0; e < edges_.size(); ++e) add_to_equations(edges_[e], blocks_[block_of_edge_[e]]);
}

/// Incomplete Cholesky with the blocks' own pattern: exact where the graph is a chain.
void PoseGraph::factorize(double damping) {
  for (Node& node : nodes_) {
    Matrix6 damped = map(node.H);
    damped.diagonal() *= 1 + damping;
    Matrix6 pivot = damped;
    for (std::uint32_t p = node.row_begin; p < node.row_end; ++p) {
      const Node& other = nodes_[blocks_[p].column];
      Matrix6 sum = map(blocks_[p].H);
      std::uint32_t q = node.row_begin, s = other.row_begin;
      while (q < p && s < other.row_end) {
        const std::uint32_t left = blocks_[q].column, right = blocks_[s].column;
        if (left == right) sum.noalias() -= map(blocks_[q].L) * map(blocks_[s].L).transpose();
        q += left <= right;
        s += right <= left;
      }
      const Matrix6 transposed_L =
          map(other.L).triangularView<Eigen::Lower>().solve(Matrix6(sum.transpose()));
      map(blocks_[p].L) = transposed_L.transpose();
      pivot.noalias() -= map(blocks_[p].L) * map(blocks_[p].L).transpose();
    }
    Eigen::LLT<Matrix6> llt(pivot);
    // What is left out can make a pivot indefinite; its own block is a worse guess, but a sound one.
    if (llt.info() != Eigen::Success) llt.compute(damped);
    map(node.L) = llt.matrixL();
  }
}

/// preconditioned = (L L^T)^-1 residual.
void PoseGraph::precondition() {
  for (Node& node : nodes_) {
    Vector6 sum = map(node.residual);
    for (std::uint32_t p = node.row_begin; p < node.row_end; ++p)
      sum.noalias() -= map(blocks_[p].L) * map(nodes_[blocks_[p].column].preconditioned);
    map(node.preconditioned) = map(node.L).triangularView<Eigen::Lower>().solve(sum);
  }
  for (std::size_t i = nodes_.size(); i-- > 0;) {
    Node& node = nodes_[i];
    const Vector6 z = map(node.L).transpose().triangularView<Eigen::Upper>().solve(map(node.preconditioned));
    map(node.preconditioned) = z;
    for (std::uint32_t p = node.row_begin; p < node.row_end; ++p)
      map(nodes_[blocks_[p].column].preconditioned).noalias() -= map(blocks_[p].L).transpose() * z;
  }
}

/// step = -(H + damping * diagonal)^-1 gradient, by preconditioned conjugate gradients.
void PoseGraph::solve_equations(double damping) {
  factorize(damping);
  double first = 0;
  for (Node& node : nodes_) {
    node.step.fill(0);
    map(node.residual) = -map(node.gradient);
    first += map(node.gradient).squaredNorm();
  }
  double old_product = 0;
  for (int i = 0; i < kMostInnerSteps; ++i) {
    double left = 0, product = 0, curvature = 0;
    precondition();
    for (const Node& node : nodes_) {
      left += map(node.residual).squaredNorm();
      product += map(node.residual).dot(map(node.preconditioned));
    }
    if (left <= kInnerTolerance * kInnerTolerance * first) return;
    const double keep = i == 0 ? 0 : product / old_product;
    old_product = product;
    for (Node& node : nodes_) {
      map(node.direction) = map(node.preconditioned) + keep * map(node.direction);
      map(node.product) = map(node.H) * map(node.direction);
      map(node.product) += damping * map(node.H).diagonal().cwiseProduct(map(node.direction));
    }
    for (const Block& block : blocks_) {
      Node &row = nodes_[block.row], &column = nodes_[block.column];
      map(row.product).noalias() += map(block.H) * map(column.direction);
      map(column.product).noalias() += map(block.H).transpose() * map(row.direction);
    }
    for (const Node& node : nodes_) curvature += map(node.direction).dot(map(node.product));
    if (!(curvature > 0)) return;
    const double length = product / curvature;
    for (Node& node : nodes_) {
      map(node.step) += length * map(node.direction);
      map(node.residual) -= length * map(node.product);
    }
  }
}

void PoseGraph::begin() {
  result_ = {};
  find_reachable();
  lay_out_blocks();
  sharpness_ = 1;
  damping_ = kDamping;
  result_.cost_before = result_.cost = cost_of(false);
  double worst = 0;
  for (const PoseGraphEdge& e : edges_) {
    if (e.may_be_wrong) worst = std::max(worst, squared_residual(e, nodes_[e.a].T, nodes_[e.b].T));
  }
  sharpness_ = std::max(1.0, 2 * worst / kLoopLimit);  // every loop's cost is convex at first
  const bool any = std::any_of(nodes_.begin(), nodes_.end(), [](const Node& n) { return n.free; });
  result_.state = any ? PoseGraphState::Running : PoseGraphState::NothingToDo;
}

bool PoseGraph::step() {
  if (result_.state != PoseGraphState::Running) return false;
  assemble();
  solve_equations(damping_);
  for (Node& node : nodes_) node.trial = node.free ? moved(node.T, node.step) : node.T;
  const double before = cost_of(false), after = cost_of(true);
  const bool better = after < before;  // a NaN is not
  if (better) {
    for (Node& node : nodes_) node.T = node.trial;
    damping_ = std::max(damping_ / 10, kDamping);
  } else {
    damping_ *= 10;
  }
  const bool settled = better ? before - after <= kLeastGain * before : damping_ > kMostDamping;
  ++result_.steps;
  if (settled && sharpness_ <= 1) {
    finish(PoseGraphState::Converged);
  } else if (result_.steps == kMostSteps) {
    finish(PoseGraphState::StepLimit);
  } else if (better || settled) {
    sharpness_ = std::max(1.0, sharpness_ / kSharpen);
  }
  return result_.state == PoseGraphState::Running;
}

void PoseGraph::finish(PoseGraphState state) {
  result_.state = state;
  sharpness_ = 1;
  result_.cost = cost_of(false);
  for (PoseGraphEdge& e : edges_) {
    if (!e.may_be_wrong) continue;
    e.weight = limited_weight(squared_residual(e, nodes_[e.a].T, nodes_[e.b].T), sharpness_);
    result_.refused_loops += e.weight < kRefusedBelow;
  }
}

PoseGraphResult PoseGraph::solve() {
  begin();
  while (step()) {
  }
  return result_;
}

}  // namespace stillmap
