// The command line as a whole: verbs and their kinds, help, completion, and former names.
#pragma once

#include <string>
#include <vector>

#include "experiments/command/cli.h"

namespace palpate::experiments {

/// A command line as it was read.
struct ReadLine {
  std::string answer;  ///< help, version, completion: to be printed, and nothing is run
  std::string note;    ///< a former name and the one that it has now; empty: none
  std::string name;    ///< of the subcommand: "compare sweep"
  DeclaredCommand command{};
};

/// Reads the words behind the program's name; nothing is run. An Error says what is not understood.
[[nodiscard]] Result<ReadLine> read_line(std::vector<std::string> words);

/// Names of the former version with those that they have now, "plan" and "info plan".
[[nodiscard]] std::vector<std::pair<std::string, std::string>> former_names();

/// Reads it and runs the subcommand. The exit status.
int run_command_line(int argc, const char* const* argv);

/// From here on SIGINT, SIGTERM and SIGHUP end the program at once, whatever it is doing: the actions of
/// palpate/stop_callback.h are run, what they say goes to standard error, and the exit status is 128 + signal
/// (130, 143, 129). A second signal, later, does not even wait for these. SIGPIPE is
/// ignored: what nobody reads is told by the write, and messages are no reason to end. To be called once,
/// first of all.
void stop_on_signals();

}  // namespace palpate::experiments
