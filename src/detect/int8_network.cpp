// SPDX-License-Identifier: Apache-2.0
#include "detect/int8_network.h"

#include <algorithm>

#include "core/check.h"

namespace stillmap {

Int8Network::Int8Network(const Letterbox& letterbox, const InputFormat& format)
    : letterbox_(letterbox),
      format_(format),
      scaler_(letterbox.picture_width, letterbox.picture_height, letterbox.width, letterbox.height),
      row_(static_cast<std::size_t>(letterbox.width)) {}

void Int8Network::lay_out() {
  // A piece of memory is taken from the step that writes it (the input: before all) to the last that reads
  // it.
  struct Piece {
    std::size_t value = 0, first = 0, last = 0, at = 0, bytes = 0;
  };
  std::vector<Piece> pieces;
  const std::size_t end = steps_.size() + 1;
  const auto use = [&](std::size_t value, std::size_t when) {
    for (Piece& piece : pieces) {
      if (piece.value == values_[value].storage) piece.last = when;
    }
  };
  const auto make = [&](std::size_t value, std::size_t when) {
    constexpr std::size_t kCacheLine = 64;
    const std::size_t bytes = (values_[value].shape.size() + kCacheLine - 1) / kCacheLine * kCacheLine;
    pieces.push_back({value, when, when, 0, bytes});
  };
  make(0, 0);
  for (std::size_t s = 0; s < steps_.size(); ++s) {
    make(steps_[s].output, s + 1);
    for (const std::size_t input : steps_[s].inputs) use(input, s + 1);
  }
  for (const Output& output : outputs_) use(output.value, end);
  std::size_t bytes = 0, scratch = 0;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    // The lowest place beside all that are needed at the same time.
    Piece& piece = pieces[i];
    for (bool moved = true; moved;) {
      moved = false;
      for (std::size_t k = 0; k < i; ++k) {
        const Piece& other = pieces[k];
        const bool together = other.first <= piece.last && piece.first <= other.last;
        if (!together || other.at >= piece.at + piece.bytes || piece.at >= other.at + other.bytes) continue;
        piece.at = other.at + other.bytes;
        moved = true;
      }
    }
    bytes = std::max(bytes, piece.at + piece.bytes);
  }
  place_.resize(values_.size());
  for (std::size_t v = 0; v < values_.size(); ++v) {
    for (const Piece& piece : pieces) {
      if (piece.value == values_[v].storage) place_[v] = piece.at + values_[v].offset;
    }
  }
  memory_.resize(bytes);
  for (const Step& step : steps_) {
    const auto* convolution = std::get_if<Int8Convolution>(&step.layer);
    const TensorShape& in = values_[step.inputs[0]].shape;
    if (convolution != nullptr) scratch = std::max(scratch, convolution->scratch_bytes(in.width, in.height));
  }
  scratch_.resize(scratch);
}

void Int8Network::fill_input(ImageView<const Bgr> colour) {
  const auto width = static_cast<std::size_t>(letterbox_.input_width);
  const std::size_t plane_size = values_[0].shape.plane();
  // The bars beside the picture; other tensors have used their place since the last run.
  for (std::size_t plane = 0; plane < 3; ++plane)
    std::fill_n(place(0) + plane * plane_size, plane_size,
                quantized_[plane][static_cast<std::size_t>(format_.pad)]);
  for (int y = 0; y < letterbox_.height; ++y) {
    scaler_.row(colour, y, row_);
    for (std::size_t plane = 0; plane < 3; ++plane) {
      const std::array<std::int8_t, 256>& table = quantized_[plane];
      constexpr std::array kChannels{&Bgr::b, &Bgr::g, &Bgr::r};
      const auto channel = kChannels[format_.channel_of(plane)];
      std::int8_t* to = place(0) + plane * plane_size + static_cast<std::size_t>(letterbox_.y0 + y) * width +
                        static_cast<std::size_t>(letterbox_.x0);
      for (std::size_t x = 0; x < row_.size(); ++x) to[x] = table[row_[x].*channel];
    }
  }
}

Status Int8Network::run(ImageView<const Bgr> colour) {
  STILLMAP_CHECK(colour.width == letterbox_.picture_width && colour.height == letterbox_.picture_height);
  fill_input(colour);
  for (Step& step : steps_) {
    const Value& from = values_[step.inputs[0]];
    const std::int8_t* in = place(step.inputs[0]);
    std::int8_t* out = place(step.output);
    if (const auto* convolution = std::get_if<Int8Convolution>(&step.layer)) {
      convolution->run(in, from.shape.width, from.shape.height, out, scratch_);
    } else if (const auto* pool = std::get_if<MaxPool>(&step.layer)) {
      pool->run(from.shape, in, out);
    } else if (std::holds_alternative<Doubling>(step.layer)) {
      Doubling::run(from.shape, in, out);
    } else if (const auto* sum = std::get_if<Sum>(&step.layer)) {
      sum->run(from.shape.size(), in, place(step.inputs[1]), out);
    } else {
      for (const std::size_t part : step.inputs)
        out = std::copy_n(place(part), values_[part].shape.size(), out);
    }
  }
  for (const std::size_t i : chosen_) {
    Output& output = outputs_[i];
    const std::int8_t* from = place(output.value);
    for (std::size_t k = 0; k < output.numbers.size(); ++k)
      output.numbers[k] = output.level[static_cast<std::size_t>(from[k] + 128)];
  }
  return {};
}

Tensor Int8Network::output(std::size_t i) const {
  const Output& output = outputs_[chosen_[i]];
  const TensorShape& shape = values_[output.value].shape;
  return {output.name, 4, {1, shape.channels, shape.height, shape.width}, output.numbers};
}

void Int8Network::choose_outputs(std::span<const std::size_t> chosen) {
  std::vector<std::size_t> of_outputs;
  for (const std::size_t i : chosen) of_outputs.push_back(chosen_[i]);
  chosen_ = std::move(of_outputs);
}

}  // namespace stillmap
