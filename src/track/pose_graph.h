// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/geometry.h"

namespace stillmap {

/// Where node b is, as seen from node a.
struct PoseGraphEdge {
  std::uint32_t a = 0, b = 0;
  Pose T_a_b;
  /// Inverse covariance of T_a_b's left perturbation (rotation in rad, translation in m, in a's frame),
  /// row-major, symmetric.
  std::array<double, 36> information{};
  bool may_be_wrong = false;  ///< a loop: it is given up where it does not fit the rest
  double weight = 1;          ///< out: how far it is believed, 0 to 1
};

/// The residual (rotation in rad, translation in m, in a's frame) of an edge: how far T_a_b is from where the
/// nodes are, and its derivatives by the nodes' right perturbations T * (exp(w), v), row-major.
struct PoseGraphResidual {
  std::array<double, 6> value{};
  std::array<double, 36> by_a{}, by_b{};
};
PoseGraphResidual pose_graph_residual(const PoseGraphEdge& edge, const Pose& T_world_a,
                                      const Pose& T_world_b);

enum class PoseGraphState : std::uint8_t {
  Running,
  Converged,
  StepLimit,   ///< still on its way after many steps
  NothingToDo  ///< no edge leads from a fixed node to another
};

struct PoseGraphResult {
  PoseGraphState state = PoseGraphState::NothingToDo;
  int steps = 0;
  double cost_before = 0, cost = 0;  ///< squared residuals in sigmas, those of loops limited
  int unreached_nodes = 0;           ///< no way from a fixed node: they stay where they are
  int refused_loops = 0;  ///< edges that may be wrong and in the end have less than half the weight
};

/// Poses that fit measured relative poses best. Loops that may be wrong count by a Geman-McClure cost that
/// starts convex and sharpens (graduated non-convexity; Yang et al., RA-L 5(2), 2020, section III.A); steps
/// are Levenberg-Marquardt, solved by conjugate gradients with an incomplete block Cholesky preconditioner,
/// which needs no more memory than the edges. No heap after construction; one thread.
class PoseGraph {
 public:
  static constexpr double kRefusedBelow = 0.25;  ///< an edge's weight at its 99 % quantile

  PoseGraph(Arena& arena, std::size_t nodes, std::size_t edges);

  void clear();
  /// The node's number, or nothing when full.
  std::optional<std::uint32_t> add_node(const Pose& T_world_node, bool fixed = false);
  /// False, and nothing is added, when full, or where the nodes are unknown or the same, or a number is not
  /// finite.
  [[nodiscard]] bool add_edge(const PoseGraphEdge& edge);

  PoseGraphResult solve();
  const PoseGraphResult& result() const { return result_; }

  /// By number.
  const Pose& pose(std::uint32_t node) const { return nodes_[node].T; }
  std::span<const PoseGraphEdge> edges() const { return edges_; }

 private:
  using Vector = std::array<double, 6>;
  using Matrix = std::array<double, 36>;  // row-major
  struct Node {
    Pose T, trial;
    bool fixed = false, free = false;  // free: moved by the solver
    Matrix H{}, L{};                   // the diagonal's block, and its factor
    Vector gradient{}, step{}, residual{}, preconditioned{}, direction{}, product{};
    std::uint32_t row_begin = 0, row_end = 0;  // its blocks left of the diagonal
  };
  /// Block (row, column) of the lower triangle, row > column: shared by all edges between two nodes.
  struct Block {
    std::uint32_t row = 0, column = 0;
    Matrix H{}, L{};
  };

  void begin();
  bool step();
  void find_reachable();
  void lay_out_blocks();
  double squared_residual(const PoseGraphEdge& edge, const Pose& T_a, const Pose& T_b) const;
  double cost_of(bool trial) const;
  void assemble();
  void add_to_equations(PoseGraphEdge& edge, Block& block);
  void factorize(double damping);
  void precondition();
  void solve_equations(double damping);
  void finish(PoseGraphState state);

  ArenaVector<Node> nodes_;
  ArenaVector<PoseGraphEdge> edges_;
  ArenaVector<Block> blocks_;
  std::span<std::uint32_t> edge_order_, block_of_edge_;
  PoseGraphResult result_;
  double sharpness_ = 1;  // mu of the paper
  double damping_ = 0;
};

}  // namespace stillmap
