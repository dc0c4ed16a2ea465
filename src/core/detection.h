// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/fixed_vector.h"
#include "core/geometry.h"
#include "core/time.h"

namespace stillmap {

/// How a class of objects behaves (seed paper, Table 1). Ignored: a class that the table does not name.
enum class ClassKind : std::uint8_t { Ignored, Static, SemiStatic, Dynamic };

/// Axis-aligned box in pixels of the full colour picture; right and bottom edges are exclusive.
struct Box {
  float x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool contains(double x, double y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
  float width() const { return x1 - x0; }
  float height() const { return y1 - y0; }
  float area() const { return width() * height(); }
};

struct Detection {
  Box box;
  std::uint16_t class_id = 0;  ///< index into `classes.names`
  ClassKind kind = ClassKind::Ignored;
  float score = 0;
  float depth_m = 0;  ///< of the object's nearer part, along the optical axis; 0 = unknown
  // What following it from detection to detection tells; only in boxes that were carried.
  std::uint32_t object = 0;  ///< the same for as long as it is followed, from 1 on
  Nanoseconds age_ns = 0;    ///< since it was first found
  Vec3 velocity_m_s{};       ///< in the odom frame
};

/// The objects of one frame.
struct Detections {
  std::uint64_t sequence = 0;  ///< of the frame they were found in
  Nanoseconds stamp_ns = 0;    ///< that frame's colour stamp
  FixedVector<Detection, 64> items;
};

}  // namespace stillmap
