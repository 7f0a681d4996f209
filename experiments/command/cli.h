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

/// Long options with a place in --help; `rare`: with those that --help-all alone shows.
[[nodiscard]] std::vector<std::string> option_names(const CLI::App& command, bool rare);

/// Name, use, two examples, options: at most `kHelpColumns` wide where an example allows it. `all`: every
/// example and option. `kinds`: of the same verb.
inline constexpr std::size_t kHelpColumns = 100;
[[nodiscard]] std::string help_text(const Subcommand& subcommand, bool all,
                                    const std::vector<Subcommand>& kinds);

}  // namespace palpate::experiments
