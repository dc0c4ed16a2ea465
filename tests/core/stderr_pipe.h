// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <string>

namespace stillmap::test {

/// While it lives, a pipe that only `read` empties stands behind stderr.
class StderrPipe {
 public:
  StderrPipe() : before_(dup(STDERR_FILENO)) {
    EXPECT_EQ(pipe2(ends_.data(), O_CLOEXEC), 0);
    EXPECT_EQ(fcntl(ends_[0], F_SETFL, O_NONBLOCK), 0);
    dup2(ends_[1], STDERR_FILENO);
  }
  ~StderrPipe() {
    dup2(before_, STDERR_FILENO);
    close(before_);
    close(ends_[1]);
    leave();
  }
  StderrPipe(const StderrPipe&) = delete;
  StderrPipe& operator=(const StderrPipe&) = delete;

  /// What fits in.
  std::string fill() {
    std::string filler;
    fcntl(ends_[1], F_SETFL, O_NONBLOCK);
    while (write(ends_[1], ".", 1) == 1) filler += '.';
    fcntl(ends_[1], F_SETFL, 0);
    return filler;
  }
  /// What waits in it.
  std::string read() {
    std::string text;
    std::array<char, 4096> chunk;
    for (ssize_t size = 0; (size = ::read(ends_[0], chunk.data(), chunk.size())) > 0;)
      text.append(chunk.data(), static_cast<std::size_t>(size));
    return text;
  }
  /// Closes the end that reads.
  void leave() {
    if (ends_[0] >= 0) close(ends_[0]);
    ends_[0] = -1;
  }

 private:
  int before_;
  std::array<int, 2> ends_{};
};

}  // namespace stillmap::test
