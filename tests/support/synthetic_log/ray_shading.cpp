// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <cmath>

#include "tests/support/synthetic_log/materials.h"
#include "tests/support/synthetic_log/ray_caster.h"

namespace stillmap::synthetic {

template <class PerPixel>
void RayCaster::for_each_pixel(PerPixel per_pixel) const {
  const auto fx = static_cast<float>(1 / camera_.fx), fy = static_cast<float>(1 / camera_.fy);
  const auto cx = static_cast<float>(camera_.cx) - x_offset_px_,
             cy = static_cast<float>(camera_.cy) - y_offset_px_;
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const auto& tile = tiles_[static_cast<std::size_t>(row * columns_ + column)];
      for (int v = row * kTilePx; v < std::min((row + 1) * kTilePx, camera_.height); ++v) {
        for (int u = column * kTilePx; u < std::min((column + 1) * kTilePx, camera_.width); ++u) {
          const float x = (static_cast<float>(u) - cx) * fx, y = (static_cast<float>(v) - cy) * fy;
          per_pixel(static_cast<std::size_t>(v * camera_.width + u), x, y, trace(tile, x, y));
        }
      }
    }
  }
}

void RayCaster::cast(std::span<float> depth_m, std::span<std::uint8_t> figure) const {
  for_each_pixel([&](std::size_t pixel, float, float, const Hit& hit) {
    depth_m[pixel] = hit.t;
    figure[pixel] = hit.seen != nullptr ? hit.seen->shape->figure : std::uint8_t{0};
  });
}

RayCaster::Skin RayCaster::skin_of_room(F3 p) const {
  constexpr float kTexelsPerMetre = 250;
  const auto half_x = static_cast<float>(room_.half_x), half_y = static_cast<float>(room_.half_y);
  const auto height = static_cast<float>(room_.height);
  const std::array<float, 6> gaps{p.x + half_x, half_x - p.x, p.y + half_y, half_y - p.y, p.z, height - p.z};
  const auto face = static_cast<std::size_t>(std::min_element(gaps.begin(), gaps.end()) - gaps.begin());
  constexpr std::array<F3, 6> kNormals{{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};
  const int material = face < 4 ? room_.walls[face] : face == 4 ? kFloor : kCeiling;
  const float u = face < 2 ? p.y : p.x, v = face < 4 ? -p.z : p.y;
  return {kNormals[face],      &materials_[static_cast<std::size_t>(material)],
          u * kTexelsPerMetre, v * kTexelsPerMetre,
          kTexelsPerMetre,     1};
}

/// `q` is on one of the six faces, where one coordinate is +1 or -1.
RayCaster::Skin RayCaster::skin_of_box(const Seen& seen, F3 q) const {
  const Shape& s = *seen.shape;
  const float ax = std::abs(q.x), ay = std::abs(q.y), az = std::abs(q.z);
  const int axis = ax > ay && ax > az ? 0 : ay > az ? 1 : 2;
  const float sign = (axis == 0 ? q.x : axis == 1 ? q.y : q.z) > 0 ? 1.0f : -1.0f;
  const auto x = q.x * static_cast<float>(s.half.x), y = q.y * static_cast<float>(s.half.y),
             z = q.z * static_cast<float>(s.half.z);
  const auto scale = static_cast<float>(s.texels_per_m);
  Skin skin;
  skin.normal = {sign * static_cast<float>(s.axes(0, axis)), sign * static_cast<float>(s.axes(1, axis)),
                 sign * static_cast<float>(s.axes(2, axis))};
  skin.u = (axis == 0 ? y : x) * scale + static_cast<float>(s.u_offset);
  skin.v = (axis == 2 ? y : -z) * scale + static_cast<float>(s.v_offset);
  skin.texels_per_m = scale;
  return skin;
}

RayCaster::Skin RayCaster::skin_of_round(const Seen& seen, F3 q) const {
  const Shape& s = *seen.shape;
  const Texture& texture = materials_[static_cast<std::size_t>(s.material)];
  const bool flat_end = s.kind == ShapeKind::Cylinder && std::abs(q.z) > 0.9999f;
  const float along = s.kind == ShapeKind::Ellipsoid || s.kind == ShapeKind::Cylinder ? 1 : seen.straight + 1;
  // The gradient of the implicit surface in the shape's own axes.
  const float bulge =
      s.kind == ShapeKind::Ellipsoid ? q.z : q.z - std::clamp(q.z, -seen.straight, seen.straight);
  Vec3 gradient{q.x / s.half.x, q.y / s.half.y,
                s.kind == ShapeKind::Cylinder ? 0 : bulge / (s.half.z / seen.straight)};
  if (flat_end) gradient = {0, 0, q.z};
  const Vec3 n = normalized(s.axes * gradient);
  Skin skin;
  skin.normal = {static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)};
  const auto width = static_cast<float>(texture.width()), height = static_cast<float>(texture.height());
  skin.u =
      (std::atan2(q.y, q.x) * static_cast<float>(0.5 / M_PI) + 0.5f) * width + static_cast<float>(s.u_offset);
  skin.v = (q.z / along * 0.5f + 0.5f) * height;
  skin.texels_per_m = width / static_cast<float>(M_PI * (s.half.x + s.half.y));
  return skin;
}

RayCaster::Skin RayCaster::skin(const Hit& hit, float x, float y, F3 world) const {
  if (hit.seen == nullptr) return skin_of_room(world);
  const F3 d = direction(*hit.seen, x, y), o = hit.seen->origin;
  const F3 q{o.x + hit.t * d.x, o.y + hit.t * d.y, o.z + hit.t * d.z};
  Skin skin = hit.seen->kind == ShapeKind::Box ? skin_of_box(*hit.seen, q) : skin_of_round(*hit.seen, q);
  skin.texture = &materials_[static_cast<std::size_t>(hit.seen->shape->material)];
  skin.tint = hit.seen->shape->tint;
  return skin;
}

void RayCaster::add_colour(std::span<std::array<std::uint16_t, 3>> sums) const {
  const auto focal_px = static_cast<float>(camera_.fx), lamp_z = static_cast<float>(room_.height) - 0.1f;
  for_each_pixel([&](std::size_t pixel, float x, float y, const Hit& hit) {
    const F3 p{position_.x + hit.t * (x * right_.x + y * down_.x + forward_.x),
               position_.y + hit.t * (x * right_.y + y * down_.y + forward_.y),
               position_.z + hit.t * (x * right_.z + y * down_.z + forward_.z)};
    const Skin s = skin(hit, x, y, p);
    // The copy of the texture whose texels are about as large as the pixel.
    const float texels_per_px = std::max(s.texels_per_m * hit.t / focal_px, 1.0f);
    const int level = static_cast<int>(std::bit_cast<std::uint32_t>(texels_per_px * 1.2f) >> 23) - 127;
    const std::uint32_t texel = s.texture->sample(s.u, s.v, level);
    // Light from everywhere, from a lamp under the ceiling's middle, and a little from one side.
    const F3 to_lamp{-p.x, -p.y, lamp_z - p.z};
    const float distance_sq = to_lamp.x * to_lamp.x + to_lamp.y * to_lamp.y + to_lamp.z * to_lamp.z;
    const float facing =
        std::max(0.0f, s.normal.x * to_lamp.x + s.normal.y * to_lamp.y + s.normal.z * to_lamp.z);
    const float light =
        s.tint * (0.62f + 0.55f * facing / std::sqrt(distance_sq) / (1 + 0.05f * distance_sq) +
                  0.1f * s.normal.x + 0.06f * s.normal.y);
    const auto factor = static_cast<std::uint32_t>(std::max(0.0f, light) * 256);
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint32_t value = std::min(((texel >> (8 * c)) & 255) * factor >> 8, 255u);
      sums[pixel][c] = static_cast<std::uint16_t>(sums[pixel][c] + value);
    }
  });
}

}  // namespace stillmap::synthetic
