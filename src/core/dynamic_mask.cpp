// SPDX-License-Identifier: Apache-2.0
#include "core/dynamic_mask.h"

namespace stillmap {

namespace {

/// Whether the point lies in a box of each kind.
struct Membership {
  bool dynamic = false, semi_static = false, pure_static = false;
};

Membership boxes_around(const DynamicMask& mask, double x, double y) {
  Membership in;
  for (const Detection& d : mask.boxes.items) {
    if (!d.box.contains(x, y)) continue;
    in.dynamic |= d.kind == ClassKind::Dynamic;
    in.semi_static |= d.kind == ClassKind::SemiStatic;
    in.pure_static |= d.kind == ClassKind::Static;
  }
  return in;
}

}  // namespace

Label label_at(const DynamicMask& mask, double x, double y, double depth_m) {
  switch (mask.rule) {
    case DynamicRule::Off:
      return Label::Static;
    case DynamicRule::Paper: {
      const Membership in = boxes_around(mask, x, y);
      if (in.pure_static) return Label::Static;
      if (in.dynamic) return Label::Dynamic;
      return in.semi_static ? Label::SemiStatic : Label::Static;
    }
    case DynamicRule::Silhouette: {
      const DynamicMask::Cell& cell = mask.cell_at(x, y);
      if (cell.label == Label::Static) return Label::Static;
      if (depth_m <= 0) return Label::Unknown;
      const double mm = depth_m * 1000;
      return mm >= cell.near_mm && mm <= cell.far_mm ? cell.label : Label::Static;
    }
  }
  return Label::Unknown;
}

}  // namespace stillmap
