// The command line as a whole: every subcommand with its options and its help.
#pragma once

#include "experiments/command/cli.h"

namespace palpate::experiments {

/// Declares every subcommand, and what stands before and after them.
void declare(CLI::App& app, Runs& runs);

/// Reads a command line into what `app` was declared with; nothing is run. `answered`: it was
/// --help or --version, which are printed. An Error says what is not understood.
[[nodiscard]] Status parse(CLI::App& app, int argc, const char* const* argv, bool& answered);

/// Reads it and runs the subcommand. The exit status.
int run_command_line(int argc, const char* const* argv);

}  // namespace palpate::experiments
