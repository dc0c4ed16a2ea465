// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <memory>

#include "app/commands.h"
#include "detect/model_file.h"

namespace stillmap {

void add_check_command(CLI::App& app, Action& action) {
  struct Options {
    std::vector<std::string> configs, overrides;
    bool dump = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* check_app = app.add_subcommand("check", "Load and validate the configuration; opens nothing");
  check_app->add_option("--config", o->configs, "Configuration file; later ones override earlier ones")
      ->take_all();
  check_app->add_option("--set", o->overrides, "KEY=VALUE, overrides the files")->take_all();
  check_app->add_flag("--dump", o->dump, "Print every key with where its value came from");
  check_app->callback([o, &action] {
    action = [o]() -> Status {
      const Result<LoadedConfig> loaded = load_config_of_model(o->configs, o->overrides);
      if (!loaded.ok()) return loaded.error();
      if (o->dump) std::fputs(config_text(loaded.value()).c_str(), stdout);
      return {};
    };
  });
}

}  // namespace stillmap
