// SPDX-License-Identifier: Apache-2.0
#include "core/stderr_text.h"

#include <gtest/gtest.h>

#include <csignal>
#include <string>

#include "tests/core/stderr_pipe.h"

namespace stillmap {
namespace {

TEST(StderrText, GoesThroughWhole) {
  test::StderrPipe pipe;
  std::string text(5'000, 'a');  // more than a pipe takes at once for sure
  text.back() = '\n';
  write_stderr(text);
  EXPECT_EQ(pipe.read(), text);
}

TEST(StderrText, IsLostAndCountedWhereNobodyReads) {
  test::StderrPipe pipe;
  const std::string filler = pipe.fill();
  write_stderr("one\n");
  write_stderr("two\n");
  EXPECT_EQ(pipe.read(), filler);
  write_stderr("three\n");
  write_stderr("four\n");
  EXPECT_EQ(pipe.read(), "2 messages are missing here: nobody read stderr\nthree\nfour\n");
}

TEST(StderrText, AReaderWhoLeavesIsNoFault) {
  ASSERT_NE(std::signal(SIGPIPE, SIG_IGN), SIG_ERR);
  {
    test::StderrPipe pipe;
    pipe.leave();
    write_stderr("to nobody\n");
  }
  std::signal(SIGPIPE, SIG_DFL);
  test::StderrPipe pipe;
  write_stderr("again\n");
  EXPECT_EQ(pipe.read(), "1 messages are missing here: nobody read stderr\nagain\n");
}

}  // namespace
}  // namespace stillmap
