// SPDX-License-Identifier: Apache-2.0
#include "eval/trajectory.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "core/text_table.h"
#include "core/whole_file.h"

namespace stillmap {

namespace {

constexpr double kQuaternionLengthTolerance = 0.01;

bool parse_number(const std::string& text, double& value) {
  const char* end = text.data() + text.size();
  const auto [stopped, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && stopped == end && std::isfinite(value);
}

/// The row as a pose, or what is wrong with it.
Result<StampedPose> pose_from(const TextRow& row) {
  const auto wrong = [](std::string what) { return Error{ExitCode::UnreadableInput, std::move(what)}; };
  if (row.columns.size() != 8) {
    return wrong(std::to_string(row.columns.size()) + " columns, expected 8: stamp tx ty tz qx qy qz qw");
  }
  const std::optional<Nanoseconds> stamp_ns = parse_stamp(row.columns[0]);
  if (!stamp_ns) return wrong("'" + row.columns[0] + "' is not a stamp in seconds");
  std::array<double, 7> v{};
  for (std::size_t i = 0; i < 7; ++i) {
    if (!parse_number(row.columns[i + 1], v[i]))
      return wrong("'" + row.columns[i + 1] + "' is not a finite number");
  }
  const Quaternion q{v[6], v[3], v[4], v[5]};
  const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  if (!(std::abs(length - 1) <= kQuaternionLengthTolerance)) {
    return wrong("columns 5 to 8 (qx qy qz qw) are no unit quaternion");
  }
  return StampedPose{*stamp_ns, {rotation_from(q), {v[0], v[1], v[2]}}};
}

/// Fixed decimals whatever the process's locale.
void append_number(std::string& line, double value, int decimals) {
  std::array<char, 400> text{};  // the longest double has 309 digits before the point
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed, decimals);
  line += ' ';
  line.append(text.data(), end.ptr);
}

}  // namespace

Result<std::vector<StampedPose>> read_trajectory(const std::string& path) {
  const Result<std::vector<TextRow>> rows = read_text_table(path);
  if (!rows.ok()) return rows.error();
  std::vector<StampedPose> poses;
  poses.reserve(rows.value().size());
  for (const TextRow& row : rows.value()) {
    const Result<StampedPose> pose = pose_from(row);
    if (!pose.ok()) {
      return Error{ExitCode::UnreadableInput,
                   path + ":" + std::to_string(row.line) + ": " + pose.error().message};
    }
    poses.push_back(pose.value());
  }
  if (poses.empty()) {
    return Error{ExitCode::UnreadableInput,
                 path + ": holds no pose; expected lines of 'stamp tx ty tz qx qy qz qw' (TUM format)"};
  }
  // Reversed, so that the last of equal stamps is the one that unique() keeps.
  std::reverse(poses.begin(), poses.end());
  const auto earlier = [](const StampedPose& a, const StampedPose& b) { return a.stamp_ns < b.stamp_ns; };
  const auto same = [](const StampedPose& a, const StampedPose& b) { return a.stamp_ns == b.stamp_ns; };
  std::stable_sort(poses.begin(), poses.end(), earlier);
  poses.erase(std::unique(poses.begin(), poses.end(), same), poses.end());
  return poses;
}

Status write_trajectory(const std::string& path, std::span<const StampedPose> poses,
                        const std::string& header_line) {
  std::string text = "# " + header_line + "\n# timestamp tx ty tz qx qy qz qw\n";
  for (const StampedPose& pose : poses) {
    const Vec3& t = pose.T_world_camera.t;
    const Quaternion q = quaternion_from(pose.T_world_camera.R);
    text += stamp_text(pose.stamp_ns);
    for (const double v : {t.x, t.y, t.z}) append_number(text, v, 6);
    for (const double v : {q.x, q.y, q.z, q.w}) append_number(text, v, 8);
    text += '\n';
  }
  return write_whole(path, text);
}

}  // namespace stillmap
