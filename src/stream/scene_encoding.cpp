// SPDX-License-Identifier: Apache-2.0
#include "stream/scene_encoding.h"

#include <pb_encode.h>

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "stream/proto_values.h"

namespace stillmap::stream {
namespace {

constexpr std::uint32_t kPictureDataField = 2;  // CompressedImage.data, which nanopb is told to leave to us
constexpr double kLeastSize_m = 0.05;           // a box has a volume, whatever was measured
constexpr double kLeastSpeed_m_s = 0.1;         // slower: no arrow
constexpr std::int32_t kLifetime_ns = 500'000'000;
constexpr foxglove_Color kRed{0.94, 0.27, 0.27, 1}, kAmber{0.96, 0.65, 0.14, 1}, kGreen{0.26, 0.8, 0.45, 1},
    kGrey{0.6, 0.65, 0.7, 1}, kWhite{1, 1, 1, 1};

foxglove_Color with_alpha(foxglove_Color color, double alpha) {
  color.a = alpha;
  return color;
}

const foxglove_Color& color_of(ClassKind kind) {
  return kind == ClassKind::Dynamic ? kRed : kAmber;
}

const char* name_of(const StreamObject& object, std::span<const std::string> class_names) {
  return object.class_id < class_names.size() ? class_names[object.class_id].c_str() : "?";
}

/// One sub-message of a repeated field that is written piece by piece.
template <class Message>
bool write_item(pb_ostream_t* stream, const pb_field_t* field, const pb_msgdesc_t* type,
                const Message& item) {
  return pb_encode_tag_for_field(stream, field) && pb_encode_submessage(stream, type, &item);
}

/// What an encoding callback works with.
struct Source {
  const StreamScene& scene;
  std::span<const std::string> class_names;
  const CameraModel* camera = nullptr;
  const PreviewSize* size = nullptr;
  pb_callback_t callback(bool (*encode)(pb_ostream_t*, const pb_field_t*, void* const*)) {
    pb_callback_t made{};
    made.funcs.encode = encode;
    made.arg = this;
    return made;
  }
};

/// The rotation that turns x towards `direction` (of any length but 0), which is where an arrow points.
Mat3 towards(Vec3 direction) {
  const Vec3 x = 1 / norm(direction) * direction;
  const Vec3 other = std::abs(x.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{0, 1, 0};
  const Vec3 across = cross(other, x), y = 1 / norm(across) * across, z = cross(x, y);
  return {{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
}

template <std::size_t N>
void add_metadata(foxglove_SceneEntity& entity, const char (&key)[N], const char* format, auto value) {
  foxglove_KeyValuePair& pair = entity.metadata[entity.metadata_count++];
  set_text(pair.key, key);
  format_text(pair.value, format, value);
}

void fill_entity(const Source& source, const StreamObject& object, foxglove_SceneEntity& entity) {
  const CameraModel& camera = *source.camera;
  const double depth_m = 0.5 * (static_cast<double>(object.near_m) + object.far_m);
  const Vec2 ray = camera.undistort({0.5 * (static_cast<double>(object.box.x0) + object.box.x1),
                                     0.5 * (static_cast<double>(object.box.y0) + object.box.y1)});
  const Pose& T_map_camera = source.scene.T_map_camera;
  const Pose T_map_box{T_map_camera.R, T_map_camera * (depth_m * Vec3{ray.x, ray.y, 1})};
  const Vec3 size{std::max(object.box.width() / camera.fx * depth_m, kLeastSize_m),
                  std::max(object.box.height() / camera.fy * depth_m, kLeastSize_m),
                  std::max(static_cast<double>(object.far_m) - object.near_m, kLeastSize_m)};
  const char* name = name_of(object, source.class_names);
  // What is only moved now and then stands; its velocity is the detector's noise.
  const double speed = object.kind == ClassKind::Dynamic ? norm(object.velocity_m_s) : 0;

  set_stamp(entity, source.scene.stamp_ns);
  set_text(entity.frame_id, kMapFrame);
  format_text(entity.id, "object %u", object.id);
  entity.has_lifetime = true;
  entity.lifetime.nanos = kLifetime_ns;
  add_metadata(entity, "class", "%s", name);
  add_metadata(entity, "kind", "%s", object.kind == ClassKind::Dynamic ? "dynamic" : "semi_static");
  add_metadata(entity, "speed_m_s", "%.2f", speed);
  add_metadata(entity, "age_s", "%.2f", to_seconds(object.age_ns));

  entity.cubes_count = 1;
  foxglove_CubePrimitive& cube = entity.cubes[0];
  cube.has_pose = cube.has_size = cube.has_color = true;
  set_pose(cube.pose, T_map_box);
  cube.size = vector3(size);
  cube.color = with_alpha(color_of(object.kind), 0.35);

  entity.texts_count = 1;
  foxglove_TextPrimitive& text = entity.texts[0];
  text.has_pose = text.has_color = text.billboard = true;
  set_pose(text.pose, T_map_box * Pose{{}, {0, -0.5 * size.y - 0.1, 0}});
  text.font_size = 0.15;
  text.color = kWhite;
  format_text(text.text, speed < kLeastSpeed_m_s ? "%.24s" : "%.24s %.1f m/s", name, speed);

  if (speed < kLeastSpeed_m_s) return;
  entity.arrows_count = 1;
  foxglove_ArrowPrimitive& arrow = entity.arrows[0];
  arrow.has_pose = arrow.has_color = true;
  set_pose(arrow.pose, {towards(object.velocity_m_s), T_map_box.t});
  arrow.shaft_length = 0.8 * speed;
  arrow.shaft_diameter = 0.04;
  arrow.head_length = 0.2 * speed;
  arrow.head_diameter = 0.1;
  arrow.color = color_of(object.kind);
}

bool write_entities(pb_ostream_t* stream, const pb_field_t* field, void* const* arg) {
  const auto& source = *static_cast<const Source*>(*arg);
  if (!source.scene.has_pose) return true;
  return std::ranges::all_of(source.scene.objects, [&](const StreamObject& object) {
    if (object.far_m <= 0) return true;
    foxglove_SceneEntity entity = foxglove_SceneEntity_init_zero;
    fill_entity(source, object, entity);
    return write_item(stream, field, foxglove_SceneEntity_fields, entity);
  });
}

foxglove_Point2 point(const Source& source, double x, double y) {
  return {source.size->scaled(x), source.size->scaled(y)};
}

/// The features of one label as one annotation.
struct FeatureGroup {
  const Source& source;
  Label label;
};

bool write_feature_points(pb_ostream_t* stream, const pb_field_t* field, void* const* arg) {
  const auto& group = *static_cast<const FeatureGroup*>(*arg);
  return std::ranges::all_of(group.source.scene.features, [&](const StreamFeature& f) {
    return f.label != group.label ||
           write_item(stream, field, foxglove_Point2_fields, point(group.source, f.x, f.y));
  });
}

struct Outline {
  const Source& source;
  const Box& box;
};

bool write_corners(pb_ostream_t* stream, const pb_field_t* field, void* const* arg) {
  const auto& [source, box] = *static_cast<const Outline*>(*arg);
  for (const foxglove_Point2& corner : {point(source, box.x0, box.y0), point(source, box.x1, box.y0),
                                        point(source, box.x1, box.y1), point(source, box.x0, box.y1)}) {
    if (!write_item(stream, field, foxglove_Point2_fields, corner)) return false;
  }
  return true;
}

template <class Points>
bool write_points(pb_ostream_t* stream, const pb_field_t* field, Nanoseconds stamp_ns,
                  foxglove_PointsAnnotation_Type type, const foxglove_Color& color, double thickness,
                  Points& points, bool (*write)(pb_ostream_t*, const pb_field_t*, void* const*)) {
  foxglove_PointsAnnotation annotation = foxglove_PointsAnnotation_init_zero;
  set_stamp(annotation, stamp_ns);
  annotation.type = type;
  annotation.has_outline_color = true;
  annotation.outline_color = color;
  annotation.thickness = thickness;
  annotation.points.funcs.encode = write;
  annotation.points.arg = &points;
  return write_item(stream, field, foxglove_PointsAnnotation_fields, annotation);
}

bool write_points_annotations(pb_ostream_t* stream, const pb_field_t* field, void* const* arg) {
  const auto& source = *static_cast<const Source*>(*arg);
  const Nanoseconds stamp_ns = source.scene.stamp_ns;
  for (const auto& [label, color] : {std::pair{Label::Unknown, kGrey}, std::pair{Label::Static, kGreen},
                                     std::pair{Label::SemiStatic, kAmber}, std::pair{Label::Dynamic, kRed}}) {
    FeatureGroup group{source, label};
    if (!write_points(stream, field, stamp_ns, foxglove_PointsAnnotation_Type_POINTS, color, 2, group,
                      write_feature_points))
      return false;
  }
  return std::ranges::all_of(source.scene.objects, [&](const StreamObject& object) {
    Outline outline{source, object.box};
    return write_points(stream, field, stamp_ns, foxglove_PointsAnnotation_Type_LINE_LOOP,
                        color_of(object.kind), 1.5, outline, write_corners);
  });
}

bool write_text_annotations(pb_ostream_t* stream, const pb_field_t* field, void* const* arg) {
  const auto& source = *static_cast<const Source*>(*arg);
  return std::ranges::all_of(source.scene.objects, [&](const StreamObject& object) {
    foxglove_TextAnnotation text = foxglove_TextAnnotation_init_zero;
    set_stamp(text, source.scene.stamp_ns);
    text.has_position = text.has_text_color = text.has_background_color = true;
    text.position = point(source, object.box.x0, object.box.y0);
    // A carried box keeps the score of the detection that it comes from.
    format_text(text.text, "%.24s %.2f", name_of(object, source.class_names),
                static_cast<double>(object.score));
    text.font_size = 10;
    text.text_color = kWhite;
    text.background_color = color_of(object.kind);
    return write_item(stream, field, foxglove_TextAnnotation_fields, text);
  });
}

std::size_t encode(const pb_msgdesc_t* type, const void* message, std::span<std::uint8_t> out) {
  pb_ostream_t stream = pb_ostream_from_buffer(out.data(), out.size());
  STILLMAP_CHECK(pb_encode(&stream, type, message));
  return stream.bytes_written;
}

}  // namespace

std::size_t encode_objects(const StreamScene& scene, std::span<const std::string> class_names,
                           const CameraModel& camera, std::span<std::uint8_t, kMaxObjectsBytes> out) {
  Source source{.scene = scene, .class_names = class_names, .camera = &camera};
  foxglove_SceneUpdate message = foxglove_SceneUpdate_init_zero;
  message.entities = source.callback(write_entities);
  return encode(foxglove_SceneUpdate_fields, &message, out);
}

std::size_t encode_annotations(const StreamScene& scene, std::span<const std::string> class_names,
                               const PreviewSize& size, std::span<std::uint8_t, kMaxAnnotationsBytes> out) {
  Source source{.scene = scene, .class_names = class_names, .size = &size};
  foxglove_ImageAnnotations message = foxglove_ImageAnnotations_init_zero;
  set_stamp(message, scene.stamp_ns);
  message.points = source.callback(write_points_annotations);
  message.texts = source.callback(write_text_annotations);
  return encode(foxglove_ImageAnnotations_fields, &message, out);
}

std::size_t encode_calibration(const CameraModel& camera, Nanoseconds stamp_ns,
                               std::span<std::uint8_t, kMaxCalibrationBytes> out) {
  const PreviewSize size(camera);
  const double fx = camera.fx / size.step, fy = camera.fy / size.step, cx = size.scaled(camera.cx),
               cy = size.scaled(camera.cy);
  foxglove_CameraCalibration message = foxglove_CameraCalibration_init_zero;
  set_stamp(message, stamp_ns);
  set_text(message.frame_id, kCameraFrame);
  set_text(message.distortion_model, "plumb_bob");
  message.width = static_cast<std::uint32_t>(size.width);
  message.height = static_cast<std::uint32_t>(size.height);
  const auto set = [](auto& field, pb_size_t& count, std::initializer_list<double> values) {
    std::ranges::copy(values, field);
    count = static_cast<pb_size_t>(values.size());
  };
  set(message.D, message.D_count, {camera.k1, camera.k2, camera.p1, camera.p2, camera.k3});
  set(message.K, message.K_count, {fx, 0, cx, 0, fy, cy, 0, 0, 1});
  set(message.R, message.R_count, {1, 0, 0, 0, 1, 0, 0, 0, 1});
  set(message.P, message.P_count, {fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0});
  return encode(foxglove_CameraCalibration_fields, &message, out);
}

std::size_t encode_picture(std::span<const std::uint8_t> jpeg, Nanoseconds stamp_ns,
                           std::span<std::uint8_t> out) {
  foxglove_CompressedImage message = foxglove_CompressedImage_init_zero;
  set_stamp(message, stamp_ns);
  set_text(message.format, "jpeg");
  set_text(message.frame_id, kCameraFrame);
  pb_ostream_t stream = pb_ostream_from_buffer(out.data(), out.size());
  const bool fits = pb_encode(&stream, foxglove_CompressedImage_fields, &message) &&
                    pb_encode_tag(&stream, PB_WT_STRING, kPictureDataField) &&
                    pb_encode_string(&stream, jpeg.data(), jpeg.size());
  return fits ? stream.bytes_written : 0;
}

}  // namespace stillmap::stream
