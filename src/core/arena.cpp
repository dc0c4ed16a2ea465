// SPDX-License-Identifier: Apache-2.0
#include "core/arena.h"

#include <sys/mman.h>

#include <new>

namespace stillmap {

Arena::Arena(std::size_t bytes) : capacity_(bytes) {
  void* memory =
      mmap(nullptr, bytes == 0 ? 1 : bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) throw std::bad_alloc();
  memory_ = static_cast<std::byte*>(memory);
}

Arena::~Arena() {
  if (memory_ != nullptr) munmap(memory_, capacity_ == 0 ? 1 : capacity_);
}

void* Arena::take_bytes(const char* name, std::size_t count, std::size_t item_bytes) {
  const std::size_t bytes = (count * item_bytes + kAlignment - 1) / kAlignment * kAlignment;
  STILLMAP_CHECK(lines_.try_push_back({name, count, item_bytes}));
  const std::size_t offset = used_;
  used_ += bytes;
  if (planning()) return nullptr;
  STILLMAP_CHECK(used_ <= capacity_);
  return memory_ + offset;
}

}  // namespace stillmap
