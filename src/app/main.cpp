// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <new>
#include <string>
#include <system_error>

#include "app/commands.h"
#include "core/stderr_text.h"
#include "runtime/source.h"
#include "runtime/version.h"

namespace {

constexpr const char* kSeeHelp = "; see `stillmap --help` and `stillmap COMMAND --help`";

/// Errors are one line, whatever stands in the name of a file.
void say_error(const std::string& words) {
  std::string line = "stillmap: " + words;
  for (char& c : line) {
    if (static_cast<unsigned char>(c) < ' ' || c == '\x7f') c = '?';
  }
  stillmap::write_stderr(line + '\n');
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Stillmap: RGB-D frames in, the camera's pose and a map of everything that stands still out."};
  app.set_version_flag("--version", std::string("stillmap ") + stillmap::kVersion + " (" +
                                        stillmap::kGitRevision + "), sources: " + stillmap::source_kinds());
  app.require_subcommand(1);
  stillmap::Action action;
  stillmap::add_run_command(app, action);
  stillmap::add_eval_command(app, action);
  stillmap::add_plan_command(app, action);
  stillmap::add_check_command(app, action);
  stillmap::add_map_command(app, action);
  stillmap::add_devices_command(app, action);
  stillmap::add_doctor_command(app, action);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ExtrasError& e) {
    std::string hint = kSeeHelp;
    for (const std::string& word : app.remaining(true)) {
      if (const std::string meant = stillmap::meant_source(word); !meant.empty()) hint = meant;
    }
    say_error(e.what() + hint);
    return static_cast<int>(stillmap::ExitCode::WrongConfig);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success))
      return app.exit(e);  // --help, --version
    say_error(std::string(e.what()) + kSeeHelp);
    return static_cast<int>(stillmap::ExitCode::WrongConfig);
  }
  try {
    stillmap::Status status = action();
    if (status.ok() && (std::fflush(stdout) != 0 || std::ferror(stdout) != 0))
      status = stillmap::Error{stillmap::ExitCode::RunFailed,
                               "standard output cannot be written; is the disk full, or its reader gone?"};
    if (status.ok()) return static_cast<int>(stillmap::ExitCode::Done);
    say_error(status.error().message);
    return static_cast<int>(status.error().exit_code);
  } catch (const std::system_error& e) {
    say_error(std::string("no thread could be started (") + e.what() +
              "); raise the limits of memory and tasks");
    return static_cast<int>(stillmap::ExitCode::RunFailed);
  } catch (const std::bad_alloc&) {
    stillmap::write_stderr("stillmap: out of memory; `stillmap plan` tells how much a configuration takes\n");
    return static_cast<int>(stillmap::ExitCode::RunFailed);
  }
}
