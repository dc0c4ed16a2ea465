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
  struct Output {
    int dimensions = 0;
    std::array<int, 4> shape{};     ///< the first `dimensions` count
    std::span<const float> values;  ///< valid until the next run
  };

  Network(const Letterbox& letterbox, const InputFormat& format);
  ~Network();

  /// Errors: what the library says, in one line.
  Status load(const std::string& path);
  /// The names of what the file puts out, without the prefixes of importer and quantizer, in no order.
  const std::vector<std::string>& output_names() const { return names_; }
  /// Names what run() shall give: some of output_names().
  void choose_outputs(std::span<const std::string> names);
  /// Puts a picture of the letterbox's size (checked) through the network. Errors: what the library says.
  Status run(ImageView<const Bgr> colour);
  /// The i-th chosen output of the last run; without dimensions where it has more than four or is
  /// not made of floats.
  Output output(std::size_t i) const;
  /// The library's and the kernels' names, for people.
  static std::string library();

 private:
  void fill_input(ImageView<const Bgr> colour);

  struct Impl;
  std::unique_ptr<Impl> impl_;
  Letterbox letterbox_;
  std::array<std::array<float, 256>, 3> normalised_{};  // by plane and grey level
  std::array<int, 3> channel_of_plane_{};
  std::vector<std::string> names_;
};

}  // namespace stillmap
