// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>

#include "app/commands.h"
#include "runtime/doctor.h"

namespace stillmap {

void add_doctor_command(CLI::App& app, Action& action) {
  const auto root = std::make_shared<std::string>("/");
  CLI::App* doctor_app =
      app.add_subcommand("doctor", "Check core speed, limits, USB links and permissions, each with its mend");
  doctor_app->add_option("--root", *root, "Where /sys and /dev are looked for")->group("");
  doctor_app->callback([root, &action] {
    action = [root]() -> Status {
      const std::vector<Finding> findings = examine_machine(*root);
      for (const Finding& finding : findings) {
        std::printf("%-4s %s\n", finding.good ? "ok" : "BAD", finding.what.c_str());
        if (!finding.good) std::printf("     mend: %s\n", finding.mend.c_str());
      }
      const auto bad = std::ranges::count(findings, false, &Finding::good);
      if (bad == 0) return {};
      return Error{ExitCode::RunFailed, std::to_string(bad) + " of " + std::to_string(findings.size()) +
                                            " findings are BAD; their mends stand below them"};
    };
  });
}

}  // namespace stillmap
