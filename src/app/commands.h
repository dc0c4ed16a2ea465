// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "core/status.h"
#include "runtime/run_options.h"

namespace stillmap {

/// What a parsed subcommand does; its Status decides the exit code.
using Action = std::function<Status()>;

/// Adds a subcommand that takes everything that `run` takes.
void add_command_of_run(CLI::App& app, const char* name, const char* help,
                        Status (*command)(const RunOptions&), Action& action);

// Each adds its subcommand to `app` and sets `action` when the user chose it.
void add_run_command(CLI::App& app, Action& action);
void add_eval_command(CLI::App& app, Action& action);
void add_plan_command(CLI::App& app, Action& action);
void add_check_command(CLI::App& app, Action& action);
void add_map_command(CLI::App& app, Action& action);
void add_devices_command(CLI::App& app, Action& action);
void add_doctor_command(CLI::App& app, Action& action);

}  // namespace stillmap
