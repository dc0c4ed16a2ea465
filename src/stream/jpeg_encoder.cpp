// SPDX-License-Identifier: Apache-2.0
#include "stream/jpeg_encoder.h"

#include <csetjmp>
#include <cstdio>

// jpeglib.h uses names of stdio.h without including it, and jerror.h those of jpeglib.h.
// clang-format off
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

#include "core/check.h"

// libjpeg ends an error by a longjmp, which must not pass an object with a destructor: in this file the
// functions between setjmp and the library hold plain values only.

namespace stillmap::stream {
namespace {

/// The library's memory manager over one piece of the arena: what lives for one picture is taken from the
/// front and given back at once, what lives as long as the encoder from the back. Baseline encoding uses none
/// of the library's "virtual" arrays.
struct ArenaMemory : jpeg_memory_mgr {
  explicit ArenaMemory(std::span<std::byte> span);
  std::span<std::byte> memory;
  std::size_t front = 0, back;
};

void* take(j_common_ptr info, int pool, std::size_t bytes) {
  auto& memory = *static_cast<ArenaMemory*>(info->mem);
  const std::size_t rounded = (bytes + 63) / 64 * 64;  // what the library's vector code wants, twice
  if (rounded > memory.back - memory.front) ERREXIT1(info, JERR_OUT_OF_MEMORY, 0);
  if (pool == JPOOL_PERMANENT) return memory.memory.data() + (memory.back -= rounded);
  void* taken = memory.memory.data() + memory.front;
  memory.front += rounded;
  return taken;
}

/// Rows behind a table of their addresses.
template <class Row>
Row* take_rows(j_common_ptr info, int pool, std::size_t row_bytes, std::size_t rows) {
  const std::size_t stride = (row_bytes + 63) / 64 * 64;
  Row* table = static_cast<Row*>(take(info, pool, rows * sizeof(Row)));
  auto* first = static_cast<std::byte*>(take(info, pool, rows * stride));
  for (std::size_t i = 0; i < rows; ++i) table[i] = reinterpret_cast<Row>(first + i * stride);
  return table;
}

ArenaMemory::ArenaMemory(std::span<std::byte> span)
    : jpeg_memory_mgr{}, memory(span), back(span.size() / 64 * 64) {
  alloc_small = alloc_large = take;
  alloc_sarray = [](j_common_ptr info, int pool, JDIMENSION per_row, JDIMENSION rows) {
    return take_rows<JSAMPROW>(info, pool, per_row * sizeof(JSAMPLE), rows);
  };
  alloc_barray = [](j_common_ptr info, int pool, JDIMENSION per_row, JDIMENSION rows) {
    return take_rows<JBLOCKROW>(info, pool, per_row * sizeof(JBLOCK), rows);
  };
  realize_virt_arrays = [](j_common_ptr) {};
  free_pool = [](j_common_ptr info, int pool) {
    if (pool == JPOOL_IMAGE) static_cast<ArenaMemory*>(info->mem)->front = 0;
  };
  self_destruct = [](j_common_ptr) {};
}

struct ErrorManager : jpeg_error_mgr {
  std::jmp_buf jump;
};

[[noreturn]] void leave(j_common_ptr info) {
  std::longjmp(static_cast<ErrorManager*>(info->err)->jump, 1);
}

/// A destination that ends where the caller's buffer does.
void begin_output(j_compress_ptr) {}
void end_output(j_compress_ptr) {}
boolean output_is_full(j_compress_ptr info) {
  ERREXIT(info, JERR_BUFFER_SIZE);
  return FALSE;
}

/// Sample rows of one row of 16 x 16 units in all their forms, and the tables.
std::size_t memory_bytes(int width) {
  return static_cast<std::size_t>(width + 64) * 256 + (std::size_t{64} << 10);
}

}  // namespace

struct JpegEncoder::Impl {
  Impl(std::span<std::byte> span, int w, int h) : memory(span), width(w), height(h) {
    info.err = jpeg_std_error(&error);
    error.error_exit = leave;
    error.output_message = [](j_common_ptr) {};
    jpeg_create_compress(&info);
    own_memory = info.mem;
    info.mem = &memory;
    info.dest = &destination;
    destination.init_destination = begin_output;
    destination.empty_output_buffer = output_is_full;
    destination.term_destination = end_output;
    info.image_width = static_cast<JDIMENSION>(width);
    info.image_height = static_cast<JDIMENSION>(height);
    info.input_components = 3;
    info.in_color_space = JCS_EXT_BGR;
    jpeg_set_defaults(&info);
    info.dct_method = JDCT_IFAST;
  }
  ~Impl() {
    info.mem = own_memory;  // what creation took goes back to where it came from
    jpeg_destroy_compress(&info);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  ArenaMemory memory;
  int width, height;
  ErrorManager error{};
  jpeg_destination_mgr destination{};
  jpeg_compress_struct info{};
  jpeg_memory_mgr* own_memory = nullptr;
};

JpegEncoder::JpegEncoder(Arena& arena, int width, int height) {
  const std::span<std::byte> memory = arena.take<std::byte>("stream.jpeg", memory_bytes(width));
  if (!arena.planning()) impl_ = std::make_unique<Impl>(memory, width, height);
}
JpegEncoder::~JpegEncoder() = default;

std::size_t JpegEncoder::encode(ImageView<const Bgr> picture, int quality, std::span<std::uint8_t> out) {
  STILLMAP_CHECK(picture.width == impl_->width && picture.height == impl_->height);
  jpeg_compress_struct& info = impl_->info;
  if (setjmp(impl_->error.jump) != 0) {
    jpeg_abort_compress(&info);
    return 0;
  }
  impl_->destination.next_output_byte = out.data();
  impl_->destination.free_in_buffer = out.size();
  jpeg_set_quality(&info, quality, TRUE);
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    // The library only reads the row, though its type does not say so.
    auto* row =
        reinterpret_cast<JSAMPROW>(const_cast<Bgr*>(picture.row(static_cast<int>(info.next_scanline))));
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  return out.size() - impl_->destination.free_in_buffer;
}

}  // namespace stillmap::stream
