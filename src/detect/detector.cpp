// SPDX-License-Identifier: Apache-2.0
#include "detect/detector.h"

#include <array>
#include <exception>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "core/check.h"
#include "detect/class_kinds.h"
#include "detect/letterbox.h"
#include "detect/nanodet_decoder.h"

namespace stillmap {

namespace {

/// The network's normalisation, in the order blue, green, red.
constexpr std::array<float, 3> kMean{103.53f, 116.28f, 123.675f}, kDeviation{57.375f, 57.12f, 58.395f};
constexpr std::array<int, NanodetDecoder::kMaxHeads> kStrides{8, 16, 32, 64};

/// The output's plain name: OpenCV puts "onnx_node!" before a layer's, a quantized file "deq_".
std::string_view plain_name(std::string_view name) {
  for (const std::string_view prefix : {std::string_view("onnx_node!"), std::string_view("deq_")}) {
    if (name.starts_with(prefix)) name.remove_prefix(prefix.size());
  }
  return name;
}

std::string first_line(const char* text) {
  std::string line(text);
  return line.substr(0, line.find('\n'));
}

std::span<const float> values_of(const cv::Mat& output) {
  return {output.ptr<float>(), output.total()};
}

std::string shape_text(const cv::Mat& m) {
  std::string text = "[";
  for (int i = 0; i < m.dims; ++i) text += (i > 0 ? ", " : "") + std::to_string(m.size[i]);
  return text + "]";
}

}  // namespace

struct Detector::Impl {
  Impl(const Config& config, const std::string& model_path)
      : path(model_path),
        classes(static_cast<int>(config.classes.names.size())),
        letterbox(config.camera.width, config.camera.height, config.detector.input_width,
                  config.detector.input_height),
        decoder(class_kinds(config.classes), config.detector.score_threshold, config.detector.nms_iou),
        warnings(class_warning(config.classes)),
        input_size(config.detector.input_width, config.detector.input_height) {}

  Status load();
  Status check_outputs();
  void fill_input(ImageView<const Bgr> colour);
  void forward();
  Error refused(const std::string& why) const {
    return {ExitCode::UnreadableInput,
            "detector.model: '" + path + "' " + why +
                "; expected a NanoDet-Plus ONNX file such as scripts/get_model.sh fetches"};
  }

  std::string path;
  int classes;
  Letterbox letterbox;
  NanodetDecoder decoder;
  std::string warnings, description;
  cv::Size input_size;
  cv::dnn::Net net;
  cv::Mat resized, input;
  std::array<std::array<float, 256>, 3> normalised{};
  std::vector<cv::String> output_names;  // classes, then distances, of each stride
  std::vector<int> strides;
  std::vector<cv::Mat> outputs;
};

Status Detector::Impl::load() {
  cv::setNumThreads(1);
  // What goes wrong is said once, by us.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  if (input_size.width % 32 != 0 || input_size.height % 32 != 0) {
    return Error{ExitCode::WrongConfig,
                 "detector.input_width and detector.input_height: " + std::to_string(input_size.width) +
                     " x " + std::to_string(input_size.height) +
                     " px; expected multiples of 32 px, e.g. 320 x 256"};
  }
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t v = 0; v < 256; ++v)
      normalised[c][v] = (static_cast<float>(v) - kMean[c]) / kDeviation[c];
  }
  resized.create(letterbox.height, letterbox.width, CV_8UC3);
  const std::array<int, 4> shape{1, 3, input_size.height, input_size.width};
  input.create(4, shape.data(), CV_32F);
  for (int c = 0; c < 3; ++c) {  // the bars beside the picture are black and stay so
    cv::Mat(input_size, CV_32F, input.ptr<float>(0, c)).setTo(normalised[static_cast<std::size_t>(c)][0]);
  }
  try {
    net = cv::dnn::readNetFromONNX(path);
    net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    const std::vector<cv::String> names = net.getUnconnectedOutLayersNames();
    for (const int stride : kStrides) {
      const auto find = [&](const std::string& plain) {
        for (const cv::String& name : names) {
          if (plain_name(name) == plain) return name;
        }
        return cv::String();
      };
      const cv::String cls = find("cls_" + std::to_string(stride)),
                       reg = find("reg_" + std::to_string(stride));
      if (cls.empty() && reg.empty()) continue;
      if (cls.empty() || reg.empty())
        return refused("has only one of cls_ and reg_ for stride " + std::to_string(stride));
      strides.push_back(stride);
      output_names.insert(output_names.end(), {cls, reg});
    }
    if (strides.empty()) return refused("has no outputs cls_8, reg_8, cls_16, reg_16 ...");
    forward();
  } catch (const std::exception& e) {
    return refused("is no network that can be run (" + first_line(e.what()) + ")");
  }
  return check_outputs();
}

Status Detector::Impl::check_outputs() {
  for (std::size_t i = 0; i < strides.size(); ++i) {
    const cv::Mat &cls = outputs[2 * i], &reg = outputs[2 * i + 1];
    const int columns = (input_size.width + strides[i] - 1) / strides[i];
    const int rows = (input_size.height + strides[i] - 1) / strides[i];
    const auto fits = [&](const cv::Mat& m) {
      return m.dims == 4 && m.type() == CV_32F && m.isContinuous() && m.size[0] == 1 && m.size[2] == rows &&
             m.size[3] == columns;
    };
    if (!fits(cls) || !fits(reg) || reg.size[1] != 4 * NanodetDecoder::kBins) {
      return refused("has outputs of the wrong shape for stride " + std::to_string(strides[i]) + ": " +
                     shape_text(cls) + " and " + shape_text(reg) + " where [1, " + std::to_string(classes) +
                     ", " + std::to_string(rows) + ", " + std::to_string(columns) +
                     "] and 32 planes alike are due");
    }
    if (cls.size[1] != classes) {
      return Error{ExitCode::WrongConfig, "classes.names: " + std::to_string(classes) + " names, but '" +
                                              path + "' knows " + std::to_string(cls.size[1]) +
                                              " classes; add --config with the class file of this model"};
    }
  }
  return {};
}

void Detector::Impl::fill_input(ImageView<const Bgr> colour) {
  // OpenCV has no header over constant pixels; this one is only read.
  const cv::Mat picture(colour.height, colour.width, CV_8UC3, const_cast<Bgr*>(colour.data),
                        static_cast<std::size_t>(colour.stride) * sizeof(Bgr));
  cv::resize(picture, resized, resized.size(), 0, 0,
             letterbox.scale > 0.5 ? cv::INTER_LINEAR : cv::INTER_AREA);
  for (int c = 0; c < 3; ++c) {
    const std::array<float, 256>& table = normalised[static_cast<std::size_t>(c)];
    for (int y = 0; y < resized.rows; ++y) {
      const std::uint8_t* from = resized.ptr<std::uint8_t>(y) + c;
      float* to = input.ptr<float>(0, c) + (letterbox.y0 + y) * input_size.width + letterbox.x0;
      for (int x = 0; x < resized.cols; ++x) to[x] = table[from[3 * x]];
    }
  }
}

void Detector::Impl::forward() {
  net.setInput(input);
  net.forward(outputs, output_names);
}

Detector::Detector(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Detector::~Detector() = default;

Result<std::unique_ptr<Detector>> Detector::open(const Config& config, const std::string& model_path) {
  auto impl = std::make_unique<Impl>(config, model_path);
  if (Status loaded = impl->load(); !loaded.ok()) return loaded.error();
  impl->description = std::filesystem::path(model_path).filename().string() + ", " +
                      std::to_string(config.detector.input_width) + "x" +
                      std::to_string(config.detector.input_height) + ", " + std::to_string(impl->classes) +
                      " classes, OpenCV " + CV_VERSION;
  return std::unique_ptr<Detector>(new Detector(std::move(impl)));
}

bool Detector::run(const FrameSlot& frame, Detections& out) {
  STILLMAP_CHECK(frame.colour.width == impl_->letterbox.picture_width &&
                 frame.colour.height == impl_->letterbox.picture_height);
  out.sequence = frame.sequence;
  out.stamp_ns = frame.colour_ns;
  out.items.clear();
  try {
    impl_->fill_input(frame.colour);
    impl_->forward();
  } catch (const std::exception&) {
    return false;
  }
  std::array<NanodetDecoder::Head, NanodetDecoder::kMaxHeads> heads;
  const std::size_t count = impl_->strides.size();
  for (std::size_t i = 0; i < count; ++i) {
    const cv::Mat &cls = impl_->outputs[2 * i], &reg = impl_->outputs[2 * i + 1];
    heads[i] = {impl_->strides[i], cls.size[3], cls.size[2], values_of(cls), values_of(reg)};
  }
  impl_->decoder.decode(std::span(heads).first(count), impl_->letterbox, out.items);
  return true;
}

const std::string& Detector::describe() const {
  return impl_->description;
}
const std::string& Detector::class_warnings() const {
  return impl_->warnings;
}

}  // namespace stillmap
