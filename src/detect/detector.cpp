// SPDX-License-Identifier: Apache-2.0
#include "detect/detector.h"

#include <filesystem>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "detect/box_selection.h"
#include "detect/class_kinds.h"
#include "detect/decoder.h"
#include "detect/letterbox.h"
#include "detect/network.h"

namespace stillmap {

namespace {

InputFormat format_of(const Config::Detector& detector) {
  InputFormat format;
  for (std::size_t i = 0; i < 3; ++i) {
    format.mean[i] = static_cast<float>(detector.mean[i]);
    format.deviation[i] = static_cast<float>(detector.deviation[i]);
  }
  format.red_first = detector.colour_order == "rgb";
  format.pad = detector.pad;
  return format;
}

DecoderSetup setup_of(const Config& config) {
  return {static_cast<int>(config.classes.names.size()), config.detector.input_width,
          config.detector.input_height, config.detector.strides, config.detector.score_threshold};
}

}  // namespace

struct Detector::Impl {
  Impl(const Config& config, const std::string& model_path)
      : path(model_path),
        decoder_name(config.detector.decoder),
        classes(static_cast<int>(config.classes.names.size())),
        letterbox(config.camera.width, config.camera.height, config.detector.input_width,
                  config.detector.input_height),
        decoder(make_decoder(decoder_name, setup_of(config))),
        boxes(letterbox, class_kinds(config.classes), config.detector.nms_iou),
        warnings(class_warning(config.classes)),
        format(format_of(config.detector)) {}

  Status load(std::string_view onnx);
  std::span<const Tensor> outputs();
  std::string size_text() const {
    return std::to_string(letterbox.input_width) + "x" + std::to_string(letterbox.input_height);
  }
  Error refused(const std::string& why) const {
    return {ExitCode::UnreadableInput,
            "detector.model: '" + path + "' " + why + "; expected a network of detector.decoder = \"" +
                decoder_name + "\" for detector.input_width x input_height = " + size_text() +
                " px: say in '" + std::filesystem::path(path).replace_extension(".toml").string() +
                "' what it is (docs/detector.md), or get the default with scripts/get_model.sh"};
  }

  std::string path, decoder_name;
  int classes;
  Letterbox letterbox;
  std::unique_ptr<Decoder> decoder;
  BoxSelection boxes;
  std::string warnings;
  InputFormat format;
  std::unique_ptr<Network> network;
  std::vector<Tensor> tensors;
};

std::span<const Tensor> Detector::Impl::outputs() {
  tensors.resize(network->output_count());
  for (std::size_t i = 0; i < tensors.size(); ++i) tensors[i] = network->output(i);
  return tensors;
}

Status Detector::Impl::load(std::string_view onnx) {
  const auto unusable = [&](const Error& e) {
    if (e.exit_code == ExitCode::RunFailed)
      return Error{e.exit_code, "detector.model: '" + path + "': " + e.message +
                                    "; run with detector.model = \"none\", or give the process more"};
    return refused("is no network that can be run (" + e.message + ")");
  };
  Result<std::unique_ptr<Network>> opened = open_network(onnx, letterbox, format);
  if (!opened.ok()) return unusable(opened.error());
  network = std::move(opened.value());
  const std::vector<Bgr> blank(static_cast<std::size_t>(letterbox.picture_width) *
                               static_cast<std::size_t>(letterbox.picture_height));
  const Status run = network->run(
      {blank.data(), letterbox.picture_width, letterbox.picture_height, letterbox.picture_width});
  if (!run.ok()) return unusable(run.error());
  const Decoder::Choice choice = decoder->choose(outputs());
  if (!choice.refusal.empty()) return refused(choice.refusal);
  if (choice.classes != classes) {
    return Error{
        ExitCode::WrongConfig,
        "classes.names: " + std::to_string(classes) + " names, but '" + path + "' knows " +
            std::to_string(choice.classes) +
            " classes; name them in its manifest, or add --config with the class file of this model"};
  }
  network->choose_outputs(choice.outputs);
  return {};
}

Detector::Detector(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Detector::~Detector() = default;

Result<std::unique_ptr<Detector>> Detector::open(const Config& config, const ModelFile& model) {
  auto impl = std::make_unique<Impl>(config, model.path);
  if (Status loaded = impl->load(model.bytes); !loaded.ok()) return loaded.error();
  return std::unique_ptr<Detector>(new Detector(std::move(impl)));
}

bool Detector::run(const FrameSlot& frame, Detections& out) {
  out.sequence = frame.sequence;
  out.stamp_ns = frame.colour_ns;
  out.items.clear();
  if (!impl_->network->run(frame.colour).ok()) return false;
  impl_->boxes.clear();
  impl_->decoder->decode(impl_->outputs(), impl_->boxes);
  impl_->boxes.select(out.items);
  return true;
}

const std::string& Detector::class_warnings() const {
  return impl_->warnings;
}

}  // namespace stillmap
