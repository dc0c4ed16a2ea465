// SPDX-License-Identifier: Apache-2.0
// Seeds and what fuzzing once found, in every build: the promises hold for them.
#include <gtest/gtest.h>

#include "tests/fuzz/targets.h"

namespace stillmap::fuzz {
namespace {

TEST(FuzzCorpus, EveryCaseIsTakenByItsTarget) {
  const std::filesystem::path corpus = std::filesystem::path(STILLMAP_SOURCE_DIR) / "tests/fuzz/corpus";
  std::size_t folders = 0;
  for (const auto& folder : std::filesystem::directory_iterator(corpus)) {
    const Target* target = find_target(folder.path().filename().string());
    ASSERT_NE(target, nullptr) << folder.path();
    ++folders;
    std::size_t cases = 0;
    for (const auto& file : std::filesystem::directory_iterator(folder)) {
      SCOPED_TRACE(file.path());
      std::ifstream in(file.path(), std::ios::binary);
      const std::vector<char> bytes((std::istreambuf_iterator<char>(in)), {});
      target->run({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
      // Cut off anywhere, it is input of strangers, too.
      for (std::size_t i = 0; i < 16; ++i)
        target->run({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size() * i / 16});
      ++cases;
    }
    EXPECT_GT(cases, 0u) << folder.path();
  }
  EXPECT_EQ(folders, targets().size());
}

}  // namespace
}  // namespace stillmap::fuzz
