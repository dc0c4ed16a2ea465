// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "tests/support/synthetic_log/shape.h"

namespace stillmap::synthetic {

struct Room {
  RoomShell shell;
  std::vector<Shape> furniture;
};

/// A furnished room: a table with things in the middle, a free ring around it for cameras and people
/// (radius 1.1 m to 2.7 m), furniture and posters along the walls.
Room make_room(std::uint64_t seed);

}  // namespace stillmap::synthetic
