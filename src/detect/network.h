// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

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

  /// The channel of Bgr that plane `plane` shows.
  std::size_t channel_of(std::size_t plane) const { return red_first ? 2 - plane : plane; }
  float normalised(std::size_t channel, int grey_level) const {
    return (static_cast<float>(grey_level) - mean[channel]) / deviation[channel];
  }
};

/// An ONNX network at work. One thread at a time.
class Network {
 public:
  virtual ~Network() = default;

  /// Puts a picture of the letterbox's size (checked) through the network. Errors: what a library says.
  virtual Status run(ImageView<const Bgr> colour) = 0;
  /// All outputs of the file, in no order, or those of choose_outputs() in its order.
  virtual std::size_t output_count() const = 0;
  /// The i-th output of the last run.
  virtual Tensor output(std::size_t i) const = 0;
  /// From now on, run() gives these of the present outputs.
  virtual void choose_outputs(std::span<const std::size_t> chosen) = 0;
};

/// Opens the bytes of an ONNX file: on our own layers where these are all that it is made of, and with
/// OpenCV's module otherwise, which is loaded for that alone. Errors: what is in the way, in one line.
Result<std::unique_ptr<Network>> open_network(std::string_view onnx, const Letterbox& letterbox,
                                              const InputFormat& format);

/// The entry of libstillmap_network_opencv.so, which puts what open_network returns into `opened`. Program
/// and module come from one build.
constexpr const char* kNetworkModuleEntry = "stillmap_network_module";
using NetworkModuleEntry = void (*)(std::string_view onnx, const Letterbox& letterbox,
                                    const InputFormat& format, Result<std::unique_ptr<Network>>& opened);

}  // namespace stillmap
