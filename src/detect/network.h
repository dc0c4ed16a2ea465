// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/status.h"
#include "detect/letterbox.h"
#include "detect/tensor.h"

namespace stillmap {

/// What a network expects of its input's values, channel by channel.
struct InputFormat {
  std::array<float, 3> mean{}, deviation{1, 1, 1};  ///< grey levels, in the order blue, green, red
  bool red_first = false;                           ///< the order of the planes; else blue first
  int pad = 0;                                      ///< grey level of the bars beside the picture
};

/// An ONNX network that OpenCV's dnn loads and runs, its quantized convolutions on our own kernels. The one
/// place that knows OpenCV. One thread at a time. OpenCV takes heap memory for every run.
class Network {
 public:
  Network(const Letterbox& letterbox, const InputFormat& format);
  ~Network();

  /// Errors: what the library says, in one line.
  Status load(const std::string& path);
  /// Puts a picture of the letterbox's size (checked) through the network. Errors: what the library says.
  Status run(ImageView<const Bgr> colour);
  /// All outputs of the file, in no order, or those of choose_outputs() in its order.
  std::size_t output_count() const { return names_.size(); }
  /// The i-th output of the last run.
  Tensor output(std::size_t i) const;
  /// From now on, run() gives these of the present outputs.
  void choose_outputs(std::span<const std::size_t> chosen);
  /// The library's and the kernels' names, for people.
  static std::string library();

 private:
  void fill_input(ImageView<const Bgr> colour);

  struct Impl;
  std::unique_ptr<Impl> impl_;
  Letterbox letterbox_;
  std::array<std::array<float, 256>, 3> normalised_{};  // by plane and grey level
  std::array<int, 3> channel_of_plane_{};
  std::vector<std::string> names_;  // as the file has them, of the outputs
};

}  // namespace stillmap
