// SPDX-License-Identifier: Apache-2.0
// stillmap_fuzz --target=NAME [libFuzzer's options] FOLDER...
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/targets.h"

namespace {

const stillmap::fuzz::Target* target = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  constexpr std::string_view kOption = "--target=";
  for (int i = 1; i < *argc; ++i) {
    const std::string_view word = (*argv)[i];
    if (word.starts_with(kOption)) target = stillmap::fuzz::find_target(word.substr(kOption.size()));
  }
  if (target != nullptr) return 0;
  std::fputs("stillmap_fuzz: give --target=NAME, one of:", stderr);
  for (const auto& known : stillmap::fuzz::targets()) std::fprintf(stderr, " %s", known.name.data());
  std::fputs("\n", stderr);
  std::exit(2);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  target->run({data, bytes});
  return 0;
}
