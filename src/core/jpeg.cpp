// SPDX-License-Identifier: Apache-2.0
#include "core/jpeg.h"

#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <utility>

// jpeglib.h uses names of stdio.h without including it, and jerror.h those of jpeglib.h.
// clang-format off
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

// libjpeg ends an error by a longjmp, which must not pass an object with a destructor: in this file the
// functions between setjmp and the library hold plain values only.

namespace stillmap {

namespace {

/// The library's memory manager over a Scratch, in place of the one that takes from the heap for each
/// picture.
struct ScratchMemory : jpeg_memory_mgr {
  explicit ScratchMemory(Scratch memory);
  Scratch scratch;
};

void* take(j_common_ptr info, int pool, std::size_t bytes) {
  Scratch& scratch = static_cast<ScratchMemory*>(info->mem)->scratch;
  void* memory = pool == JPOOL_PERMANENT ? scratch.take_back(bytes) : scratch.take_front(bytes);
  if (memory == nullptr) ERREXIT1(info, JERR_OUT_OF_MEMORY, 0);
  return memory;
}

/// Rows of `row_bytes`, each on its own cache line, behind a table of their addresses.
template <class Row>
Row* take_rows(j_common_ptr info, int pool, std::size_t row_bytes, std::size_t rows) {
  const std::size_t stride = (row_bytes + 63) / 64 * 64;
  Row* table = static_cast<Row*>(take(info, pool, rows * sizeof(Row)));
  std::byte* pixels = static_cast<std::byte*>(take(info, pool, rows * stride));
  for (std::size_t i = 0; i < rows; ++i) table[i] = reinterpret_cast<Row>(pixels + i * stride);
  return table;
}

JSAMPARRAY take_samples(j_common_ptr info, int pool, JDIMENSION per_row, JDIMENSION rows) {
  return take_rows<JSAMPROW>(info, pool, per_row * sizeof(JSAMPLE), rows);
}

JBLOCKARRAY take_blocks(j_common_ptr info, int pool, JDIMENSION per_row, JDIMENSION rows) {
  return take_rows<JBLOCKROW>(info, pool, per_row * sizeof(JBLOCK), rows);
}

// A "virtual" array of the library is simply all there. Decoding uses such arrays for the coefficients of
// progressive pictures (blocks); those of samples serve colour quantisation, which is never asked for.
jvirt_barray_ptr request_blocks(j_common_ptr info, int pool, boolean /*pre_zero*/, JDIMENSION per_row,
                                JDIMENSION rows, JDIMENSION /*max_access*/) {
  const JBLOCKARRAY blocks = take_blocks(info, pool, per_row, rows);
  for (JDIMENSION i = 0; i < rows; ++i) std::memset(blocks[i], 0, per_row * sizeof(JBLOCK));
  return reinterpret_cast<jvirt_barray_ptr>(blocks);
}

JBLOCKARRAY access_blocks(j_common_ptr, jvirt_barray_ptr blocks, JDIMENSION first_row, JDIMENSION, boolean) {
  return reinterpret_cast<JBLOCKARRAY>(blocks) + first_row;
}

jvirt_sarray_ptr request_samples(j_common_ptr info, int, boolean, JDIMENSION, JDIMENSION, JDIMENSION) {
  ERREXIT(info, JERR_NOT_COMPILED);
  return nullptr;
}

JSAMPARRAY access_samples(j_common_ptr info, jvirt_sarray_ptr, JDIMENSION, JDIMENSION, boolean) {
  ERREXIT(info, JERR_NOT_COMPILED);
  return nullptr;
}

void free_pool(j_common_ptr info, int pool) {
  if (pool == JPOOL_IMAGE) static_cast<ScratchMemory*>(info->mem)->scratch.clear_front();
}

ScratchMemory::ScratchMemory(Scratch memory) : jpeg_memory_mgr{}, scratch(std::move(memory)) {
  alloc_small = take;
  alloc_large = take;
  alloc_sarray = take_samples;
  alloc_barray = take_blocks;
  request_virt_sarray = request_samples;
  request_virt_barray = request_blocks;
  realize_virt_arrays = [](j_common_ptr) {};
  access_virt_sarray = access_samples;
  access_virt_barray = access_blocks;
  jpeg_memory_mgr::free_pool = stillmap::free_pool;
  self_destruct = [](j_common_ptr) {};
}

struct ErrorManager : jpeg_error_mgr {
  std::jmp_buf jump;
  /// Errors jump, and nothing is printed.
  jpeg_error_mgr* quiet();
};

[[noreturn]] void leave(j_common_ptr info) {
  std::longjmp(static_cast<ErrorManager*>(info->err)->jump, 1);
}

jpeg_error_mgr* ErrorManager::quiet() {
  jpeg_std_error(this);
  error_exit = leave;
  output_message = [](j_common_ptr) {};
  return this;
}

/// Coefficients of three full planes (a progressive picture), padded to whole 16-pixel units, and the tables.
std::size_t decoding_bytes(int width, int height) {
  const auto padded = [](int v) { return static_cast<std::size_t>(v + 31) / 16 * 16; };
  return padded(width) * padded(height) * 3 * sizeof(JCOEF) + (std::size_t{1} << 20);
}

DecodeStatus decode(jpeg_decompress_struct& info, std::span<const std::byte> file,
                    const ImageView<Bgr>& into) {
  jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(file.data()), file.size());
  jpeg_read_header(&info, TRUE);
  if (info.image_width != static_cast<JDIMENSION>(into.width) ||
      info.image_height != static_cast<JDIMENSION>(into.height)) {
    return DecodeStatus::WrongSize;
  }
  info.out_color_space = JCS_EXT_BGR;
  jpeg_start_decompress(&info);
  while (info.output_scanline < info.output_height) {
    JSAMPROW row = reinterpret_cast<JSAMPROW>(into.row(static_cast<int>(info.output_scanline)));
    jpeg_read_scanlines(&info, &row, 1);
  }
  jpeg_finish_decompress(&info);
  // The library patches what is damaged or cut short with grey and a warning; that is no picture to navigate
  // by.
  return info.err->num_warnings == 0 ? DecodeStatus::Ok : DecodeStatus::Corrupt;
}

}  // namespace

struct JpegDecoder::Impl {
  Impl(int width, int height, Source source) : memory(Scratch(decoding_bytes(width, height))) {
    info.err = error.quiet();
    error.emit_message = [](j_common_ptr i, int level) { i->err->num_warnings += level < 0 ? 1 : 0; };
    if (source == Source::Camera) {
      error.emit_message = [](j_common_ptr i, int level) {
        i->err->num_warnings += level < 0 && i->err->msg_code != JWRN_EXTRANEOUS_DATA ? 1 : 0;
      };
    }
    jpeg_create_decompress(&info);
    own_memory = info.mem;
    info.mem = &memory;
  }
  ~Impl() {
    info.mem = own_memory;  // what creation took goes back to where it came from
    jpeg_destroy_decompress(&info);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  ScratchMemory memory;
  ErrorManager error{};
  jpeg_decompress_struct info{};
  jpeg_memory_mgr* own_memory = nullptr;
};

JpegDecoder::JpegDecoder(int width, int height, Source source)
    : impl_(std::make_unique<Impl>(width, height, source)) {}
JpegDecoder::~JpegDecoder() = default;

DecodeStatus JpegDecoder::decode_colour(std::span<const std::byte> file, ImageView<Bgr> into) {
  if (setjmp(impl_->error.jump) != 0) {
    jpeg_abort_decompress(&impl_->info);
    return DecodeStatus::Corrupt;
  }
  const DecodeStatus status = decode(impl_->info, file, into);
  if (status != DecodeStatus::Ok) jpeg_abort_decompress(&impl_->info);
  return status;
}

/// Sample rows of one row of 16 x 16 units in all their forms, and the tables.
std::size_t JpegEncoder::memory_bytes(int width) {
  return static_cast<std::size_t>(width + 64) * 256 + (std::size_t{64} << 10);
}

struct JpegEncoder::Impl {
  Impl(Scratch scratch, int width, int height) : memory(std::move(scratch)) {
    info.err = error.quiet();
    jpeg_create_compress(&info);
    own_memory = info.mem;
    info.mem = &memory;
    info.image_width = static_cast<JDIMENSION>(width);
    info.image_height = static_cast<JDIMENSION>(height);
    info.input_components = 3;
    info.in_color_space = JCS_EXT_BGR;
    jpeg_set_defaults(&info);
    destination.init_destination = [](j_compress_ptr) {};
    destination.empty_output_buffer = [](j_compress_ptr i) -> boolean {
      ERREXIT(i, JERR_BUFFER_SIZE);
      return FALSE;
    };
    destination.term_destination = [](j_compress_ptr) {};
    info.dest = &destination;
  }
  ~Impl() {
    info.mem = own_memory;
    jpeg_destroy_compress(&info);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  ScratchMemory memory;
  ErrorManager error{};
  jpeg_compress_struct info{};
  jpeg_destination_mgr destination{};
  jpeg_memory_mgr* own_memory = nullptr;
};

JpegEncoder::JpegEncoder(Scratch memory, int width, int height)
    : impl_(std::make_unique<Impl>(std::move(memory), width, height)) {}
JpegEncoder::~JpegEncoder() = default;

std::size_t JpegEncoder::encode(ImageView<const Bgr> picture, int quality, std::span<std::byte> out) {
  jpeg_compress_struct& info = impl_->info;
  if (picture.width != static_cast<int>(info.image_width) ||
      picture.height != static_cast<int>(info.image_height)) {
    return 0;
  }
  if (setjmp(impl_->error.jump) != 0) {
    jpeg_abort_compress(&info);
    return 0;
  }
  impl_->destination.next_output_byte = reinterpret_cast<JOCTET*>(out.data());
  impl_->destination.free_in_buffer = out.size();
  jpeg_set_quality(&info, quality, TRUE);
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    // The library only reads; its interface is older than const.
    auto* row =
        reinterpret_cast<JSAMPROW>(const_cast<Bgr*>(picture.row(static_cast<int>(info.next_scanline))));
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  return out.size() - impl_->destination.free_in_buffer;
}

}  // namespace stillmap
