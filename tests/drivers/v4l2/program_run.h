// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace stillmap::test {

constexpr const char* kReport = "/tmp/report.json";

/// `stillmap run` in the virtual machine, whose words are read as they come.
class ProgramRun {
 public:
  ProgramRun(const std::string& source, const std::vector<std::string>& settings)
      : ProgramRun(arguments(source, settings)) {}
  explicit ProgramRun(std::vector<std::string> words) {
    words.insert(words.begin(), {"/bin/stillmap", "run"});
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    process_ = fork();
    if (process_ == 0) {
      dup2(ends[1], STDERR_FILENO);
      std::vector<char*> pointers;
      for (std::string& word : words) pointers.push_back(word.data());
      pointers.push_back(nullptr);
      execv(pointers[0], pointers.data());
      _exit(127);
    }
    close(ends[1]);
    words_ = fdopen(ends[0], "r");
    std::setvbuf(words_, nullptr, _IONBF, 0);  // what is there is seen by poll
  }
  ~ProgramRun() {
    fclose(words_);
    if (process_ > 0) {
      kill(process_, SIGKILL);
      waitpid(process_, nullptr, 0);
    }
  }
  ProgramRun(const ProgramRun&) = delete;
  ProgramRun& operator=(const ProgramRun&) = delete;

  /// Reads on until a line holds this; false at the program's end, and after two minutes.
  bool says(const std::string& what) {
    char line[1024];
    const std::time_t end = std::time(nullptr) + 120;
    pollfd more{fileno(words_), POLLIN, 0};
    while (std::time(nullptr) < end && poll(&more, 1, 1000) >= 0) {
      if (more.revents == 0) continue;
      if (std::fgets(line, sizeof line, words_) == nullptr) return false;
      said_ += line;
      if (std::string(line).find(what) != std::string::npos) return true;
    }
    return false;
  }
  int end(int signal_number = 0) {
    if (signal_number != 0) kill(process_, signal_number);
    says("\n\n");  // the rest
    int status = 0;
    waitpid(process_, &status, 0);
    process_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  const std::string& said() const { return said_; }

 private:
  static std::vector<std::string> arguments(const std::string& source,
                                            const std::vector<std::string>& settings) {
    std::vector<std::string> words{"--source", source,  "--listen", "off",
                                   "--report", kReport, "--set",    "detector.model=none"};
    for (const std::string& setting : settings) words.insert(words.end(), {"--set", setting});
    return words;
  }
  pid_t process_ = -1;
  std::FILE* words_ = nullptr;
  std::string said_;
};

/// What a command of the machine writes.
inline std::string output(const std::string& command) {
  std::FILE* words = popen(command.c_str(), "r");
  std::string said;
  for (char line[4096]; std::fgets(line, sizeof line, words) != nullptr;) said += line;
  EXPECT_EQ(pclose(words), 0) << command << ": " << said;
  return said;
}

/// Of the last run.
inline nlohmann::json report() {
  std::ifstream file(kReport);
  return nlohmann::json::parse(file);
}

inline std::uint64_t sum(const nlohmann::json& counts) {
  std::uint64_t all = 0;
  for (const auto& [name, count] : counts.items()) all += count.get<std::uint64_t>();
  return all;
}

}  // namespace stillmap::test
