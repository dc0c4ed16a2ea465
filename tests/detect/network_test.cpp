// SPDX-License-Identifier: Apache-2.0
#include "detect/network.h"

#include <dlfcn.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <opencv2/dnn.hpp>

#include "core/random.h"
#include "detect/int8_network.h"
#include "detect/model_file.h"
#include "tests/support/read_image.h"
#include "tests/support/shared_folder.h"

namespace stillmap {
namespace {

const InputFormat kFormat{{103.53f, 116.28f, 123.675f}, {57.375f, 57.12f, 58.395f}};

std::string real_model() {
  return read_model(test::shared_folder() / "models/nanodet_plus_m/nanodet_plus_m_int8.onnx").value().bytes;
}

/// The real network's outputs on our layers against those on OpenCV's. Both round alike but for ties, of
/// which the network has a handful.
TEST(Network, OnOurLayersAgreesWithOpenCv) {
  STILLMAP_NEEDS_SHARED();
  const std::string bytes = real_model();
  const test::Image<Bgr> colour =
      test::read_colour(test::shared_folder() / "data/fr1_rpy_walkers/rgb/1305031240.029620.jpg");
  cv::dnn::Net theirs =
      cv::dnn::readNetFromONNX(bytes.data(), bytes.size());  // before ours takes its layers' place

  // A picture of the input's shape, so that there are no bars beside it.
  const auto opened = open_network(bytes, Letterbox(640, 512, 320, 256), kFormat);
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  Network& ours = *opened.value();
  ASSERT_NE(dynamic_cast<const Int8Network*>(&ours), nullptr);
  test::Image<Bgr> tall(640, 512);
  std::copy(colour.pixels.begin(), colour.pixels.end(), tall.pixels.begin());
  const std::vector<std::string> names{"cls_8", "reg_8", "cls_64", "reg_64"};
  ASSERT_TRUE(ours.run(tall.view()).ok());
  std::vector<std::size_t> chosen;
  for (const std::string& name : names) {
    for (std::size_t i = 0; i < ours.output_count(); ++i) {
      if (ours.output(i).name == name) chosen.push_back(i);
    }
  }
  ASSERT_EQ(chosen.size(), names.size());
  ours.choose_outputs(chosen);
  ASSERT_TRUE(ours.run(tall.view()).ok());

  cv::Mat input(std::vector<int>{1, 3, 256, 320}, CV_32F);
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < 256; ++y) {
      for (int x = 0; x < 320; ++x) {
        const auto at = [&](int dx, int dy) {
          const Bgr& p = tall.view().at(2 * x + dx, 2 * y + dy);
          return c == 0 ? p.b : c == 1 ? p.g : p.r;
        };
        const int mean = (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) >> 2;
        const auto channel = static_cast<std::size_t>(c);
        input.ptr<float>(0, c, y)[x] =
            (static_cast<float>(mean) - kFormat.mean[channel]) / kFormat.deviation[channel];
      }
    }
  }
  theirs.setInput(input);
  std::vector<cv::String> full;
  for (const std::string& name : names) full.push_back("onnx_node!deq_" + name);
  std::vector<cv::Mat> expected;
  theirs.forward(expected, full);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const Tensor found = ours.output(i);
    ASSERT_EQ(found.values.size(), expected[i].total()) << names[i];
    double difference = 0, size = 0;
    for (std::size_t k = 0; k < found.values.size(); ++k) {
      difference += std::abs(found.values[k] - expected[i].ptr<float>()[k]);
      size += std::abs(expected[i].ptr<float>()[k]);
    }
    EXPECT_LT(difference, 0.15 * size) << names[i];
  }
}

std::unique_ptr<Network> on_opencv(std::string_view onnx, const Letterbox& letterbox) {
  void* module = dlopen("libstillmap_network_opencv.so", RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(module, nullptr) << dlerror();
  Result<std::unique_ptr<Network>> opened = Error{};
  reinterpret_cast<NetworkModuleEntry>(dlsym(module, kNetworkModuleEntry))(onnx, letterbox, kFormat, opened);
  EXPECT_TRUE(opened.ok());
  return std::move(opened.value());
}

/// Byte for byte, but for the last bit on 32-bit ARM, where OpenCV's arithmetic is another.
bool same(std::span<const float> ours, std::span<const float> theirs) {
#ifdef __arm__
  if (ours.size() != theirs.size()) return false;
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < theirs.size(); ++i) {
    difference += std::abs(ours[i] - theirs[i]);
    size += std::abs(theirs[i]);
  }
  return difference < 1e-6 * size;
#else
  return std::ranges::equal(ours, theirs);
#endif
}

/// With the same kernels, OpenCV's other layers and ours give the same bytes: whoever changes from one to the
/// other sees the same boxes.
TEST(Network, OnOurLayersGivesTheBytesOfOpenCvOnOurKernels) {
  STILLMAP_NEEDS_SHARED();
  const std::string bytes = real_model();
  const auto frames = test::list_rgbd(test::shared_folder() / "data/fr1_rpy_walkers");
  for (const auto& [width, height] : {std::pair{640, 480}, std::pair{540, 360}}) {
    const Letterbox letterbox(width, height, 320, 256);
    const auto ours = open_network(bytes, letterbox, kFormat);
    ASSERT_TRUE(ours.ok()) << ours.error().message;
    const std::unique_ptr<Network> theirs = on_opencv(bytes, letterbox);
    ASSERT_EQ(ours.value()->output_count(), 8u);
    ASSERT_EQ(theirs->output_count(), 8u);
    for (const std::size_t at : {10u, 90u, 170u}) {
      const test::Image<Bgr> colour = test::read_colour(frames[at].colour);
      // The right part of the picture: rows that are part of wider ones.
      const ImageView<const Bgr> view{colour.pixels.data() + (640 - width), width, height, 640};
      ASSERT_TRUE(ours.value()->run(view).ok());
      ASSERT_TRUE(theirs->run(view).ok());
      for (std::size_t i = 0; i < 8; ++i) {
        const Tensor a = ours.value()->output(i);
        std::size_t k = 0;
        while (k < 8 && theirs->output(k).name != a.name) ++k;
        ASSERT_LT(k, 8u) << a.name;
        const Tensor b = theirs->output(k);
        EXPECT_EQ(a.shape, b.shape);
        EXPECT_TRUE(same(a.values, b.values)) << a.name << " of frame " << at;
      }
    }
  }
}

TEST(Network, ADamagedFileIsRefusedOrRunAndNeverMore) {
  STILLMAP_NEEDS_SHARED();
  std::ifstream file(test::shared_folder() / "models/nanodet_plus_m/nanodet_plus_m_int8.onnx",
                     std::ios::binary);
  const std::string sound{std::istreambuf_iterator<char>(file), {}};
  const Letterbox letterbox(640, 480, 320, 256);
  const auto open = [&](const std::string& bytes) {
    const auto read = read_onnx(std::as_bytes(std::span(bytes)));
    return read && Int8Network::open(*read, letterbox, kFormat).ok();
  };
  ASSERT_TRUE(open(sound));
  EXPECT_FALSE(open(""));
  EXPECT_FALSE(open(sound.substr(0, sound.size() - 1)));
  EXPECT_FALSE(open(sound.substr(0, sound.size() / 2)));
  // The graph's nodes come first: what says how layers hang together is among these bytes.
  Random random(5);
  int refused = 0;
  for (int i = 0; i < 20; ++i) {
    std::string damaged = sound;
    damaged[random.below(60'000)] = static_cast<char>(random.below(256));
    refused += open(damaged) ? 0 : 1;
  }
  EXPECT_GT(refused, 8);
}

}  // namespace
}  // namespace stillmap
