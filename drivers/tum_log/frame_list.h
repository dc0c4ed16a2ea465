// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/event.h"
#include "core/status.h"
#include "core/time.h"

namespace stillmap {

/// One colour picture of a log and the depth picture that goes with it.
struct ListedFrame {
  Nanoseconds colour_ns = 0, depth_ns = 0;
  std::string colour_path, depth_path;         ///< with the folder's name; no depth where NoDepthMatch
  std::optional<DropReason> known_unusable{};  ///< NoDepthMatch or TimeJump, as the lists alone show
};

/// The frames of a folder in the TUM RGB-D benchmark's layout, in the order of its lists. `associations.txt`
/// (stamp colour stamp depth) decides where it is present; otherwise the pictures of rgb.txt and depth.txt
/// (stamp file) are paired one to one within 20 ms, nearest pairs first, as the benchmark's associate.py
/// does. A colour picture whose stamp is not later than all before it stays in the list as TimeJump. A last
/// line that is cut off, without its newline, is passed over.
///
/// The error (UnreadableInput) names the folder or the line, and the mend.
Result<std::vector<ListedFrame>> read_frame_list(const std::string& folder);

}  // namespace stillmap
