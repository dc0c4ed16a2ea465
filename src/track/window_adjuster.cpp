// SPDX-License-Identifier: Apache-2.0
#include "track/window_adjuster.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "track/least_squares.h"

namespace stillmap {

namespace {

constexpr int kIterations = 5;
constexpr double kNearest_m = 0.05;
constexpr int kLargest = 6 * static_cast<int>(AdjustmentWindow::kFreeViews);

using Matrix3 = Eigen::Matrix3d;
using Vector3 = Eigen::Vector3d;
using Matrix36 = Eigen::Matrix<double, 3, 6>;
using Matrix63 = Eigen::Matrix<double, 6, 3>;
using CameraMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kLargest, kLargest>;
using CameraVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kLargest, 1>;
using Views = FixedVector<WindowView, AdjustmentWindow::kViews>;

/// One observation, whitened: residual, its derivatives, and what Huber makes of it.
struct Linearized {
  Vector3 residual = Vector3::Zero();
  Matrix36 by_view = Matrix36::Zero();  // left perturbation (rotation, translation) of T_camera_odom
  Matrix3 by_point = Matrix3::Zero();
  double weight = 0, cost = 0;
};

double limit_of(const WindowObservation& o) {
  return o.depth_m > 0 ? kChi2ThreeDof : kChi2TwoDof;
}

/// False where the point is not in front of the camera.
bool linearize(const WindowObservation& o, const CameraModel& camera, const Pose& T_camera_odom, Vec3 p_odom,
               Linearized& out) {
  const Vec3 p = T_camera_odom * p_odom;
  if (p.z < kNearest_m) return false;
  const double iz = 1 / p.z, fx = camera.fx / static_cast<double>(o.sigma_px),
               fy = camera.fy / static_cast<double>(o.sigma_px);
  Matrix3 by_camera_point;
  by_camera_point << fx * iz, 0, -fx * p.x * iz * iz, 0, fy * iz, -fy * p.y * iz * iz, 0, 0, 0;
  out.residual << fx * (p.x * iz - static_cast<double>(o.ray_x)),
      fy * (p.y * iz - static_cast<double>(o.ray_y)), 0;
  if (o.depth_m > 0) {
    by_camera_point(2, 2) = 1 / static_cast<double>(o.sigma_depth_m);
    out.residual[2] = (p.z - static_cast<double>(o.depth_m)) / static_cast<double>(o.sigma_depth_m);
  }
  // p -> p + w x p + v, so a row g gives p x g by the rotation.
  for (int row = 0; row < 3; ++row) {
    const Vec3 g = {by_camera_point(row, 0), by_camera_point(row, 1), by_camera_point(row, 2)};
    const Vec3 w = cross(p, g);
    out.by_view.row(row) << w.x, w.y, w.z, g.x, g.y, g.z;
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(T_camera_odom.R.m.data());
  out.by_point.noalias() = by_camera_point * R;
  const double chi2 = out.residual.squaredNorm(), chi = std::sqrt(chi2), limit = std::sqrt(limit_of(o));
  out.weight = chi > limit ? limit / chi : 1;
  out.cost = chi > limit ? limit * (2 * chi - limit) : chi2;
  return true;
}

// How much the fused place counts beside the keyframes' looks. Without it the adjustment bought nothing on
// any log.
constexpr double kFusedWeight = 2;

Matrix3 fused_information(const WindowPoint& point) {
  return kFusedWeight * Matrix3(whole(point.information).m.data());
}

Vector3 from_fused(const WindowPoint& point, Vec3 p_odom) {
  const Vec3 d = p_odom - point.p_odom_fused;
  return {d.x, d.y, d.z};
}

/// The normal equations of one point and the views that see it.
struct PointSystem {
  Matrix3 inverse_H;
  Vector3 b = Vector3::Zero();
  struct Coupling {
    int view;
    Matrix63 W;
  };
  std::array<Coupling, AdjustmentWindow::kFreeViews> storage;
  std::size_t count = 0;
  std::span<const Coupling> couplings() const { return {storage.data(), count}; }  // free views only
};

void build(std::span<const WindowObservation> looks, const CameraModel& camera, const Views& views,
           const WindowPoint& point, double damping, PointSystem& system, CameraMatrix* S, CameraVector* g,
           double& cost) {
  Matrix3 H = fused_information(point);
  const Vector3 moved = from_fused(point, point.p_odom);
  system.b = -H * moved;
  cost += moved.dot(H * moved);
  system.count = 0;
  Linearized l;
  for (const WindowObservation& o : looks) {
    const WindowView& view = views[o.view];
    if (!linearize(o, camera, view.T_camera_odom, point.p_odom, l)) continue;
    cost += l.cost;
    H.noalias() += l.weight * l.by_point.transpose() * l.by_point;
    system.b.noalias() -= l.weight * l.by_point.transpose() * l.residual;
    if (view.fixed) continue;
    PointSystem::Coupling& coupling = system.storage[system.count++];
    coupling.view = 6 * o.view;
    coupling.W.noalias() = l.weight * l.by_view.transpose() * l.by_point;
    if (S == nullptr) continue;
    S->block<6, 6>(coupling.view, coupling.view).noalias() += l.weight * l.by_view.transpose() * l.by_view;
    g->segment<6>(coupling.view).noalias() -= l.weight * l.by_view.transpose() * l.residual;
  }
  H.diagonal() *= 1 + damping;
  H.diagonal().array() += 1e-6;
  system.inverse_H = H.inverse();
}

/// Takes the point out of the views' equations.
void eliminate(const PointSystem& system, CameraMatrix& S, CameraVector& g) {
  for (const PointSystem::Coupling& a : system.couplings()) {
    const Matrix63 WH = a.W * system.inverse_H;
    g.segment<6>(a.view).noalias() -= WH * system.b;
    for (const PointSystem::Coupling& b : system.couplings()) {
      if (b.view <= a.view) S.block<6, 6>(a.view, b.view).noalias() -= WH * b.W.transpose();
    }
  }
}

/// Groups the looks by point, and leaves out those of points that one view sees: they tell nothing of where
/// the views are.
void group_by_point(ArenaVector<WindowObservation>& observations) {
  std::sort(observations.begin(), observations.end(),
            [](const WindowObservation& a, const WindowObservation& b) {
              return a.point != b.point ? a.point < b.point : a.view < b.view;
            });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const bool shared = (i > 0 && observations[i - 1].point == observations[i].point) ||
                        (i + 1 < observations.size() && observations[i + 1].point == observations[i].point);
    if (shared) observations[kept++] = observations[i];
  }
  observations.resize_down(kept);
}

/// Calls `visit(point index, its observations)` for each point.
template <class Visit>
void for_each_point(std::span<WindowObservation> all, Visit&& visit) {
  for (std::size_t begin = 0; begin < all.size();) {
    std::size_t end = begin + 1;
    while (end < all.size() && all[end].point == all[begin].point) ++end;
    visit(std::size_t{all[begin].point}, all.subspan(begin, end - begin));
    begin = end;
  }
}

double cost_of(std::span<WindowObservation> observations, const CameraModel& camera, const Views& views,
               std::span<const WindowPoint> points, std::span<const Vec3> tried) {
  double cost = 0;
  Linearized l;
  for_each_point(observations, [&](std::size_t point, std::span<const WindowObservation> looks) {
    const Vector3 moved = from_fused(points[point], tried[point]);
    cost += moved.dot(fused_information(points[point]) * moved);
    for (const WindowObservation& o : looks) {
      if (linearize(o, camera, views[o.view].T_camera_odom, tried[point], l)) cost += l.cost;
    }
  });
  return cost;
}

}  // namespace

WindowAdjuster::WindowAdjuster(Arena& arena, const CameraModel& camera)
    : camera_(camera), tried_points_(arena.take<Vec3>("window.tried_points", AdjustmentWindow::kPoints)) {}

void WindowAdjuster::adjust(AdjustmentWindow& window) {
  group_by_point(window.observations);
  const auto free_views =
      std::count_if(window.views.begin(), window.views.end(), [](const WindowView& v) { return !v.fixed; });
  const auto size = 6 * static_cast<Eigen::Index>(free_views);
  CameraMatrix S(size, size);
  CameraVector g(size);
  PointSystem system;
  double damping = 1e-4;
  const std::span<WindowObservation> observations = std::span<WindowObservation>(window.observations);
  window.cost_before = -1;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    S.setZero();
    g.setZero();
    double cost = 0;
    for_each_point(observations, [&](std::size_t point, std::span<const WindowObservation> looks) {
      build(looks, camera_, window.views, window.points[point], damping, system, &S, &g, cost);
      eliminate(system, S, g);
    });
    if (window.cost_before < 0) window.cost_before = window.cost_after = cost;
    S.diagonal() *= 1 + damping;
    const Eigen::LDLT<CameraMatrix> ldlt(S);
    if (ldlt.info() != Eigen::Success || ldlt.vectorD().minCoeff() <= 1e-9) break;
    const CameraVector step = ldlt.solve(g);
    Views tried = window.views;
    for (std::size_t v = 0; v < static_cast<std::size_t>(free_views); ++v) {
      const double* d = step.data() + 6 * v;
      tried[v].T_camera_odom = perturbed(tried[v].T_camera_odom, {d[0], d[1], d[2], d[3], d[4], d[5]});
    }
    for (std::size_t i = 0; i < window.points.size(); ++i) tried_points_[i] = window.points[i].p_odom;
    double ignored = 0;
    for_each_point(observations, [&](std::size_t point, std::span<const WindowObservation> looks) {
      const Vec3 p = window.points[point].p_odom;
      build(looks, camera_, window.views, window.points[point], damping, system, nullptr, nullptr, ignored);
      Vector3 b = system.b;
      for (const PointSystem::Coupling& c : system.couplings())
        b.noalias() -= c.W.transpose() * step.segment<6>(c.view);
      const Vector3 d = system.inverse_H * b;
      tried_points_[point] = p + Vec3{d[0], d[1], d[2]};
    });
    const double tried_cost = cost_of(observations, camera_, tried, window.points, tried_points_);
    if (!(tried_cost < window.cost_after)) {  // also where it is not a number
      damping *= 100;
      continue;
    }
    const double gain = window.cost_after - tried_cost;
    window.cost_after = tried_cost;
    window.views = tried;
    for (std::size_t i = 0; i < window.points.size(); ++i) window.points[i].p_odom = tried_points_[i];
    damping /= 10;
    if (gain < 1e-3 * tried_cost) break;
  }
}

}  // namespace stillmap
