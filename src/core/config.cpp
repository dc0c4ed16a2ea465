// SPDX-License-Identifier: Apache-2.0
#include "core/config.h"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <sstream>
#include <string_view>
#include <variant>

#include "core/correction.h"
#include "core/default_classes.h"

namespace stillmap {

namespace {

using Mount = std::optional<std::array<double, 7>>;
using Maybe = std::optional<double>;
using Triple = std::array<double, 3>;
using Target = std::variant<bool*, int*, std::int64_t*, double*, std::string*, std::vector<std::string>*,
                            std::vector<int>*, Triple*, Mount*, Maybe*, DynamicRule*>;

/// One setting: where it is stored and what may stand there.
struct Key {
  const char* name;
  Target target;
  const char* unit;
  const char* help;
  double min = 0, max = 0;
  bool required = false;
  bool is_path = false;
  std::string origin = "default";
};

constexpr std::array<std::pair<const char*, DynamicRule>, 3> kRules{
    {{"off", DynamicRule::Off}, {"paper", DynamicRule::Paper}, {"silhouette", DynamicRule::Silhouette}}};

constexpr std::array<const char*, 5> kDecoders{"nanodet_plus", "nanodet", "yolov5", "yolov8", "yolox"};

/// Every key of the configuration. The one place that a new setting is added to, beside its field.
std::vector<Key> describe(Config& c) {
  return {
      {"runtime.seed", &c.runtime.seed, "", "decides every random sample", 0, 9e15},
      {"runtime.flight_recorder", &c.runtime.flight_recorder, "",
       "file for the last 10 s when tracking is lost or the program aborts; empty: none", 0, 0, false, true},
      {"threads.tracking_core", &c.threads.tracking_core, "",
       "capture and tracking run on this one of the cores that the process may use, counted from 0; -1: on "
       "any",
       -1, 255},
      {"threads.other_core", &c.threads.other_core, "", "the core of all other threads; -1: on any", -1, 255},
      {"threads.realtime", &c.threads.realtime, "", "capture and tracking go before all else (SCHED_FIFO)"},
      {"memory.lock", &c.memory.lock, "", "keep the runtime's memory from being swapped out"},
      {"memory.budget_mb", &c.memory.budget_mb, "MB", "a plan above this is refused", 16, 65536},
      {"camera.name", &c.mount.name, "", "for people"},
      {"camera.width", &c.camera.width, "px", "picture width", 160, 1280, true},
      {"camera.height", &c.camera.height, "px", "picture height", 120, 960, true},
      {"camera.fx", &c.camera.fx, "px", "focal length", 50, 5000, true},
      {"camera.fy", &c.camera.fy, "px", "focal length", 50, 5000, true},
      {"camera.cx", &c.camera.cx, "px", "principal point", 0, 1280, true},
      {"camera.cy", &c.camera.cy, "px", "principal point", 0, 960, true},
      {"camera.k1", &c.camera.k1, "", "radial distortion (plumb_bob)", -10, 10},
      {"camera.k2", &c.camera.k2, "", "radial distortion", -10, 10},
      {"camera.p1", &c.camera.p1, "", "tangential distortion", -1, 1},
      {"camera.p2", &c.camera.p2, "", "tangential distortion", -1, 1},
      {"camera.k3", &c.camera.k3, "", "radial distortion", -10, 10},
      {"camera.depth_units_per_m", &c.camera.depth_units_per_m, "1/m", "raw depth of one metre", 1, 100000,
       true},
      {"camera.depth_min_m", &c.camera.depth_min_m, "m", "nearer readings are not trusted", 0, 10},
      {"camera.depth_max_m", &c.camera.depth_max_m, "m", "farther readings are not trusted", 0.1, 60},
      {"camera.depth_noise_m_at_1m", &c.camera.depth_noise_m_at_1m, "m",
       "depth noise (1 sigma) at 1 m; grows with depth^2", 1e-5, 1},
      {"camera.readout_s", &c.camera.readout_s, "s",
       "from the first row's exposure to the last one's; 0: global shutter, negative: bottom first; left "
       "out: "
       "learned while the camera turns",
       -0.1, 0.1},
      {"camera.stamp_sigma_s", &c.camera.stamp_sigma_s, "s",
       "how far (1 sigma) exposure may be from the colour stamp: rolling shutter, clock", 0, 0.2},
      {"camera.fps", &c.mount.fps, "Hz", "frame rate", 1, 240},
      {"camera.T_base_camera", &c.mount.T_base_camera, "m",
       "camera in the robot's base: x, y, z, qx, qy, qz, qw", -100, 100},
      {"camera.colour_format", &c.device.colour_format, "",
       "format of colour: YUYV, NV12, RGB3, BGR3, MJPG or GREY; empty: the device's best"},
      {"camera.depth_format", &c.device.depth_format, "", "V4L2 format of depth; empty: Z16, else Y16"},
      {"camera.colour_controls", &c.device.colour_controls, "",
       "V4L2 controls of the colour node, NAME=NUMBER as v4l2-ctl lists them"},
      {"camera.depth_controls", &c.device.depth_controls, "", "V4L2 controls of the depth node"},
      {"camera.stall_s", &c.device.stall_s, "s", "a camera that is silent for so long is opened anew", 0.2,
       60},
      {"camera.give_up_s", &c.device.give_up_s, "s", "a camera that is gone for so long ends the run", 0,
       86400},
      {"camera.depth.width", &c.device.depth.width, "px",
       "width of a depth picture that is not registered to colour by the device; 0: it is", 0, 1280},
      {"camera.depth.height", &c.device.depth.height, "px", "its height", 0, 960},
      {"camera.depth.fx", &c.device.depth.fx, "px", "the depth camera's focal length", 0, 5000},
      {"camera.depth.fy", &c.device.depth.fy, "px", "the depth camera's focal length", 0, 5000},
      {"camera.depth.cx", &c.device.depth.cx, "px", "the depth camera's principal point", 0, 1280},
      {"camera.depth.cy", &c.device.depth.cy, "px", "the depth camera's principal point", 0, 960},
      {"camera.depth.k1", &c.device.depth.k1, "", "the depth camera's radial distortion (plumb_bob)", -10,
       10},
      {"camera.depth.k2", &c.device.depth.k2, "", "the depth camera's radial distortion", -10, 10},
      {"camera.depth.p1", &c.device.depth.p1, "", "the depth camera's tangential distortion", -1, 1},
      {"camera.depth.p2", &c.device.depth.p2, "", "the depth camera's tangential distortion", -1, 1},
      {"camera.depth.k3", &c.device.depth.k3, "", "the depth camera's radial distortion", -10, 10},
      {"camera.depth.T_colour_depth", &c.device.T_colour_depth, "m",
       "the depth camera in the colour camera: x, y, z, qx, qy, qz, qw", -10, 10},
      {"record.colour", &c.record.colour, "", "colour of --record: \"jpeg\", or \"png\" for exact pixels"},
      {"record.jpeg_quality", &c.record.jpeg_quality, "", "quality of recorded JPEG", 50, 100},
      {"record.buffer_frames", &c.record.buffer_frames, "frames", "frames that may wait for the disk", 2, 32},
      {"detector.model", &c.detector.model, "",
       "ONNX file, \"auto\" (the installed network, else none) or \"none\"", 0, 0, false, true},
      {"detector.sha256", &c.detector.sha256, "", "checksum of the model file; empty: not checked"},
      {"detector.decoder", &c.detector.decoder, "",
       "what the network's outputs mean: \"nanodet_plus\", \"nanodet\", \"yolov5\", \"yolov8\" or \"yolox\""},
      {"detector.input_width", &c.detector.input_width, "px", "network input, a multiple of 32", 64, 1280},
      {"detector.input_height", &c.detector.input_height, "px", "network input, a multiple of 32", 64, 1280},
      {"detector.strides", &c.detector.strides, "px",
       "input px from cell to cell of each output; empty: as the outputs' names say", 4, 128},
      {"detector.colour_order", &c.detector.colour_order, "",
       "order of the input's planes: \"bgr\" or \"rgb\""},
      {"detector.mean", &c.detector.mean, "grey levels", "taken from blue, green and red", -255, 255},
      {"detector.deviation", &c.detector.deviation, "grey levels", "what blue, green and red are divided by",
       1e-3, 1000},
      {"detector.pad", &c.detector.pad, "grey levels", "of the bars beside the picture", 0, 255},
      {"detector.score_threshold", &c.detector.score_threshold, "", "weaker detections are dropped", 0.01, 1},
      {"detector.confirm_score", &c.detector.confirm_score, "",
       "an object counts while its scores, fading by 0.7 from look to look, sum up to this", 0.01, 3},
      {"detector.nms_iou", &c.detector.nms_iou, "", "overlap above which the weaker box of a class goes",
       0.05, 1},
      {"detector.max_age_ms", &c.detector.max_age_ms, "ms", "older boxes are not used", 1, 60000},
      {"classes.names", &c.classes.names, "", "the model's classes in the order of its outputs"},
      {"classes.dynamic", &c.classes.dynamic, "", "classes that move by themselves"},
      {"classes.semi_static", &c.classes.semi_static, "", "classes that are moved now and then"},
      {"classes.static", &c.classes.pure_static, "", "classes that stay"},
      {"track.without", &c.track.without, "",
       "parts left out, to measure what they are worth: carried_boxes, motion_check, point_trust, alignment, "
       "adjustment, loops"},
      {"track.dynamic_rule", &c.track.dynamic_rule, "", "\"silhouette\", \"paper\" or \"off\""},
      {"track.features", &c.track.features, "", "corners per frame", 100, 1200},
      {"track.levels", &c.track.levels, "", "pyramid levels", 1, 8},
      {"track.scale_factor", &c.track.scale_factor, "", "size ratio of two pyramid levels", 1.05, 1.9},
      {"track.fast_threshold", &c.track.fast_threshold, "grey levels", "corner contrast", 3, 100},
      {"track.fast_threshold_min", &c.track.fast_threshold_min, "grey levels",
       "corner contrast where a cell has none", 2, 100},
      {"track.keyframes", &c.track.keyframes, "", "keyframes kept", 8, Correction::kMaxKeyframes},
      {"track.points", &c.track.points, "", "map points kept", 1000, 200000},
      {"track.min_inliers", &c.track.min_inliers, "", "fewer: lost", 6, 500},
      {"track.weak_inliers", &c.track.weak_inliers, "", "fewer: weak", 6, 1000},
      {"track.lost_s", &c.track.lost_s, "s", "lost for longer where there is enough to see: a new segment",
       0.1, 3600},
      {"track.epipolar_threshold_px", &c.track.epipolar_threshold_px, "px",
       "a semi-static feature farther from its epipolar line moves (seed paper, eq. 3)", 0.1, 20},
      {"map.voxel_m", &c.map.voxel_m, "m", "edge of a voxel", 0.005, 0.5},
      {"map.capacity_voxels", &c.map.capacity_voxels, "", "voxels in memory", 10000, 100'000'000},
      {"map.fuse_every", &c.map.fuse_every, "frames", "every n-th tracked frame is fused", 1, 100},
      {"map.max_range_m", &c.map.max_range_m, "m", "farther depth is not fused", 0.5, 20},
      {"map.keyframe_copies", &c.map.keyframe_copies, "",
       "small copies of keyframes, 96 KB each, to make the map anew from after a loop has closed", 0, 1000},
      {"map.save_timeout_s", &c.map.save_timeout_s, "s", "bound on writing the map at shutdown", 0.1, 600},
      {"map.checkpoint_s", &c.map.checkpoint_s, "s",
       "a map file is written this often while running; 0: never", 0, 86400},
      {"stream.listen", &c.stream.listen, "", "ADDR:PORT, or \"off\""},
      {"stream.max_clients", &c.stream.max_clients, "", "clients at once", 1, 64},
      {"stream.preview", &c.stream.preview, "",
       "the camera's picture: \"masked\" (people pixelated), \"off\" or \"full\""},
      {"stream.full_preview_to", &c.stream.full_preview_to, "",
       "who may see a full preview: \"loopback\" or \"network\""},
      {"stream.token_file", &c.stream.token_file, "",
       "file whose first line every client must know; needed beyond loopback", 0, 0, false, true},
      {"stream.tls_certificate", &c.stream.tls_certificate, "", "PEM file; empty: no TLS", 0, 0, false, true},
      {"stream.tls_key", &c.stream.tls_key, "", "PEM file with the certificate's key", 0, 0, false, true},
      {"stream.origins", &c.stream.origins, "", "web pages from elsewhere that may connect"},
  };
}

std::string number_text(double v) {
  std::ostringstream out;
  out.precision(12);
  out << v;
  return out.str();
}

std::string quoted(const std::string& s) {
  return "\"" + s + "\"";
}

std::string list_text(const auto& items, const auto& text_of) {
  std::string text = "[";
  for (const auto& item : items) text += (text.size() > 1 ? ", " : "") + text_of(item);
  return text + "]";
}

std::string value_text(const Target& target) {
  struct Print {
    std::string operator()(const bool* v) const { return *v ? "true" : "false"; }
    std::string operator()(const int* v) const { return std::to_string(*v); }
    std::string operator()(const std::int64_t* v) const { return std::to_string(*v); }
    std::string operator()(const double* v) const { return number_text(*v); }
    std::string operator()(const std::string* v) const { return quoted(*v); }
    std::string operator()(const std::vector<std::string>* v) const { return list_text(*v, quoted); }
    std::string operator()(const std::vector<int>* v) const { return list_text(*v, number_text); }
    std::string operator()(const Triple* v) const { return list_text(*v, number_text); }
    std::string operator()(const Mount* v) const {
      return v->has_value() ? list_text(**v, number_text) : "(unknown)";
    }
    std::string operator()(const Maybe* v) const { return v->has_value() ? number_text(**v) : "(unknown)"; }
    std::string operator()(const DynamicRule* v) const {
      for (const auto& [name, rule] : kRules) {
        if (rule == *v) return quoted(name);
      }
      return "?";
    }
  };
  return std::visit(Print{}, target);
}

std::string expectation(const Key& key) {
  const std::string unit = *key.unit != '\0' ? std::string(" ") + key.unit : "";
  const std::string range = " from " + number_text(key.min) + " to " + number_text(key.max) + unit;
  struct Say {
    const std::string& range;
    std::string operator()(const bool*) const { return "true or false"; }
    std::string operator()(const int*) const { return "a whole number" + range; }
    std::string operator()(const std::int64_t*) const { return "a whole number" + range; }
    std::string operator()(const double*) const { return "a number" + range; }
    std::string operator()(const Maybe*) const { return "a number" + range; }
    std::string operator()(const std::string*) const { return "a text"; }
    std::string operator()(const std::vector<std::string>*) const { return "a list of texts"; }
    std::string operator()(const std::vector<int>*) const { return "a list of whole numbers" + range; }
    std::string operator()(const Triple*) const { return "[blue, green, red]" + range; }
    std::string operator()(const Mount*) const {
      return "[x, y, z, qx, qy, qz, qw] in m and a unit quaternion";
    }
    std::string operator()(const DynamicRule*) const { return "\"silhouette\", \"paper\" or \"off\""; }
  };
  return std::visit(Say{range}, key.target);
}

/// Stores a TOML value; false when its type or range does not fit.
bool assign(Key& key, const toml::node& node) {
  struct Store {
    const Key& key;
    const toml::node& node;
    bool in_range(double v) const { return v >= key.min && v <= key.max; }
    bool operator()(bool* to) const {
      const auto v = node.as_boolean();
      if (v != nullptr) *to = v->get();
      return v != nullptr;
    }
    bool operator()(int* to) const {
      const auto v = node.as_integer();
      if (v == nullptr || !in_range(static_cast<double>(v->get()))) return false;
      *to = static_cast<int>(v->get());
      return true;
    }
    bool operator()(std::int64_t* to) const {
      const auto v = node.as_integer();
      if (v == nullptr || !in_range(static_cast<double>(v->get()))) return false;
      *to = v->get();
      return true;
    }
    bool operator()(double* to) const {
      if (!node.is_number()) return false;
      const double v = *node.value<double>();
      if (!in_range(v)) return false;
      *to = v;
      return true;
    }
    bool operator()(Maybe* to) const {
      double v = 0;
      if (!(*this)(&v)) return false;
      *to = v;
      return true;
    }
    bool operator()(std::string* to) const {
      if (!node.is_string()) return false;
      *to = *node.value<std::string>();
      return true;
    }
    bool operator()(std::vector<std::string>* to) const {
      const toml::array* array = node.as_array();
      if (array == nullptr) return false;
      std::vector<std::string> items;
      for (const toml::node& item : *array) {
        if (!item.is_string()) return false;
        items.push_back(*item.value<std::string>());
      }
      *to = std::move(items);
      return true;
    }
    bool operator()(std::vector<int>* to) const {
      const toml::array* array = node.as_array();
      if (array == nullptr) return false;
      std::vector<int> items;
      for (const toml::node& item : *array) {
        if (!Store{key, item}(&items.emplace_back())) return false;
      }
      *to = std::move(items);
      return true;
    }
    bool fill(std::span<double> to) const {
      const toml::array* array = node.as_array();
      if (array == nullptr || array->size() != to.size()) return false;
      for (std::size_t i = 0; i < to.size(); ++i) {
        if (!Store{key, (*array)[i]}(&to[i])) return false;
      }
      return true;
    }
    bool operator()(Triple* to) const {
      Triple v{};
      if (!fill(v)) return false;
      *to = v;
      return true;
    }
    bool operator()(Mount* to) const {
      std::array<double, 7> v{};
      if (!fill(v)) return false;
      const double n = v[3] * v[3] + v[4] * v[4] + v[5] * v[5] + v[6] * v[6];
      if (std::abs(n - 1) > 1e-3) return false;
      *to = v;
      return true;
    }
    bool operator()(DynamicRule* to) const {
      if (!node.is_string()) return false;
      for (const auto& [name, rule] : kRules) {
        if (*node.value<std::string>() == name) {
          *to = rule;
          return true;
        }
      }
      return false;
    }
  };
  return std::visit(Store{key, node}, key.target);
}

Error wrong(std::string message) {
  return {ExitCode::WrongConfig, std::move(message)};
}

std::string node_text(const toml::node& node) {
  std::ostringstream out;
  node.visit([&](const auto& n) { out << n; });
  return out.str();
}

/// The known key that differs from `name` in the fewest letters, for "did you mean".
std::string nearest_key(const std::vector<Key>& keys, std::string_view name) {
  std::string best;
  std::size_t best_distance = 4;
  for (const Key& key : keys) {
    const std::string_view k = key.name;
    std::vector<std::size_t> row(name.size() + 1);
    for (std::size_t j = 0; j <= name.size(); ++j) row[j] = j;
    for (std::size_t i = 1; i <= k.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i;
      for (std::size_t j = 1; j <= name.size(); ++j) {
        const std::size_t above = row[j];
        row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (k[i - 1] == name[j - 1] ? 0 : 1)});
        diagonal = above;
      }
    }
    if (row[name.size()] < best_distance) {
      best_distance = row[name.size()];
      best = k;
    }
  }
  return best;
}

Status apply_table(std::vector<Key>& keys, const toml::table& table, const std::string& prefix,
                   const std::string& origin, const std::filesystem::path& folder) {
  for (const auto& [name, node] : table) {
    const std::string dotted =
        prefix.empty() ? std::string(name.str()) : prefix + "." + std::string(name.str());
    const auto key = std::find_if(keys.begin(), keys.end(), [&](const Key& k) { return dotted == k.name; });
    if (key == keys.end()) {
      if (const toml::table* inner = node.as_table()) {
        if (Status s = apply_table(keys, *inner, dotted, origin, folder); !s.ok()) return s;
        continue;
      }
      const std::string meant = nearest_key(keys, dotted);
      return wrong(
          origin + ": unknown key '" + dotted + "'" +
          (meant.empty() ? "; `stillmap check --dump` lists every key" : "; did you mean '" + meant + "'?"));
    }
    if (!assign(*key, node)) {
      return wrong(origin + ": key '" + dotted + "' = " + node_text(node) + " does not fit; expected " +
                   expectation(*key));
    }
    if (key->is_path) {
      std::string& path = *std::get<std::string*>(key->target);
      const bool word = path.empty() || path == "auto" || path == "none";
      if (!word && path[0] != '/' && !folder.empty()) path = (folder / path).lexically_normal();
    }
    key->origin = origin;
  }
  return {};
}

Status apply_override(std::vector<Key>& keys, const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    return wrong("--set " + text + ": expected KEY=VALUE, e.g. --set detector.model=none");
  }
  const std::string name = text.substr(0, equals), value = text.substr(equals + 1);
  // A value that is no TOML (a bare word, a path) is taken as text, so that the shell needs no second quotes.
  toml::table table;
  try {
    table = toml::parse(name + " = " + value);
  } catch (const toml::parse_error&) {
    try {
      table = toml::parse(name + " = ''");
    } catch (const toml::parse_error&) {
      return wrong("--set " + text + ": '" + name +
                   "' is not a key; `stillmap check --dump` lists every key");
    }
    toml::node* node = &table;
    while (toml::table* inner = node->as_table()) node = &inner->begin()->second;
    *node->as_string() = value;
  }
  if (table.empty()) return wrong("--set " + text + ": '" + name + "' is a comment, not a key");
  return apply_table(keys, table, "", "--set", {});
}

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
  if (std::ranges::find(kDecoders, d.decoder) == kDecoders.end())
    return wrong("detector.decoder = \"" + d.decoder + "\" is none of " + list_text(kDecoders, quoted));
  if (d.input_width % 32 != 0 || d.input_height % 32 != 0) {
    return wrong("detector.input_width, detector.input_height = " + std::to_string(d.input_width) + ", " +
                 std::to_string(d.input_height) + " px must be multiples of 32");
  }
  if (d.colour_order != "bgr" && d.colour_order != "rgb")
    return wrong("detector.colour_order = \"" + d.colour_order + "\" must be \"bgr\" or \"rgb\"");
  const bool hex = d.sha256.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (!d.sha256.empty() && (!hex || d.sha256.size() != 64)) {
    return wrong("detector.sha256 = \"" + d.sha256 +
                 "\" is not 64 lower-case hexadecimal digits (sha256sum FILE)");
  }
  return {};
}

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
  if (c.record.colour != "jpeg" && c.record.colour != "png") {
    return wrong("record.colour = \"" + c.record.colour + "\" must be \"jpeg\" or \"png\"");
  }
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
  if (c.stream.preview != "masked" && c.stream.preview != "off" && c.stream.preview != "full") {
    return wrong("stream.preview = \"" + c.stream.preview + "\" is not \"masked\", \"off\" or \"full\"");
  }
  if (c.stream.full_preview_to != "loopback" && c.stream.full_preview_to != "network") {
    return wrong("stream.full_preview_to = \"" + c.stream.full_preview_to +
                 "\" is not \"loopback\" or \"network\"");
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

}  // namespace

Result<LoadedConfig> load_config(std::span<const std::string> files, std::span<const std::string> overrides) {
  LoadedConfig loaded;
  std::vector<Key> keys = describe(loaded.config);
  if (Status s = apply_table(keys, toml::parse(kDefaultClasses), "", "built in", {}); !s.ok())
    return s.error();
  for (const std::string& file : files) {
    if (!std::filesystem::is_regular_file(file)) return wrong(file + ": no such configuration file");
    try {
      const toml::table table = toml::parse_file(file);
      if (Status s = apply_table(keys, table, "", file, std::filesystem::path(file).parent_path()); !s.ok())
        return s.error();
    } catch (const toml::parse_error& e) {
      return wrong(file + ":" + std::to_string(e.source().begin.line) +
                   ": not valid TOML: " + std::string(e.description()));
    }
  }
  for (const std::string& text : overrides) {
    if (Status s = apply_override(keys, text); !s.ok()) return s.error();
  }
  for (const Key& key : keys) {
    if (key.required && key.origin == "default") {
      return wrong(std::string("key '") + key.name + "' is missing; expected " + expectation(key) + " (" +
                   key.help + "); add --config with a file of firmware-config/cameras, or --set it");
    }
  }
  if (Status s = check_whole(loaded.config); !s.ok()) return s.error();
  for (const Key& key : keys)
    loaded.entries.push_back({key.name, value_text(key.target), key.unit, key.origin, key.help});
  return loaded;
}

Pose pose_from(const std::array<double, 7>& numbers) {
  const auto& [x, y, z, qx, qy, qz, qw] = numbers;
  return {rotation_from({qw, qx, qy, qz}), {x, y, z}};
}

std::string config_text(const LoadedConfig& loaded) {
  std::string text;
  for (const ConfigEntry& e : loaded.entries) {
    text += e.key + " = " + e.value + "  # " + (e.unit.empty() ? "" : "[" + e.unit + "] ") + e.help +
            "; from " + e.origin + "\n";
  }
  return text;
}

}  // namespace stillmap
