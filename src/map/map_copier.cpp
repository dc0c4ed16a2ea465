// SPDX-License-Identifier: Apache-2.0
#include "map/map_copier.h"

#include <algorithm>

namespace stillmap {

void MapCopier::serve(const BlockTable& table) {
  CopyPass::serve([&](bool first, std::span<CopiedBlock> copies) -> Filled {
    if (first) next_block_ = 0;
    std::size_t copied = 0;
    for (; copied < copies.size() && next_block_ < table.size(); ++next_block_) {
      if (!table.found(next_block_)) continue;
      copies[copied].block = table.block(next_block_);
      std::ranges::copy(table.voxels(next_block_), copies[copied].voxels.begin());
      ++copied;
    }
    return {copied, next_block_ >= table.size()};
  });
}

}  // namespace stillmap
