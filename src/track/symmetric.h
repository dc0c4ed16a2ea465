// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "core/geometry.h"

namespace stillmap {

/// A symmetric 3x3 matrix by its upper triangle, row by row.
using Symmetric3 = std::array<double, 6>;

constexpr Mat3 whole(const Symmetric3& a) {
  return {{a[0], a[1], a[2], a[1], a[3], a[4], a[2], a[4], a[5]}};
}
/// Of a matrix that has rows and columns by (row, column).
template <class Matrix>
constexpr Symmetric3 upper_triangle(const Matrix& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)};
}
/// What `a` says of a vector v, said of R * v.
constexpr Symmetric3 turned(const Symmetric3& a, const Mat3& R) {
  return upper_triangle(R * whole(a) * transposed(R));
}

}  // namespace stillmap
