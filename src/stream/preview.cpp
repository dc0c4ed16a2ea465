// SPDX-License-Identifier: Apache-2.0
#include "stream/preview.h"

#include <algorithm>
#include <cmath>

#include "core/halve.h"
#include "stream/scene_encoding.h"

namespace stillmap::stream {
namespace {

constexpr std::size_t kJpegBytes = 48'000;
constexpr int kQuality = 72, kLowQuality = 30;
constexpr float kMargin = 0.12f;   // of a box's size, on each side: hands and hair outlive a box
constexpr int kLeastEdge_px = 10;  // of a pixelated cell, in pixels of the preview
constexpr int kCellsPerBox = 8;    // across the longer side: a head is a cell or two
constexpr int kAroundFeature_px = 12;

}  // namespace

Preview::Preview(Arena& arena, const Config& config)
    : size_(config.camera),
      full_(config.stream.preview == "full"),
      person_class_(static_cast<std::size_t>(std::ranges::find(config.classes.names, "person") -
                                             config.classes.names.begin())),
      pixels_(arena.take<Bgr>("stream.preview", static_cast<std::size_t>(size_.width * size_.height))),
      jpeg_(arena.take<std::uint8_t>("stream.preview_jpeg", kJpegBytes)) {
  const std::span memory = arena.take<std::byte>("stream.jpeg", JpegEncoder::memory_bytes(size_.width));
  if (!arena.planning()) encoder_.emplace(Scratch(memory), size_.width, size_.height);
}

std::size_t Preview::encode(Nanoseconds stamp_ns, const Detections& own, const StreamScene& scene,
                            std::span<std::uint8_t> out) {
  if (!full_) {
    for (const StreamFeature& feature : scene.features) {
      if (feature.label == Label::Dynamic) hide_around(feature);
    }
    for (const StreamObject& object : scene.objects) {
      if (hides(object.class_id, object.kind)) hide(object.box);
    }
    for (const Detection& detection : own.items) {
      if (hides(detection.class_id, detection.kind)) hide(detection.box);
    }
  }
  for (const int quality : {kQuality, kLowQuality}) {
    const std::size_t bytes = encoder_->encode(view(), quality, std::as_writable_bytes(jpeg_));
    if (bytes > 0) return encode_picture(jpeg_.first(bytes), stamp_ns, out);
  }
  return 0;
}

void Preview::shrink(ImageView<const Bgr> colour) {
  const int step = size_.step, count = step * step;
  for (int y = 0; y < size_.height; ++y) {
    Bgr* to = view().row(y);
    if (step == 2) {
      halve_row(colour.row(2 * y), colour.row(2 * y + 1), {to, static_cast<std::size_t>(size_.width)});
      continue;
    }
    for (int x = 0; x < size_.width; ++x) {
      int b = 0, g = 0, r = 0;
      for (int dy = 0; dy < step; ++dy) {
        const Bgr* from = colour.row(y * step + dy) + static_cast<std::ptrdiff_t>(x) * step;
        for (int dx = 0; dx < step; ++dx) {
          b += from[dx].b;
          g += from[dx].g;
          r += from[dx].r;
        }
      }
      to[x] = {static_cast<std::uint8_t>(b / count), static_cast<std::uint8_t>(g / count),
               static_cast<std::uint8_t>(r / count)};
    }
  }
}

bool Preview::hides(std::uint16_t class_id, ClassKind kind) const {
  return kind == ClassKind::Dynamic || class_id == person_class_;
}

void Preview::hide(const Box& box) {
  const float grow_x = kMargin * box.width(), grow_y = kMargin * box.height();
  const auto down = [&](float v) { return static_cast<int>(std::floor(v / static_cast<float>(size_.step))); };
  const auto up = [&](float v) { return static_cast<int>(std::ceil(v / static_cast<float>(size_.step))); };
  const Rect rect{down(box.x0 - grow_x), down(box.y0 - grow_y), up(box.x1 + grow_x), up(box.y1 + grow_y)};
  const int longer = std::max(rect.x1 - rect.x0, rect.y1 - rect.y0);
  pixelate(rect, std::max(longer / kCellsPerBox, kLeastEdge_px));
}

void Preview::hide_around(const StreamFeature& feature) {
  const int x = feature.x / size_.step, y = feature.y / size_.step;
  pixelate({x - kAroundFeature_px, y - kAroundFeature_px, x + kAroundFeature_px, y + kAroundFeature_px},
           kLeastEdge_px);
}

void Preview::pixelate(const Rect& rect, int edge) {
  const Rect r{std::max(rect.x0, 0), std::max(rect.y0, 0), std::min(rect.x1, size_.width),
               std::min(rect.y1, size_.height)};
  for (int y0 = r.y0; y0 < r.y1; y0 += edge) {
    for (int x0 = r.x0; x0 < r.x1; x0 += edge) {
      const int x1 = std::min(x0 + edge, r.x1), y1 = std::min(y0 + edge, r.y1);
      int b = 0, g = 0, red = 0;
      for (int y = y0; y < y1; ++y) {
        for (int x = x0; x < x1; ++x) {
          const Bgr& p = view().at(x, y);
          b += p.b;
          g += p.g;
          red += p.r;
        }
      }
      const int count = (x1 - x0) * (y1 - y0);
      const Bgr mean{static_cast<std::uint8_t>(b / count), static_cast<std::uint8_t>(g / count),
                     static_cast<std::uint8_t>(red / count)};
      for (int y = y0; y < y1; ++y) std::fill_n(view().row(y) + x0, x1 - x0, mean);
    }
  }
}

}  // namespace stillmap::stream
