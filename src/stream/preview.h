// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/arena.h"
#include "core/config.h"
#include "core/detection.h"
#include "core/image.h"
#include "core/jpeg.h"
#include "stream/preview_size.h"
#include "stream/stream_types.h"

namespace stillmap::stream {

/// The camera's picture, small, with people made unrecognisable before anything is encoded. Stream thread; no
/// heap after construction.
class Preview {
 public:
  Preview(Arena& arena, const Config& config);

  /// Keeps a small copy of the picture, for encode(). Any thread, while no other uses this.
  void shrink(ImageView<const Bgr> colour);
  /// A foxglove.CompressedImage of the picture, once; returns its bytes, 0 when they do not fit into `out`.
  /// Unless `stream.preview` is full, these are pixelated: what the detector found on this very frame
  /// (`own`), what the tracker carried to it (`scene`, of the same frame), both grown by a margin, and the
  /// surroundings of every feature that moves.
  std::size_t encode(Nanoseconds stamp_ns, const Detections& own, const StreamScene& scene,
                     std::span<std::uint8_t> out);

  const PreviewSize& size() const { return size_; }

 private:
  struct Rect {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // pixels of the preview, right and bottom exclusive
  };
  bool hides(std::uint16_t class_id, ClassKind kind) const;
  void hide(const Box& box);
  void hide_around(const StreamFeature& feature);
  void pixelate(const Rect& rect, int edge);
  ImageView<Bgr> view() const { return {pixels_.data(), size_.width, size_.height, size_.width}; }

  PreviewSize size_;
  bool full_;
  std::size_t person_class_;  // its index; none: past the end
  std::span<Bgr> pixels_;
  std::span<std::uint8_t> jpeg_;
  std::optional<JpegEncoder> encoder_;  // not with an arena that only plans
};

}  // namespace stillmap::stream
