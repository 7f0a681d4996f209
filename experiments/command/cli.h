// The library of the command line, and what it leaves to wish for: numbers read in one strict way, and
// options that are not known named as such, whatever else is missing.
#pragma once

#include <CLI/App.hpp>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "experiments/command/subcommand.h"

namespace palpate::experiments {

inline constexpr const char *kEmitOption = "--emit", *kEngineOption = "--engine", *kCaseOption = "--case";

/// A subcommand's options in the library's terms, and what is done with them.
struct DeclaredCommand {
  std::unique_ptr<CLI::App> app;
  RunSubcommand run;
};
[[nodiscard]] DeclaredCommand declare(const Subcommand& subcommand);

/// The first word that looks like an option and is none of `command`; nothing where there is none. Values of
/// options are no options, whatever they look like, and nothing is after "--".
[[nodiscard]] std::optional<Error> unknown_option(const CLI::App& command,
                                                  const std::vector<std::string>& arguments);

/// Long options with a place in --help-all.
[[nodiscard]] std::vector<std::string> option_names(const CLI::App& command);

/// Name, use, two examples, options: at most `kHelpColumns` wide where an example allows it. `all`: every
/// example and option. `kinds`: of the same verb.
inline constexpr std::size_t kHelpColumns = 100;
[[nodiscard]] std::string help_text(const Subcommand& subcommand, bool all,
                                    const std::vector<Subcommand>& kinds);

// The command line as a whole: verbs and their kinds, help, completion, and former names.

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
/// palpate/progress.h are run, what they say goes to standard error, and the exit status is 128 + signal
/// (130, 143, 129). A second signal, later, does not even wait for these. What has an EndOnStop
/// (experiments/session) ends by itself first, with the same status. SIGPIPE is ignored: what nobody reads is
/// told by the write, and messages are no reason to end. To be called once, first of all.
void stop_on_signals();

}  // namespace palpate::experiments
