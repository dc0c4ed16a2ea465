// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <set>
#include <utility>

#include "core/config_keys.h"

namespace stillmap::config {

Error wrong(std::string message) {
  return {ExitCode::WrongConfig, std::move(message)};
}

namespace {

Status check_lens(const CameraModel& lens, const std::string& prefix) {
  const std::optional<Vec2> folded = lens.folded_pixel();
  if (!folded) return {};
  return wrong(
      prefix + "k1, k2, p1, p2, k3 fold the picture over itself at the pixel " + number_text(folded->x) +
      ", " + number_text(folded->y) +
      "; they are not this lens' plumb_bob coefficients (a fisheye model's are others): calibrate again");
}

Status check_depth_camera(const Config::Device& d) {
  const CameraModel& lens = d.depth;
  if (lens.width == 0) return {};
  if (lens.height == 0 || lens.fx <= 0 || lens.fy <= 0 || lens.cx <= 0 || lens.cy <= 0 ||
      lens.cx >= lens.width || lens.cy >= lens.height || !d.T_colour_depth) {
    return wrong("camera.depth.width = " + std::to_string(lens.width) +
                 " px asks for registration, which needs camera.depth.height, fx, fy, cx, cy (inside that "
                 "picture) and T_colour_depth, too");
  }
  return check_lens(lens, "camera.depth.");
}

Status check_detector(const Config::Detector& d) {
  if (d.input_width % 32 != 0 || d.input_height % 32 != 0) {
    return wrong("detector.input_width, detector.input_height = " + std::to_string(d.input_width) + ", " +
                 std::to_string(d.input_height) + " px must be multiples of 32");
  }
  const bool hex = d.sha256.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (!d.sha256.empty() && (!hex || d.sha256.size() != 64)) {
    return wrong("detector.sha256 = \"" + d.sha256 +
                 "\" is not 64 lower-case hexadecimal digits (sha256sum FILE)");
  }
  return {};
}

}  // namespace

Status check_whole(const Config& c) {
  if (c.camera.depth_min_m >= c.camera.depth_max_m) {
    return wrong("camera.depth_min_m = " + number_text(c.camera.depth_min_m) +
                 " m must be less than camera.depth_max_m = " + number_text(c.camera.depth_max_m) + " m");
  }
  if (c.camera.cx >= c.camera.width || c.camera.cy >= c.camera.height) {
    return wrong("camera.cx, camera.cy = " + number_text(c.camera.cx) + ", " + number_text(c.camera.cy) +
                 " px lie outside the " + std::to_string(c.camera.width) + " x " +
                 std::to_string(c.camera.height) +
                 " px picture; take the intrinsics of this very resolution");
  }
  if (Status s = check_lens(c.camera, "camera."); !s.ok()) return s;
  if (Status s = check_depth_camera(c.device); !s.ok()) return s;
  if (Status s = check_detector(c.detector); !s.ok()) return s;
  for (const std::string& part : c.track.without) {
    if (std::ranges::find(kTrackParts, part) == kTrackParts.end())
      return wrong("track.without: \"" + part + "\" is none of " +
                   list_text(std::vector<std::string>(kTrackParts.begin(), kTrackParts.end()), quoted));
  }
  if (c.track.weak_inliers < c.track.min_inliers) {
    return wrong("track.weak_inliers = " + std::to_string(c.track.weak_inliers) +
                 " must not be less than track.min_inliers = " + std::to_string(c.track.min_inliers));
  }
  if (c.stream.tls_certificate.empty() != c.stream.tls_key.empty())
    return wrong("stream.tls_certificate and stream.tls_key go together; set both or none");
  std::set<std::string> seen;
  for (const auto* list : {&c.classes.dynamic, &c.classes.semi_static, &c.classes.pure_static}) {
    for (const std::string& name : *list) {
      if (!seen.insert(name).second)
        return wrong("classes: '" + name + "' is listed twice; a class has one kind");
    }
  }
  return {};
}

}  // namespace stillmap::config
