// SPDX-License-Identifier: Apache-2.0
#include "core/status.h"

#include <gtest/gtest.h>

#include <memory>

namespace stillmap {
namespace {

TEST(Status, IsFineOrCarriesOneError) {
  EXPECT_TRUE(Status().ok());
  const Status failed = Error{ExitCode::UnreadableInput, "what"};
  EXPECT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().exit_code, ExitCode::UnreadableInput);
  EXPECT_EQ(failed.error().message, "what");
}

TEST(Result, HoldsAValueThatCanBeMovedOut) {
  Result<std::unique_ptr<int>> result(std::make_unique<int>(5));
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(*std::move(result.value()), 5);
  const Result<int> failed = Error{ExitCode::WrongConfig, "why"};
  EXPECT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().message, "why");
}

TEST(ResultDeathTest, TheValueOfAnErrorIsABug) {
  const Result<int> failed = Error{ExitCode::WrongConfig, "why"};
  EXPECT_DEATH((void)failed.value(), "bug: value_.has_value");
}

}  // namespace
}  // namespace stillmap
