// SPDX-License-Identifier: Apache-2.0
// OpenCV's network as a module of its own, libstillmap_network_opencv.so, so that whoever runs quantized
// networks on our own layers has neither OpenCV nor what comes with it in memory.
#include <algorithm>
#include <exception>
#include <new>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/dnn/all_layers.hpp>
#include <opencv2/dnn/layer.details.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "core/check.h"
#include "detect/int8_convolution.h"
#include "detect/network.h"

namespace stillmap {

namespace {

/// Takes the place of OpenCV's quantized convolution wherever Int8Convolution can do what it does.
class ConvolutionLayer : public cv::dnn::Layer {
 public:
  static cv::Ptr<cv::dnn::Layer> create(cv::dnn::LayerParams& params) {
    const auto theirs =
        cv::dnn::ConvolutionLayerInt8::create(params).dynamicCast<cv::dnn::ConvolutionLayerInt8>();
    const std::optional<Int8Convolution::Shape> shape = shape_of(*theirs, params.get<int>("group", 1));
    if (!shape) return theirs;
    return cv::makePtr<ConvolutionLayer>(params, theirs, *shape);
  }

  ConvolutionLayer(const cv::dnn::LayerParams& params, const cv::Ptr<cv::dnn::ConvolutionLayerInt8>& theirs,
                   const Int8Convolution::Shape& shape)
      : Layer(params),
        theirs_(theirs),
        ours_(*int8_kernels().front(), shape, span_of<std::int8_t>(blobs[0]), span_of<std::int32_t>(blobs[1]),
              span_of<float>(blobs[2]), theirs->input_zp, theirs->output_zp) {}

  bool getMemoryShapes(const std::vector<cv::dnn::MatShape>& inputs, int required,
                       std::vector<cv::dnn::MatShape>& outputs,
                       std::vector<cv::dnn::MatShape>& internals) const override {
    return theirs_->getMemoryShapes(inputs, required, outputs, internals);
  }

  bool setActivation(const cv::Ptr<cv::dnn::ActivationLayer>& layer) override {
    const auto activation = layer.dynamicCast<cv::dnn::ActivationLayerInt8>();
    if (activation.empty() || activation->blobs.empty() || activation->blobs[0].total() != 256) return false;
    ours_.set_lut(span_of<std::int8_t>(activation->blobs[0]));
    return true;
  }

  void forward(cv::InputArrayOfArrays inputs, cv::OutputArrayOfArrays outputs,
               cv::OutputArrayOfArrays) override {
    const cv::Mat in = inputs.getMat(0);
    cv::Mat out = outputs.getMat(0);
    CV_Assert(in.type() == CV_8S && out.type() == CV_8S && in.isContinuous() && out.isContinuous());
    static thread_local std::vector<std::byte> scratch;  // of all layers; it only grows
    scratch.resize(std::max(scratch.size(), ours_.scratch_bytes(in.size[3], in.size[2])));
    for (int n = 0; n < in.size[0]; ++n)
      ours_.run(in.ptr<std::int8_t>(n), in.size[3], in.size[2], out.ptr<std::int8_t>(n), scratch);
  }

 private:
  template <class T>
  static std::span<const T> span_of(const cv::Mat& blob) {
    CV_Assert(blob.isContinuous() && blob.elemSize() == sizeof(T));
    return {blob.ptr<T>(), blob.total()};
  }

  static std::optional<Int8Convolution::Shape> shape_of(const cv::dnn::ConvolutionLayerInt8& layer,
                                                        int groups) {
    const bool plain = layer.blobs.size() == 3 && layer.blobs[0].dims == 4 && layer.kernel_size.size() == 2 &&
                       layer.padMode.empty() && layer.strides[0] == layer.strides[1] &&
                       layer.dilations[0] == 1 && layer.dilations[1] == 1 &&
                       layer.pads_begin == layer.pads_end;
    if (!plain) return std::nullopt;
    const cv::MatSize& weights = layer.blobs[0].size;
    const Int8Convolution::Shape shape{weights[1] * groups,
                                       weights[0],
                                       weights[3],
                                       weights[2],
                                       static_cast<int>(layer.strides[0]),
                                       static_cast<int>(layer.pads_begin[1]),
                                       static_cast<int>(layer.pads_begin[0]),
                                       groups > 1};
    if ((groups > 1 && weights[1] != 1) || !Int8Convolution::can(shape)) return std::nullopt;
    return shape;
  }

  cv::Ptr<cv::dnn::ConvolutionLayerInt8> theirs_;
  Int8Convolution ours_;
};

/// A layer's plain name: OpenCV puts "onnx_node!" before it, a quantized file "deq_".
std::string_view plain_name(std::string_view name) {
  for (const std::string_view prefix : {std::string_view("onnx_node!"), std::string_view("deq_")}) {
    if (name.starts_with(prefix)) name.remove_prefix(prefix.size());
  }
  return name;
}

Error failed(const std::exception& e) {
  const auto* of_opencv = dynamic_cast<const cv::Exception*>(&e);
  if (dynamic_cast<const std::bad_alloc*>(&e) != nullptr ||
      (of_opencv != nullptr && of_opencv->code == cv::Error::StsNoMem))
    return {ExitCode::RunFailed, "out of memory"};
  const std::string text(e.what());
  return {ExitCode::UnreadableInput, text.substr(0, text.find('\n'))};
}

/// An ONNX network that OpenCV's dnn loads and runs, its quantized convolutions on our own kernels. OpenCV
/// takes heap memory for every run.
class OpencvNetwork final : public Network {
 public:
  OpencvNetwork(const Letterbox& letterbox, const InputFormat& format);

  /// Errors: what the library says, in one line.
  Status load(std::string_view onnx);
  Status run(ImageView<const Bgr> colour) override;
  std::size_t output_count() const override { return names_.size(); }
  Tensor output(std::size_t i) const override;
  void choose_outputs(std::span<const std::size_t> chosen) override;

 private:
  void fill_input(ImageView<const Bgr> colour);

  Letterbox letterbox_;
  InputFormat format_;
  std::array<std::array<float, 256>, 3> normalised_{};  // by plane and grey level
  std::vector<std::string> names_;                      // as the file has them, of the outputs
  cv::dnn::Net net_;
  cv::Mat resized_, input_;
  std::vector<cv::Mat> outputs_;
};

OpencvNetwork::OpencvNetwork(const Letterbox& letterbox, const InputFormat& format)
    : letterbox_(letterbox), format_(format) {
  resized_.create(letterbox.height, letterbox.width, CV_8UC3);
  const std::array<int, 4> shape{1, 3, letterbox.input_height, letterbox.input_width};
  input_.create(4, shape.data(), CV_32F);
  for (std::size_t plane = 0; plane < 3; ++plane) {
    for (std::size_t v = 0; v < 256; ++v)
      normalised_[plane][v] = format.normalised(format.channel_of(plane), static_cast<int>(v));
    // The bars beside the picture are filled once and stay.
    const auto count =
        static_cast<std::size_t>(letterbox.input_width) * static_cast<std::size_t>(letterbox.input_height);
    std::fill_n(input_.ptr<float>(0, static_cast<int>(plane)), count,
                normalised_[plane][static_cast<std::size_t>(format.pad)]);
  }
}

Status OpencvNetwork::load(std::string_view onnx) {
  cv::setNumThreads(1);
  // What goes wrong is said once, by us.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  [[maybe_unused]] static const bool registered = [] {
    cv::dnn::LayerFactory::registerLayer("ConvolutionInt8", ConvolutionLayer::create);
    return true;
  }();
  try {
    net_ = cv::dnn::readNetFromONNX(onnx.data(), onnx.size());
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    net_.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    names_ = net_.getUnconnectedOutLayersNames();
  } catch (const std::exception& e) {
    return failed(e);
  }
  return {};
}

void OpencvNetwork::choose_outputs(std::span<const std::size_t> chosen) {
  std::vector<std::string> names;
  for (const std::size_t i : chosen) names.push_back(names_[i]);
  names_ = std::move(names);
}

void OpencvNetwork::fill_input(ImageView<const Bgr> colour) {
  // OpenCV has no header over constant pixels; this one is only read.
  const cv::Mat picture(colour.height, colour.width, CV_8UC3, const_cast<Bgr*>(colour.data),
                        static_cast<std::size_t>(colour.stride) * sizeof(Bgr));
  cv::resize(picture, resized_, resized_.size(), 0, 0,
             letterbox_.scale > 0.5 ? cv::INTER_LINEAR : cv::INTER_AREA);
  for (int plane = 0; plane < 3; ++plane) {
    const std::array<float, 256>& table = normalised_[static_cast<std::size_t>(plane)];
    const auto channel = static_cast<int>(format_.channel_of(static_cast<std::size_t>(plane)));
    for (int y = 0; y < resized_.rows; ++y) {
      const std::uint8_t* from = resized_.ptr<std::uint8_t>(y) + channel;
      float* to = input_.ptr<float>(0, plane) + (letterbox_.y0 + y) * letterbox_.input_width + letterbox_.x0;
      for (int x = 0; x < resized_.cols; ++x) to[x] = table[from[3 * x]];
    }
  }
}

Status OpencvNetwork::run(ImageView<const Bgr> colour) {
  STILLMAP_CHECK(colour.width == letterbox_.picture_width && colour.height == letterbox_.picture_height);
  try {
    fill_input(colour);
    net_.setInput(input_);
    net_.forward(outputs_, names_);
  } catch (const std::exception& e) {
    return failed(e);
  }
  return {};
}

Tensor OpencvNetwork::output(std::size_t i) const {
  const cv::Mat& m = outputs_[i];
  Tensor tensor;
  tensor.name = plain_name(names_[i]);
  if (m.type() != CV_32F || !m.isContinuous() || m.dims > static_cast<int>(tensor.shape.size()))
    return tensor;
  tensor.dimensions = m.dims;
  std::copy_n(m.size.p, m.dims, tensor.shape.begin());
  tensor.values = {m.ptr<float>(), m.total()};
  return tensor;
}

}  // namespace

}  // namespace stillmap

extern "C" [[gnu::visibility("default")]] void stillmap_network_module(
    std::string_view onnx, const stillmap::Letterbox& letterbox, const stillmap::InputFormat& format,
    stillmap::Result<std::unique_ptr<stillmap::Network>>& opened) {
  auto network = std::make_unique<stillmap::OpencvNetwork>(letterbox, format);
  if (const stillmap::Status s = network->load(onnx); !s.ok()) {
    opened = s.error();
  } else {
    opened = std::unique_ptr<stillmap::Network>(std::move(network));
  }
}
