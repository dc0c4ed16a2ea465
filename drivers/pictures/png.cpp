// SPDX-License-Identifier: Apache-2.0
#include "drivers/pictures/png.h"

#include <spng.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "core/scratch.h"

namespace stillmap {

namespace {

// The decoder's state, zlib's window and two rows take about 60 KB; the rest is for text and colour profiles.
constexpr std::size_t kScratchBytes = std::size_t{2} << 20;
constexpr std::size_t kChunkBytes = std::size_t{512} << 10;

// libspng hands its allocator no context of the caller's, so the decoder at work on this thread says where.
thread_local Scratch* t_scratch = nullptr;

constexpr std::size_t kHeader = 64;  // keeps a block's size for realloc, and its alignment

void* take(std::size_t bytes) {
  if (bytes > kScratchBytes) return nullptr;
  void* block = t_scratch->take_front(kHeader + bytes);
  if (block == nullptr) return nullptr;
  std::memcpy(block, &bytes, sizeof bytes);
  return static_cast<std::byte*>(block) + kHeader;
}

void* take_again(void* old, std::size_t bytes) {
  void* fresh = take(bytes);
  if (fresh == nullptr || old == nullptr) return fresh;
  std::size_t old_bytes = 0;
  std::memcpy(&old_bytes, static_cast<std::byte*>(old) - kHeader, sizeof old_bytes);
  std::memcpy(fresh, old, std::min(bytes, old_bytes));
  return fresh;
}

void* take_zeroed(std::size_t count, std::size_t item_bytes) {
  if (item_bytes != 0 && count > kScratchBytes / item_bytes) return nullptr;
  void* block = take(count * item_bytes);
  if (block != nullptr) std::memset(block, 0, count * item_bytes);
  return block;
}

void give_back(void*) {}  // all at once, after the picture

/// libspng's context for one picture; its memory is the scratch's.
class Context {
 public:
  Context(Scratch& scratch, std::span<const std::byte> file) {
    scratch.clear_front();
    t_scratch = &scratch;
    spng_alloc alloc{take, take_again, take_zeroed, give_back};
    context_ = spng_ctx_new2(&alloc, 0);
    good_ = context_ != nullptr && spng_set_chunk_limits(context_, kChunkBytes, kChunkBytes) == 0 &&
            spng_set_png_buffer(context_, file.data(), file.size()) == 0 &&
            spng_get_ihdr(context_, &header_) == 0;
  }
  ~Context() {
    if (context_ != nullptr) spng_ctx_free(context_);
    t_scratch = nullptr;
  }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  bool good() const { return good_; }
  const spng_ihdr& header() const { return header_; }

  template <class T>
  DecodeStatus decode(const ImageView<T>& into, int format) {
    const std::size_t row_bytes = static_cast<std::size_t>(into.width) * sizeof(T);
    std::size_t size = 0;
    if (spng_decoded_image_size(context_, format, &size) != 0 ||
        size != row_bytes * static_cast<std::size_t>(into.height) ||
        spng_decode_image(context_, nullptr, 0, format, SPNG_DECODE_PROGRESSIVE) != 0) {
      return DecodeStatus::Corrupt;
    }
    int error = 0;
    while (error == 0) {
      spng_row_info row{};
      error = spng_get_row_info(context_, &row);
      if (error != 0) break;
      error = spng_decode_row(context_, into.row(static_cast<int>(row.row_num)), row_bytes);
    }
    // The checksum of the last piece of pixels is only looked at when the rest of the file is read.
    return error == SPNG_EOI && spng_decode_chunks(context_) == 0 ? DecodeStatus::Ok : DecodeStatus::Corrupt;
  }

 private:
  spng_ctx* context_ = nullptr;
  spng_ihdr header_{};
  bool good_ = false;
};

template <class T>
bool same_size(const spng_ihdr& header, const ImageView<T>& view) {
  return header.width == static_cast<std::uint32_t>(view.width) &&
         header.height == static_cast<std::uint32_t>(view.height);
}

}  // namespace

struct PngDecoder::Impl {
  Scratch scratch{kScratchBytes};
};

PngDecoder::PngDecoder() : impl_(std::make_unique<Impl>()) {}
PngDecoder::~PngDecoder() = default;

bool PngDecoder::is_png(std::span<const std::byte> file) {
  constexpr std::array<unsigned char, 8> kSignature{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  return file.size() >= kSignature.size() &&
         std::memcmp(file.data(), kSignature.data(), kSignature.size()) == 0;
}

DecodeStatus PngDecoder::decode_colour(std::span<const std::byte> file, ImageView<Bgr> into) {
  Context context(impl_->scratch, file);
  // 16 bits a channel is a depth picture listed as colour.
  if (!context.good() || context.header().bit_depth > 8) return DecodeStatus::Corrupt;
  if (!same_size(context.header(), into)) return DecodeStatus::WrongSize;
  const DecodeStatus status = context.decode(into, SPNG_FMT_RGB8);
  if (status != DecodeStatus::Ok) return status;
  for (int y = 0; y < into.height; ++y) {
    Bgr* row = into.row(y);
    for (int x = 0; x < into.width; ++x) std::swap(row[x].b, row[x].r);
  }
  return status;
}

DecodeStatus PngDecoder::decode_depth(std::span<const std::byte> file, ImageView<std::uint16_t> into) {
  Context context(impl_->scratch, file);
  if (!context.good() || context.header().bit_depth != 16 ||
      context.header().color_type != SPNG_COLOR_TYPE_GRAYSCALE) {
    return DecodeStatus::Corrupt;
  }
  if (!same_size(context.header(), into)) return DecodeStatus::WrongSize;
  return context.decode(into, SPNG_FMT_PNG);
}

struct PngEncoder::Impl {
  Impl(int width, int height)
      : max_width(width),
        max_height(height),
        row(static_cast<std::size_t>(width)),
        // Incompressible colour, with a filter byte a row and deflate's own headers.
        file(static_cast<std::size_t>(width + 1) * static_cast<std::size_t>(height) * 3 + (1 << 16)) {}

  template <class T, class GetRow>
  std::span<const std::byte> encode(const ImageView<const T>& picture, const spng_ihdr& header,
                                    GetRow get_row) {
    if (picture.width > max_width || picture.height > max_height) return {};
    scratch.clear_front();
    t_scratch = &scratch;
    filled = 0;
    spng_alloc alloc{take, take_again, take_zeroed, give_back};
    spng_ctx* context = spng_ctx_new2(&alloc, SPNG_CTX_ENCODER);
    bool good = context != nullptr;
    if (good) {
      spng_ihdr ihdr = header;
      ihdr.width = static_cast<std::uint32_t>(picture.width);
      ihdr.height = static_cast<std::uint32_t>(picture.height);
      good = spng_set_option(context, SPNG_IMG_COMPRESSION_LEVEL, 1) == 0 &&
             spng_set_option(context, SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB) == 0 &&
             spng_set_png_stream(context, append, this) == 0 && spng_set_ihdr(context, &ihdr) == 0 &&
             spng_encode_image(context, nullptr, 0, SPNG_FMT_PNG,
                               SPNG_ENCODE_PROGRESSIVE | SPNG_ENCODE_FINALIZE) == 0;
      int error = 0;
      for (int y = 0; good && y < picture.height; ++y) {
        const auto [pixels, bytes] = get_row(y);
        error = spng_encode_row(context, pixels, bytes);
        good = error == 0 || error == SPNG_EOI;
      }
      good = good && error == SPNG_EOI;
      spng_ctx_free(context);
    }
    t_scratch = nullptr;
    return good ? std::span<const std::byte>{file.data(), filled} : std::span<const std::byte>{};
  }

  static int append(spng_ctx*, void* user, void* from, std::size_t bytes) {
    auto* self = static_cast<Impl*>(user);
    if (bytes > self->file.size() - self->filled) return SPNG_IO_ERROR;
    std::memcpy(self->file.data() + self->filled, from, bytes);
    self->filled += bytes;
    return 0;
  }

  int max_width, max_height;
  Scratch scratch{kScratchBytes};
  std::vector<Bgr> row;  // in PNG's order
  std::vector<std::byte> file;
  std::size_t filled = 0;
};

PngEncoder::PngEncoder(int width, int height) : impl_(std::make_unique<Impl>(width, height)) {}
PngEncoder::~PngEncoder() = default;

std::span<const std::byte> PngEncoder::encode_colour(ImageView<const Bgr> picture) {
  spng_ihdr header{};
  header.bit_depth = 8;
  header.color_type = SPNG_COLOR_TYPE_TRUECOLOR;
  return impl_->encode(picture, header, [&](int y) {
    const Bgr* from = picture.row(y);
    for (int x = 0; x < picture.width; ++x)
      impl_->row[static_cast<std::size_t>(x)] = {from[x].r, from[x].g, from[x].b};
    return std::pair<const void*, std::size_t>(impl_->row.data(),
                                               static_cast<std::size_t>(picture.width) * sizeof(Bgr));
  });
}

std::span<const std::byte> PngEncoder::encode_depth(ImageView<const std::uint16_t> picture) {
  spng_ihdr header{};
  header.bit_depth = 16;
  header.color_type = SPNG_COLOR_TYPE_GRAYSCALE;
  return impl_->encode(picture, header, [&](int y) {
    return std::pair<const void*, std::size_t>(
        picture.row(y), static_cast<std::size_t>(picture.width) * sizeof(std::uint16_t));
  });
}

}  // namespace stillmap
