// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/targets.h"

#include <array>
#include <cstdlib>

namespace stillmap::fuzz {

std::span<const Target> targets() {
  static constexpr std::array<Target, 12> kTargets{{{"config", read_config},
                                                    {"frame_list", read_frame_list},
                                                    {"trajectory", read_trajectory},
                                                    {"map_file", read_map},
                                                    {"manifest", read_manifest},
                                                    {"keyframes", read_keyframes},
                                                    {"png", decode_png},
                                                    {"jpeg", decode_jpeg},
                                                    {"camera_picture", convert_camera_picture},
                                                    {"client_message", parse_message},
                                                    {"access", judge_request},
                                                    {"connection", serve_connection}}};
  return kTargets;
}

const Target* find_target(std::string_view name) {
  for (const Target& target : targets()) {
    if (target.name == name) return &target;
  }
  return nullptr;
}

void require(bool holds) {
  if (!holds) std::abort();
}

}  // namespace stillmap::fuzz
