// SPDX-License-Identifier: Apache-2.0
#include "detect/network.h"

#include <algorithm>
#include <exception>
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
    for (int n = 0; n < in.size[0]; ++n)
      ours_.run(in.ptr<std::int8_t>(n), in.size[3], in.size[2], out.ptr<std::int8_t>(n));
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
  const std::string text(e.what());
  return {ExitCode::UnreadableInput, text.substr(0, text.find('\n'))};
}

}  // namespace

struct Network::Impl {
  cv::dnn::Net net;
  cv::Mat resized, input;
  std::vector<cv::Mat> outputs;
};

Network::Network(const Letterbox& letterbox, const InputFormat& format)
    : impl_(std::make_unique<Impl>()), letterbox_(letterbox) {
  channel_of_plane_ = format.red_first ? std::array<int, 3>{2, 1, 0} : std::array<int, 3>{0, 1, 2};
  impl_->resized.create(letterbox.height, letterbox.width, CV_8UC3);
  const std::array<int, 4> shape{1, 3, letterbox.input_height, letterbox.input_width};
  impl_->input.create(4, shape.data(), CV_32F);
  for (std::size_t plane = 0; plane < 3; ++plane) {
    const auto channel = static_cast<std::size_t>(channel_of_plane_[plane]);
    for (std::size_t v = 0; v < 256; ++v)
      normalised_[plane][v] = (static_cast<float>(v) - format.mean[channel]) / format.deviation[channel];
    // The bars beside the picture are filled once and stay.
    const auto count =
        static_cast<std::size_t>(letterbox.input_width) * static_cast<std::size_t>(letterbox.input_height);
    std::fill_n(impl_->input.ptr<float>(0, static_cast<int>(plane)), count,
                normalised_[plane][static_cast<std::size_t>(format.pad)]);
  }
}

Network::~Network() = default;

Status Network::load(const std::string& path) {
  cv::setNumThreads(1);
  // What goes wrong is said once, by us.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  [[maybe_unused]] static const bool registered = [] {
    cv::dnn::LayerFactory::registerLayer("ConvolutionInt8", ConvolutionLayer::create);
    return true;
  }();
  try {
    impl_->net = cv::dnn::readNetFromONNX(path);
    impl_->net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    impl_->net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    names_ = impl_->net.getUnconnectedOutLayersNames();
  } catch (const std::exception& e) {
    return failed(e);
  }
  return {};
}

void Network::choose_outputs(std::span<const std::size_t> chosen) {
  std::vector<std::string> names;
  for (const std::size_t i : chosen) names.push_back(names_[i]);
  names_ = std::move(names);
}

void Network::fill_input(ImageView<const Bgr> colour) {
  cv::Mat& resized = impl_->resized;
  // OpenCV has no header over constant pixels; this one is only read.
  const cv::Mat picture(colour.height, colour.width, CV_8UC3, const_cast<Bgr*>(colour.data),
                        static_cast<std::size_t>(colour.stride) * sizeof(Bgr));
  cv::resize(picture, resized, resized.size(), 0, 0,
             letterbox_.scale > 0.5 ? cv::INTER_LINEAR : cv::INTER_AREA);
  for (int plane = 0; plane < 3; ++plane) {
    const std::array<float, 256>& table = normalised_[static_cast<std::size_t>(plane)];
    const int channel = channel_of_plane_[static_cast<std::size_t>(plane)];
    for (int y = 0; y < resized.rows; ++y) {
      const std::uint8_t* from = resized.ptr<std::uint8_t>(y) + channel;
      float* to =
          impl_->input.ptr<float>(0, plane) + (letterbox_.y0 + y) * letterbox_.input_width + letterbox_.x0;
      for (int x = 0; x < resized.cols; ++x) to[x] = table[from[3 * x]];
    }
  }
}

Status Network::run(ImageView<const Bgr> colour) {
  STILLMAP_CHECK(colour.width == letterbox_.picture_width && colour.height == letterbox_.picture_height);
  try {
    fill_input(colour);
    impl_->net.setInput(impl_->input);
    impl_->net.forward(impl_->outputs, names_);
  } catch (const std::exception& e) {
    return failed(e);
  }
  return {};
}

Tensor Network::output(std::size_t i) const {
  const cv::Mat& m = impl_->outputs[i];
  Tensor tensor;
  tensor.name = plain_name(names_[i]);
  if (m.type() != CV_32F || !m.isContinuous() || m.dims > static_cast<int>(tensor.shape.size()))
    return tensor;
  tensor.dimensions = m.dims;
  std::copy_n(m.size.p, m.dims, tensor.shape.begin());
  tensor.values = {m.ptr<float>(), m.total()};
  return tensor;
}

std::string Network::library() {
  return std::string("OpenCV ") + CV_VERSION + " with " + int8_kernels().front()->name + " kernels";
}

}  // namespace stillmap
