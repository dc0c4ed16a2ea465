// SPDX-License-Identifier: Apache-2.0
#include "drivers/tum_log/frame_list.h"

#include <algorithm>
#include <filesystem>
#include <tuple>

#include "core/text_table.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kWindow_ns = 20'000'000;
constexpr std::size_t kMostInWindow = 64;  // no camera is as fast; all pairs of a dense list are its square

Error wrong(std::string message) {
  return {ExitCode::UnreadableInput, std::move(message)};
}

struct ListedPicture {
  Nanoseconds stamp_ns = 0;
  std::string path;
};

/// Reads `per_row` pairs of (stamp, file) from each line; further columns do not matter.
Result<std::vector<ListedPicture>> read_pictures(const std::string& folder, const char* list,
                                                 std::size_t per_row) {
  const std::string path = folder + "/" + list;
  const Result<std::vector<TextRow>> rows = read_text_table(path);
  if (!rows.ok()) return rows.error();
  std::vector<ListedPicture> pictures;
  for (const TextRow& row : rows.value()) {
    const bool complete = row.columns.size() >= 2 * per_row;
    if (!complete && row.ends_the_file) break;  // cut off when whoever wrote it was
    for (std::size_t i = 0; i < per_row; ++i) {
      const std::optional<Nanoseconds> stamp_ns = complete ? parse_stamp(row.columns[2 * i]) : std::nullopt;
      if (!stamp_ns) {
        return wrong(path + ":" + std::to_string(row.line) + ": expected '" +
                     (per_row == 2 ? "stamp colour-file stamp depth-file" : "stamp file") +
                     "' with stamps in seconds; mend or delete the line");
      }
      pictures.push_back({*stamp_ns, folder + "/" + row.columns[2 * i + 1]});
    }
  }
  return pictures;
}

/// Each stamp that is not later than all before it is a jump.
void mark_jumps(std::vector<ListedFrame>& frames) {
  Nanoseconds latest_ns = -1;
  for (ListedFrame& frame : frames) {
    if (frame.colour_ns <= latest_ns) {
      frame.known_unusable = DropReason::TimeJump;
    } else {
      latest_ns = frame.colour_ns;
    }
  }
}

/// Gives each frame the depth picture that fits it, best pairs of the whole log first. False: too many fit.
bool associate(std::vector<ListedFrame>& frames, std::vector<ListedPicture> depth) {
  const auto earlier = [](const ListedPicture& a, const ListedPicture& b) { return a.stamp_ns < b.stamp_ns; };
  std::stable_sort(depth.begin(), depth.end(), earlier);
  std::vector<std::tuple<Nanoseconds, std::size_t, std::size_t>> pairs;  // difference, frame, depth picture
  for (std::size_t f = 0; f < frames.size(); ++f) {
    if (frames[f].known_unusable) continue;
    const ListedPicture from{frames[f].colour_ns - kWindow_ns, {}};
    const std::size_t before = pairs.size();
    for (auto d = std::lower_bound(depth.begin(), depth.end(), from, earlier);
         d != depth.end() && d->stamp_ns <= frames[f].colour_ns + kWindow_ns; ++d) {
      if (pairs.size() - before == kMostInWindow) return false;
      pairs.emplace_back(std::abs(d->stamp_ns - frames[f].colour_ns), f,
                         static_cast<std::size_t>(d - depth.begin()));
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<bool> taken(depth.size());
  for (const auto& [difference, f, d] : pairs) {
    if (taken[d] || !frames[f].depth_path.empty()) continue;
    taken[d] = true;
    frames[f].depth_ns = depth[d].stamp_ns;
    frames[f].depth_path = depth[d].path;
  }
  for (ListedFrame& frame : frames) {
    if (!frame.known_unusable && frame.depth_path.empty()) frame.known_unusable = DropReason::NoDepthMatch;
  }
  return true;
}

}  // namespace

Result<std::vector<ListedFrame>> read_frame_list(const std::string& folder) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored)) {
    return wrong(folder +
                 ": no such folder; give --source tum:DIR with the folder that holds rgb.txt and depth.txt");
  }
  std::vector<ListedFrame> frames;
  if (fs::exists(folder + "/associations.txt", ignored)) {
    Result<std::vector<ListedPicture>> pictures = read_pictures(folder, "associations.txt", 2);
    if (!pictures.ok()) return pictures.error();
    for (std::size_t i = 0; i < pictures.value().size(); i += 2) {
      const ListedPicture &colour = pictures.value()[i], &depth = pictures.value()[i + 1];
      frames.push_back({colour.stamp_ns, depth.stamp_ns, colour.path, depth.path});
    }
    mark_jumps(frames);
  } else {
    if (!fs::exists(folder + "/rgb.txt", ignored) || !fs::exists(folder + "/depth.txt", ignored)) {
      return wrong(folder + ": no TUM log; it needs rgb.txt and depth.txt, or associations.txt");
    }
    const Result<std::vector<ListedPicture>> colour = read_pictures(folder, "rgb.txt", 1);
    if (!colour.ok()) return colour.error();
    Result<std::vector<ListedPicture>> depth = read_pictures(folder, "depth.txt", 1);
    if (!depth.ok()) return depth.error();
    for (const ListedPicture& picture : colour.value())
      frames.push_back({picture.stamp_ns, 0, picture.path, {}});
    mark_jumps(frames);
    if (!associate(frames, std::move(depth.value())))
      return wrong(folder + "/depth.txt: names more than " + std::to_string(kMostInWindow) +
                   " pictures within 20 ms of one of colour; write the stamps in seconds");
  }
  return frames;
}

}  // namespace stillmap
