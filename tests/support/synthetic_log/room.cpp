// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/room.h"

#include <algorithm>

#include "tests/support/synthetic_log/materials.h"

namespace stillmap::synthetic {

namespace {

/// Adds shapes that stand in one place: `at` is on the floor, x to the right along the wall, y out of it, z
/// up.
class Place {
 public:
  Place(std::vector<Shape>& shapes, Random& random, Vec3 at, double yaw_rad)
      : shapes_(shapes), random_(random), at_(at), yaw_rad_(yaw_rad) {}

  Shape& box(Vec3 center, Vec3 size, int material, double texels_per_m = 400, double turn_rad = 0) {
    return add(ShapeKind::Box, center, 0.5 * size, material, texels_per_m, turn_rad);
  }
  Shape& cylinder(Vec3 center, double radius, double height, int material) {
    return add(ShapeKind::Cylinder, center, {radius, radius, height / 2}, material, 400, 0);
  }
  Random& random() { return random_; }

 private:
  Shape& add(ShapeKind kind, Vec3 center, Vec3 half, int material, double texels_per_m, double turn_rad) {
    Shape s;
    s.kind = kind;
    s.center = at_ + yaw_rotation(yaw_rad_) * center;
    s.axes = yaw_rotation(yaw_rad_ + turn_rad);
    s.half = half;
    s.material = material;
    s.texels_per_m = texels_per_m;
    s.u_offset = random_.uniform(0, 512);
    s.v_offset = random_.uniform(0, 512);
    s.tint = static_cast<float>(random_.uniform(0.8, 1.1));
    shapes_.push_back(s);
    return shapes_.back();
  }
  std::vector<Shape>& shapes_;
  Random& random_;
  Vec3 at_;
  double yaw_rad_;
};

int any_poster(Random& random) {
  return kPoster + random.below(kPosters);
}

void small_things(Place& place, double half_width, double half_depth, double z, int count) {
  Random& r = place.random();
  for (int i = 0; i < count; ++i) {
    // One slot of the width for each, so that things do not stand inside each other.
    const double slot = 2 * half_width / count;
    const double x = -half_width + slot * (i + 0.5), y = r.uniform(-half_depth, half_depth);
    switch (r.below(4)) {
      case 0: {
        const double h = r.uniform(0.1, 0.25), radius = std::min(slot / 2.2, r.uniform(0.04, 0.09));
        place.cylinder({x, y, z + h / 2}, radius, h,
                       r.chance(0.5) ? any_poster(r) : static_cast<int>(kMetal));
        break;
      }
      case 1: {
        const double h = r.uniform(0.04, 0.12);
        place.box({x, y, z + h / 2}, {slot * 0.7, 0.2, h}, kBooks, 500, r.uniform(-0.4, 0.4));
        break;
      }
      default: {
        const double h = r.uniform(0.1, 0.32);
        const double turn = r.uniform(-0.25, 0.25), texels = r.uniform(700, 1100);
        const int material = r.chance(0.3) ? any_poster(r) : static_cast<int>(kCarton);
        place.box({x, y, z + h / 2}, {slot * 0.75, r.uniform(0.12, 0.28), h}, material, texels, turn);
      }
    }
  }
}

void table(Place& place, double width, double depth, double height) {
  place.box({0, 0, height - 0.02}, {width, depth, 0.04}, kWood);
  for (double x : {-1.0, 1.0}) {
    for (double y : {-1.0, 1.0}) {
      place.box({x * (width / 2 - 0.05), y * (depth / 2 - 0.05), height / 2 - 0.02},
                {0.06, 0.06, height - 0.04}, kMetal);
    }
  }
}

void monitor(Place& place, double x, double y, double z) {
  const double turn = place.random().uniform(-0.3, 0.3);
  place.box({x, y, z + 0.01}, {0.24, 0.18, 0.02}, kMetal, 400, turn);
  place.box({x, y, z + 0.1}, {0.05, 0.04, 0.2}, kMetal, 400, turn);
  place.box({x, y, z + 0.32}, {0.56, 0.05, 0.34}, kScreen, 456, turn);
}

void shelf(Place& place) {
  Random& r = place.random();
  const double w = r.uniform(0.9, 1.15), h = r.uniform(1.7, 2.1), d = 0.34;
  place.box({0, 0.01, h / 2}, {w, 0.02, h}, kMetal);
  for (double side : {-1.0, 1.0}) place.box({side * w / 2, d / 2, h / 2}, {0.03, d, h}, kWood);
  const int boards = 5;
  for (int i = 0; i <= boards; ++i) {
    const double z = 0.06 + i * (h - 0.1) / boards;
    place.box({0, d / 2, z}, {w - 0.03, d, 0.03}, kWood);
    if (i == boards) break;
    if (r.chance(0.55)) {
      const double filled = w * r.uniform(0.5, 0.95), height = r.uniform(0.2, 0.27);
      // The texture's 128 rows of book spines stand exactly on the board.
      Shape& row = place.box({(filled - w) / 2 + 0.02, d / 2 + 0.02, z + 0.015 + height / 2},
                             {filled, 0.22, height}, kBooks);
      row.texels_per_m = 128 / height;
      row.v_offset = 64;
    } else {
      small_things(place, w / 2 - 0.06, 0.02, z + 0.015, 3);
    }
  }
}

void cabinet(Place& place) {
  Random& r = place.random();
  const double w = r.uniform(0.8, 1.1), h = r.uniform(0.8, 1.3);
  place.box({0, 0.24, h / 2}, {w, 0.46, h}, kMetal, 300);
  small_things(place, w / 2 - 0.1, 0.1, h, 3);
}

void desk(Place& place) {
  Random& r = place.random();
  table(place, 1.2, 0.56, 0.74);
  monitor(place, r.uniform(-0.3, 0.3), 0.05, 0.74);
  place.box({0.3, 0.1, 0.2}, {0.35, 0.35, 0.4}, kCarton, 700, r.uniform(-0.3, 0.3));
}

void cartons(Place& place) {
  Random& r = place.random();
  place.box({0, 0.28, 0.06}, {1.0, 0.5, 0.12}, kWood);
  double z = 0.12;
  for (int layer = 0; layer < 3; ++layer) {
    const double h = r.uniform(0.28, 0.42);
    for (int i = 0; i < 3 - layer; ++i) {
      const double turn = r.uniform(-0.15, 0.15), texels = r.uniform(500, 900), depth = r.uniform(0.3, 0.42);
      place.box({(i - (2 - layer) / 2.0) * 0.36, 0.28, z + h / 2}, {0.33, depth, h}, kCarton, texels, turn);
    }
    z += h;
  }
}

void bins(Place& place) {
  Random& r = place.random();
  for (int i = 0; i < 3; ++i) {
    const double h = r.uniform(0.5, 0.95);
    const int material = i == 1 ? static_cast<int>(kHazard) : any_poster(r);
    place.cylinder({(i - 1) * 0.4, 0.25, h / 2}, r.uniform(0.14, 0.19), h, material);
  }
}

void along_wall(std::vector<Shape>& shapes, Random& random, Vec3 middle, double yaw_rad, double half_length,
                double height) {
  const Mat3 turn = yaw_rotation(yaw_rad);
  const int slots = static_cast<int>(2 * half_length / 1.3);
  for (int i = 0; i < slots; ++i) {
    const double x = -half_length + 2 * half_length * (i + 0.5) / slots;
    Place place(shapes, random, middle + turn * Vec3{x + random.uniform(-0.05, 0.05), 0.02, 0}, yaw_rad);
    switch (random.below(6)) {
      case 0:
      case 1:
        shelf(place);
        break;
      case 2:
        cabinet(place);
        break;
      case 3: {
        Place out(shapes, random, middle + turn * Vec3{x, 0.3, 0}, yaw_rad);
        desk(out);
        break;
      }
      case 4:
        cartons(place);
        break;
      default:
        bins(place);
    }
    // Something hangs above each: a poster, often two, and now and then a pipe.
    for (double side : {-0.3, 0.32}) {
      if (random.chance(0.15)) continue;
      const double size = random.uniform(0.4, 0.56);
      const int material = any_poster(random);
      const double tall = size * random.uniform(0.9, 1.3), up = random.uniform(1.65, height - 0.45);
      Shape& p = place.box({side, 0, up}, {size, 0.024, tall}, material, 256 / size);
      p.u_offset = p.v_offset = 128;
    }
  }
  Place wall(shapes, random, middle, yaw_rad);
  Shape& pipe = wall.cylinder({0, 0.12, height - 0.18}, 0.05, 2 * half_length, kMetal);
  pipe.axes = frame_along(turn * Vec3{1, 0, 0}, {0, 0, 1});
}

}  // namespace

Room make_room(std::uint64_t seed) {
  Random random(seed, 2);
  Room room;
  RoomShell& shell = room.shell;
  shell.half_x = random.uniform(3.45, 3.75);
  shell.half_y = random.uniform(3.2, 3.45);
  shell.height = random.uniform(2.6, 2.9);
  for (int& wall : shell.walls) wall = random.chance(0.5) ? kBrick : kPlaster;

  std::vector<Shape>& shapes = room.furniture;
  along_wall(shapes, random, {0, -shell.half_y, 0}, 0, shell.half_x - 0.6, shell.height);
  along_wall(shapes, random, {0, shell.half_y, 0}, M_PI, shell.half_x - 0.6, shell.height);
  along_wall(shapes, random, {-shell.half_x, 0, 0}, -M_PI / 2, shell.half_y - 0.6, shell.height);
  along_wall(shapes, random, {shell.half_x, 0, 0}, M_PI / 2, shell.half_y - 0.6, shell.height);

  Place middle(shapes, random, {0, 0, 0}, random.uniform(0, M_PI));
  table(middle, 1.3, 0.8, 0.76);
  small_things(middle, 0.6, 0.2, 0.76, 5);
  middle.box({-0.2, 0, 0.22}, {0.5, 0.4, 0.44}, kCarton, 700, 0.3);

  Place floor(shapes, random, {0, 0, 0}, 0);
  for (int i = 0; i < 8; ++i) {  // mats and markings
    const double angle = random.uniform(0, 2 * M_PI), radius = random.uniform(1.1, 2.4),
                 size = random.uniform(0.3, 0.7);
    const double turn = random.uniform(0, M_PI);
    const int material = i % 3 == 0 ? static_cast<int>(kHazard) : any_poster(random);
    floor.box({radius * std::cos(angle), radius * std::sin(angle), 0.001},
              {size, size * 0.6, 0.002 + 0.001 * i}, material, 256 / size, turn);
  }
  for (double x : {-1.4, 1.4}) {  // lamps
    floor.box({x, 0, shell.height - 0.04}, {0.25, 1.2, 0.08}, kHelmet).tint = 1.5f;
  }
  for (double x : {-1.0, 1.0}) {  // pillars
    for (double y : {-1.0, 1.0}) {
      floor.cylinder({x * (shell.half_x - 0.2), y * (shell.half_y - 0.2), shell.height / 2}, 0.16,
                     shell.height, any_poster(random));
    }
  }
  return room;
}

}  // namespace stillmap::synthetic
