// SPDX-License-Identifier: Apache-2.0
#include "tests/detect/reference_decode.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>

#include "tests/support/temporary_folder.h"

namespace stillmap::test {

namespace {

std::vector<Detection> decode_by_reference(const std::string& family, int classes,
                                           std::span<const Tensor> outputs) {
  const TemporaryFolder folder;
  std::ofstream out(folder / "outputs", std::ios::binary);
  for (const Tensor& tensor : outputs) {
    out.write(reinterpret_cast<const char*>(tensor.values.data()),
              static_cast<std::streamsize>(tensor.values.size_bytes()));
  }
  out.close();
  std::string command = "/usr/bin/python3 " STILLMAP_SOURCE_DIR "/tests/detect/reference_decode.py " +
                        family + " " + (folder / "outputs") + " " + std::to_string(classes);
  for (const int size : {kPictureWidth, kPictureHeight, kInputWidth, kInputHeight})
    command += " " + std::to_string(size);
  command += " " + std::to_string(kScore) + " " + std::to_string(kIou);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::vector<Detection> found;
  for (Detection d; std::fscanf(pipe.get(), "%hu %f %f %f %f %f", &d.class_id, &d.score, &d.box.x0, &d.box.y0,
                                &d.box.x1, &d.box.y1) == 6;) {
    found.push_back(d);
  }
  return found;
}

}  // namespace

FixedVector<Detection, 64> decode(Decoder& decoder, int classes, std::span<const Tensor> outputs,
                                  double nms_iou) {
  const Decoder::Choice choice = decoder.choose(outputs);
  EXPECT_EQ(choice.refusal, "");
  EXPECT_EQ(choice.classes, classes);
  std::vector<Tensor> chosen;
  for (const std::size_t i : choice.outputs) chosen.push_back(outputs[i]);
  const std::vector<ClassKind> kinds(static_cast<std::size_t>(classes), ClassKind::Dynamic);
  BoxSelection boxes(Letterbox(kPictureWidth, kPictureHeight, kInputWidth, kInputHeight), kinds, nms_iou);
  FixedVector<Detection, 64> found;
  decoder.decode(chosen, boxes);
  boxes.select(found);
  return found;
}

void expect_as_reference(const std::string& family, Decoder& decoder, int classes,
                         std::span<const Tensor> outputs) {
  if (std::system("/usr/bin/python3 -c 'import numpy' 2>/dev/null") != 0)
    GTEST_SKIP() << "needs python3-numpy";
  const std::vector<Detection> expected = decode_by_reference(family, classes, outputs);
  const auto found = decode(decoder, classes, outputs);
  ASSERT_GT(expected.size(), 10u);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(found[i].class_id, expected[i].class_id);
    EXPECT_NEAR(found[i].score, expected[i].score, 1e-5);
    EXPECT_NEAR(found[i].box.x0, expected[i].box.x0, 0.01);
    EXPECT_NEAR(found[i].box.y0, expected[i].box.y0, 0.01);
    EXPECT_NEAR(found[i].box.x1, expected[i].box.x1, 0.01);
    EXPECT_NEAR(found[i].box.y1, expected[i].box.y1, 0.01);
  }
}

Tensor tensor_of(std::string_view name, std::initializer_list<std::size_t> shape,
                 std::span<const float> values) {
  Tensor tensor{name, static_cast<int>(shape.size()), {}, values};
  std::ranges::transform(shape, tensor.shape.begin(), [](std::size_t n) { return static_cast<int>(n); });
  return tensor;
}

}  // namespace stillmap::test
