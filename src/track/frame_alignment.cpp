// SPDX-License-Identifier: Apache-2.0
#include "track/frame_alignment.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/vector_clones.h"

namespace stillmap {

namespace {

constexpr int kShrink = 8;
constexpr float kHuber = 6;    // grey levels
constexpr double kSigma = 20;  // of a pixel: neighbours err together, so many say less than their number
constexpr int kMostSteps = 8;  // per level
constexpr std::size_t kFewest = 40;   // samples that tell anything
constexpr double kLeastGain = 0.002;  // of the cost; a step that gains less is the last

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

CameraModel pinhole(const CameraModel& camera, int width, int height, double shrink) {
  CameraModel small;
  small.width = width;
  small.height = height;
  small.fx = camera.fx / shrink;
  small.fy = camera.fy / shrink;
  small.cx = (camera.cx + 0.5) / shrink - 0.5;
  small.cy = (camera.cy + 0.5) / shrink - 0.5;
  return small;
}

/// Means of kShrink x kShrink pixels.
STILLMAP_VECTOR_CLONES void shrink(ImageView<const std::uint8_t> from, ImageView<float> to,
                                   std::span<std::uint32_t> sums) {
  const int width = to.width * kShrink;
  for (int y = 0; y < to.height; ++y) {
    std::uint32_t* sum = sums.data();
    std::fill(sum, sum + width, 0u);
    for (int dy = 0; dy < kShrink; ++dy) {
      const std::uint8_t* in = from.row(y * kShrink + dy);
      for (int x = 0; x < width; ++x) sum[x] += in[x];
    }
    float* out = to.row(y);
    for (int x = 0; x < to.width; ++x) {
      std::uint32_t total = 0;
      for (int dx = 0; dx < kShrink; ++dx) total += sum[x * kShrink + dx];
      out[x] = static_cast<float>(total) / (kShrink * kShrink);
    }
  }
}

void halve(ImageView<const float> from, ImageView<float> to) {
  for (int y = 0; y < to.height; ++y) {
    const float *a = from.row(2 * y), *b = from.row(2 * y + 1);
    for (int x = 0; x < to.width; ++x) to.row(y)[x] = (a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]) / 4;
  }
}

/// Binomial of five, both ways, in place; what lies beyond the rim is as the rim.
void blur(ImageView<float> image, std::span<float> line) {
  const auto pass = [&](int count, float* first, std::ptrdiff_t stride) {
    for (int i = 0; i < count; ++i) line[static_cast<std::size_t>(i)] = first[i * stride];
    const auto at = [&](int i) { return line[static_cast<std::size_t>(std::clamp(i, 0, count - 1))]; };
    for (int i = 0; i < count; ++i)
      first[i * stride] = (6 * at(i) + 4 * (at(i - 1) + at(i + 1)) + at(i - 2) + at(i + 2)) / 16;
  };
  for (int y = 0; y < image.height; ++y) pass(image.width, image.row(y), 1);
  for (int x = 0; x < image.width; ++x) pass(image.height, image.data + x, image.stride);
}

Vector7 information_of(const PosePrior& prior) {
  Vector7 information = Vector7::Zero();
  information.head<3>().setConstant(1 / (prior.sigma_rotation_rad * prior.sigma_rotation_rad));
  information.segment<3>(3).setConstant(1 / (prior.sigma_translation_m * prior.sigma_translation_m));
  return information;
}

double huber_cost(double size) {
  return size > kHuber ? kHuber * (2 * size - kHuber) : size * size;
}

}  // namespace

/// Of the brightness differences at one motion.
struct FrameAlignment::Equations {
  Matrix7 H = Matrix7::Zero();
  Vector7 b = Vector7::Zero();
  double cost = 0;  // mean Huber cost of those in view
  std::size_t in_view = 0, agreeing = 0;
};

FrameAlignment::FrameAlignment(Arena& arena, const CameraModel& camera)
    : camera_(camera),
      sums_(arena.take<std::uint32_t>("alignment.sums", static_cast<std::size_t>(camera.width))),
      row_(arena.take<float>("alignment.row",
                             static_cast<std::size_t>(std::max(camera.width, camera.height)))) {
  int shrinkage = kShrink;
  for (Level& level : levels_) {
    const int width = camera.width / shrinkage, height = camera.height / shrinkage;
    const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    level.camera = pinhole(camera, width, height, shrinkage);
    level.image = {arena.take<float>("alignment.picture", pixels).data(), width, height, width};
    level.samples = ArenaVector<Sample>(arena.take<Sample>("alignment.samples", pixels));
    shrinkage *= 2;
  }
}

void FrameAlignment::take(ImageView<const std::uint8_t> grey) {
  shrink(grey, levels_[0].image, sums_);
  halve(levels_[0].image, levels_[1].image);
  for (Level& level : levels_) blur(level.image, row_);
}

void FrameAlignment::forget() {
  for (Level& level : levels_) level.samples.clear();
}

void FrameAlignment::remember(ImageView<const std::uint16_t> depth, const DynamicMask& mask) {
  for (Level& level : levels_) sample(level, depth, mask);
}

void FrameAlignment::sample(Level& level, ImageView<const std::uint16_t> depth,
                            const DynamicMask& mask) const {
  level.samples.clear();
  const CameraModel& c = level.camera;
  const int scale = camera_.width / c.width;
  for (int y = 1; y + 1 < c.height; ++y) {
    for (int x = 1; x + 1 < c.width; ++x) {
      double z = 0;
      for (const int at : {4, 1, 7}) {  // eighths of the small pixel: depth has holes
        const int full_x = x * scale + at * scale / 8, full_y = y * scale + at * scale / 8;
        const double here = camera_.depth_m(depth.at(full_x, full_y));
        if (here <= 0) continue;
        if (label_at(mask, full_x, full_y, here) != Label::Dynamic) z = here;
        break;
      }
      if (z <= 0) continue;
      Sample s;
      s.value = level.image.at(x, y);
      const Vec3 p{(x - c.cx) / c.fx * z, (y - c.cy) / c.fy * z, z};
      const double gx = 0.5 * (level.image.at(x + 1, y) - level.image.at(x - 1, y)) * c.fx / z;
      const double gy = 0.5 * (level.image.at(x, y + 1) - level.image.at(x, y - 1)) * c.fy / z;
      const Vec3 by_p{gx, gy, -(gx * p.x + gy * p.y) / z};
      const Vec3 by_w = cross(p, by_p);
      s.p_camera = {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
      s.jacobian = {static_cast<float>(by_w.x), static_cast<float>(by_w.y), static_cast<float>(by_w.z),
                    static_cast<float>(by_p.x), static_cast<float>(by_p.y), static_cast<float>(by_p.z)};
      static_cast<void>(level.samples.try_push_back(s));
    }
  }
}

FrameAlignment::Equations FrameAlignment::equations_at(const Level& level, const Pose& T, float offset,
                                                       const DynamicMask* mask) const {
  using Vector7f = Eigen::Matrix<float, 7, 1>;
  Eigen::Matrix<float, 7, 7> H = Eigen::Matrix<float, 7, 7>::Zero();
  Vector7f b = Vector7f::Zero();
  std::array<float, 9> R;
  std::transform(T.R.m.begin(), T.R.m.end(), R.begin(), [](double v) { return static_cast<float>(v); });
  const auto tx = static_cast<float>(T.t.x), ty = static_cast<float>(T.t.y), tz = static_cast<float>(T.t.z);
  const auto fx = static_cast<float>(level.camera.fx), fy = static_cast<float>(level.camera.fy);
  const auto cx = static_cast<float>(level.camera.cx), cy = static_cast<float>(level.camera.cy);
  const auto last_x = static_cast<float>(level.image.width - 1),
             last_y = static_cast<float>(level.image.height - 1);
  const int scale = camera_.width / level.camera.width;
  Equations out;
  double cost = 0;
  for (const Sample& s : level.samples) {
    const auto& p = s.p_camera;
    const float z = R[6] * p[0] + R[7] * p[1] + R[8] * p[2] + tz;
    if (z < 0.05f) continue;
    const float u = fx * (R[0] * p[0] + R[1] * p[1] + R[2] * p[2] + tx) / z + cx;
    const float v = fy * (R[3] * p[0] + R[4] * p[1] + R[5] * p[2] + ty) / z + cy;
    if (!(u >= 0 && v >= 0 && u < last_x && v < last_y)) continue;
    const int x = static_cast<int>(u), y = static_cast<int>(v);
    if (mask != nullptr && label_at(*mask, x * scale, y * scale, z) == Label::Dynamic) continue;
    const float a = u - static_cast<float>(x), c = v - static_cast<float>(y);
    const float *above = level.image.row(y) + x, *below = level.image.row(y + 1) + x;
    const float seen =
        (1 - c) * ((1 - a) * above[0] + a * above[1]) + c * ((1 - a) * below[0] + a * below[1]);
    const float r = seen - s.value - offset, size = std::abs(r);
    const float weight = size > kHuber ? kHuber / size : 1;
    cost += huber_cost(size);
    ++out.in_view;
    out.agreeing += size <= kHuber;
    Vector7f J;
    J << s.jacobian[0], s.jacobian[1], s.jacobian[2], s.jacobian[3], s.jacobian[4], s.jacobian[5], 1;
    H.noalias() += weight * J * J.transpose();
    b.noalias() += weight * r * J;
  }
  out.H = H.cast<double>();
  out.b = b.cast<double>();
  out.cost = out.in_view > 0 ? cost / static_cast<double>(out.in_view) : 0;
  return out;
}

Pose FrameAlignment::align(const PosePrior& prior) {
  aligned_.reset();
  const Vector7 information = information_of(prior);
  Pose T = prior.T_camera_world;
  float offset = 0;
  for (std::size_t l = levels_.size(); l-- > 0;) {
    const Level& level = levels_[l];
    Equations at = equations_at(level, T, offset);
    for (int step = 0; step < kMostSteps; ++step) {
      if (at.in_view < kFewest || 2 * at.in_view < level.samples.size()) return prior.T_camera_world;
      // T exp(-d) is sought; the prior wants it to be its own.
      const Pose off = inverse(prior.T_camera_world) * T;
      const Vec3 w = log_so3(off.R);
      Vector7 deviation;
      deviation << w.x, w.y, w.z, off.t.x, off.t.y, off.t.z, 0;
      Matrix7 H = at.H / (kSigma * kSigma);
      H.diagonal() += information;
      const Vector7 d = H.ldlt().solve(at.b / (kSigma * kSigma) + information.cwiseProduct(deviation));
      const Pose moved{exp_so3({d[0], d[1], d[2]}), {d[3], d[4], d[5]}};
      const Pose trial = T * inverse(moved);
      const float trial_offset = offset + static_cast<float>(d[6]);
      if (!is_finite(trial)) return prior.T_camera_world;
      const Equations next = equations_at(level, trial, trial_offset);
      if (!(next.cost < at.cost)) break;
      const bool settled = at.cost - next.cost < kLeastGain * at.cost;
      T = trial;
      offset = trial_offset;
      at = next;
      if (settled) break;
    }
  }
  aligned_ = {T, offset, prior};
  return {orthonormalized(T.R), T.t};
}

bool FrameAlignment::holds(const DynamicMask& mask) const {
  if (!aligned_) return false;
  const Level& finest = levels_.front();
  const Equations at = equations_at(finest, aligned_->T_camera_before, aligned_->offset, &mask);
  if (at.in_view < kFewest || 2 * at.agreeing < at.in_view) return false;
  // How it turned must be seen. Where to it moved a distant wall does not say, and the prior lets it not go
  // far.
  const Vector7 information = information_of(aligned_->prior);
  Matrix7 beyond = at.H / (kSigma * kSigma);
  beyond.diagonal().head<3>() -= information.head<3>();
  beyond.diagonal().segment<3>(3) += information.segment<3>(3);
  return Eigen::LLT<Matrix7>(beyond).info() == Eigen::Success;
}

}  // namespace stillmap
