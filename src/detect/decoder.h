// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/config.h"
#include "detect/box_selection.h"
#include "detect/cell_view.h"
#include "detect/tensor.h"

namespace stillmap {

/// What a family of networks means by its outputs. One thread at a time; no heap memory after choose().
class Decoder {
 public:
  /// What choose() found: the outputs that decode() shall get, or why there are none.
  struct Choice {
    std::vector<std::size_t> outputs{};  ///< indices, in decode()'s order
    int classes = 0;                     ///< that the network knows
    std::string refusal{};               ///< empty, or what the outputs lack
  };

  virtual ~Decoder() = default;
  /// Looks at the outputs of a first run.
  virtual Choice choose(std::span<const Tensor> outputs) = 0;
  /// Gives every cell above the score threshold to `boxes`. The tensors have the shapes that choose() saw.
  virtual void decode(std::span<const Tensor> chosen, BoxSelection& boxes) const = 0;
};

/// What every decoder is made of.
struct DecoderSetup {
  int classes = 0;
  int input_width = 0, input_height = 0;  ///< px
  std::vector<int> strides;               ///< px; empty: not said
  double score_threshold = 0;
};

/// The decoder that `detector.decoder` names, one of those that the configuration allows (checked).
std::unique_ptr<Decoder> make_decoder(const std::string& name, const DecoderSetup& setup);

/// Cells of the grid of one stride.
struct Grid {
  int stride_px = 0;
  std::size_t columns = 0, rows = 0;
  std::size_t cells() const { return columns * rows; }
  std::size_t column(std::size_t cell) const { return cell % columns; }
  std::size_t row(std::size_t cell) const { return cell / columns; }
};
Grid grid_of(const DecoderSetup& setup, int stride_px);
/// Cells of all strides.
std::size_t count_cells(const DecoderSetup& setup);

/// Chooses the one output [1, cells, channels], or [1, channels, cells], of networks that put everything into
/// one. `channels_beside_classes` of the channels are no class scores.
Decoder::Choice choose_flat(std::span<const Tensor> outputs, const DecoderSetup& setup, std::size_t cells,
                            std::size_t channels_beside_classes, bool cells_inside);
/// Such an output by its cells.
CellView flat_view(const Tensor& output, bool cells_inside);

/// "[1, 84, 8400]".
std::string shape_text(const Tensor& tensor);

}  // namespace stillmap
