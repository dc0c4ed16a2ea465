// SPDX-License-Identifier: Apache-2.0
#include "detect/detector.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <span>
#include <utility>
#include <vector>

#include "core/check.h"
#include "detect/class_kinds.h"
#include "detect/letterbox.h"
#include "detect/nanodet_decoder.h"
#include "detect/network.h"

namespace stillmap {

namespace {

/// NanoDet-Plus's normalisation.
constexpr InputFormat kInput{{103.53f, 116.28f, 123.675f}, {57.375f, 57.12f, 58.395f}};
constexpr std::array<int, NanodetDecoder::kMaxHeads> kStrides{8, 16, 32, 64};

std::string shape_text(const Network::Output& output) {
  std::string text = "[";
  for (int i = 0; i < output.dimensions; ++i)
    text += (i > 0 ? ", " : "") + std::to_string(output.shape[static_cast<std::size_t>(i)]);
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
        network(letterbox, kInput) {}

  Status load();
  Status check_outputs();
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
  Network network;
  std::vector<int> strides;
};

Status Detector::Impl::load() {
  if (letterbox.input_width % 32 != 0 || letterbox.input_height % 32 != 0) {
    return Error{ExitCode::WrongConfig,
                 "detector.input_width and detector.input_height: " + std::to_string(letterbox.input_width) +
                     " x " + std::to_string(letterbox.input_height) +
                     " px; expected multiples of 32 px, e.g. 320 x 256"};
  }
  const auto unusable = [&](const Error& e) {
    return refused("is no network that can be run (" + e.message + ")");
  };
  if (const Status loaded = network.load(path); !loaded.ok()) return unusable(loaded.error());
  std::vector<std::string> outputs;  // classes, then distances, of each stride
  for (const int stride : kStrides) {
    const std::string cls = "cls_" + std::to_string(stride), reg = "reg_" + std::to_string(stride);
    const auto has = [&](const std::string& name) {
      return std::ranges::count(network.output_names(), name) > 0;
    };
    if (!has(cls) && !has(reg)) continue;
    if (!has(cls) || !has(reg))
      return refused("has only one of cls_ and reg_ for stride " + std::to_string(stride));
    strides.push_back(stride);
    outputs.insert(outputs.end(), {cls, reg});
  }
  if (strides.empty()) return refused("has no outputs cls_8, reg_8, cls_16, reg_16 ...");
  network.choose_outputs(outputs);
  std::vector<Bgr> blank(static_cast<std::size_t>(letterbox.picture_width) *
                         static_cast<std::size_t>(letterbox.picture_height));
  const Status run =
      network.run({blank.data(), letterbox.picture_width, letterbox.picture_height, letterbox.picture_width});
  if (!run.ok()) return unusable(run.error());
  return check_outputs();
}

Status Detector::Impl::check_outputs() {
  for (std::size_t i = 0; i < strides.size(); ++i) {
    const Network::Output cls = network.output(2 * i), reg = network.output(2 * i + 1);
    const int columns = (letterbox.input_width + strides[i] - 1) / strides[i];
    const int rows = (letterbox.input_height + strides[i] - 1) / strides[i];
    const auto fits = [&](const Network::Output& m) {
      return m.dimensions == 4 && m.shape[0] == 1 && m.shape[2] == rows && m.shape[3] == columns;
    };
    if (!fits(cls) || !fits(reg) || reg.shape[1] != 4 * NanodetDecoder::kBins) {
      return refused("has outputs of the wrong shape for stride " + std::to_string(strides[i]) + ": " +
                     shape_text(cls) + " and " + shape_text(reg) + " where [1, " + std::to_string(classes) +
                     ", " + std::to_string(rows) + ", " + std::to_string(columns) +
                     "] and 32 planes alike are due");
    }
    if (cls.shape[1] != classes) {
      return Error{ExitCode::WrongConfig, "classes.names: " + std::to_string(classes) + " names, but '" +
                                              path + "' knows " + std::to_string(cls.shape[1]) +
                                              " classes; add --config with the class file of this model"};
    }
  }
  return {};
}

Detector::Detector(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Detector::~Detector() = default;

Result<std::unique_ptr<Detector>> Detector::open(const Config& config, const std::string& model_path) {
  auto impl = std::make_unique<Impl>(config, model_path);
  if (Status loaded = impl->load(); !loaded.ok()) return loaded.error();
  impl->description = std::filesystem::path(model_path).filename().string() + ", " +
                      std::to_string(config.detector.input_width) + "x" +
                      std::to_string(config.detector.input_height) + ", " + std::to_string(impl->classes) +
                      " classes, " + impl->network.library();
  return std::unique_ptr<Detector>(new Detector(std::move(impl)));
}

bool Detector::run(const FrameSlot& frame, Detections& out) {
  out.sequence = frame.sequence;
  out.stamp_ns = frame.colour_ns;
  out.items.clear();
  if (!impl_->network.run(frame.colour).ok()) return false;
  std::array<NanodetDecoder::Head, NanodetDecoder::kMaxHeads> heads;
  const std::size_t count = impl_->strides.size();
  for (std::size_t i = 0; i < count; ++i) {
    const Network::Output cls = impl_->network.output(2 * i), reg = impl_->network.output(2 * i + 1);
    heads[i] = {impl_->strides[i], cls.shape[3], cls.shape[2], cls.values, reg.values};
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
