// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "app/commands.h"
#include "runtime/source.h"

namespace stillmap {

void add_devices_command(CLI::App& app, Action& action) {
  CLI::App* devices_app = app.add_subcommand("devices", "List what can be opened here, as source URIs");
  devices_app->callback([&action] {
    action = []() -> Status {
      const std::vector<FoundSource> found = find_sources();
      for (const FoundSource& source : found)
        std::printf("%-40s %s\n", source.uri.c_str(), source.description.c_str());
      if (found.empty())
        std::fprintf(stderr, "no camera found; `stillmap doctor` looks for what is in the way\n");
      return {};
    };
  });
}

}  // namespace stillmap
