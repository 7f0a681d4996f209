// The command line as a whole: every subcommand with its options and its help.
#pragma once

#include "experiments/command/cli.h"
#include "experiments/command/commands.h"

namespace palpate::experiments {

/// What the options of every subcommand were set to.
struct Arguments {
  InfoArguments info;
  PlanArguments plan;
  RenderersArguments renderers;
  PathsArguments paths;
  RunArguments replay, compare;
  StudyArguments report, score;
  ReproduceArguments reproduce;
  BehavioursArguments behaviours;
  FetchArguments fetch;
  CleanArguments clean;
};

/// Declares every subcommand. What is parsed goes into `arguments`, which must live as long as `app`.
void declare(CLI::App& app, Arguments& arguments);

/// Reads a command line into the arguments that `app` was declared with; nothing is run. `answered`: it was
/// --help or --version, which are printed. An Error says what is not understood.
[[nodiscard]] Status parse(CLI::App& app, int argc, const char* const* argv, bool& answered);

/// Reads it and runs the subcommand. The exit status.
int run_command_line(int argc, const char* const* argv);

}  // namespace palpate::experiments
