// The library of the command line, and what it leaves to wish for: numbers read in one strict way, and
// options that are not known named as such, whatever else is missing.
#pragma once

#include <CLI/App.hpp>
#include <map>
#include <optional>
#include <string>

#include "experiments/command/subcommand.h"

namespace palpate::experiments {

/// Puts every subcommand's options into `app`; `runs` gets what is then done, by name.
using Runs = std::map<std::string, RunSubcommand>;
void declare(CLI::App& app, const std::vector<Subcommand>& subcommands, Runs& runs);

/// The first word that looks like an option and is none of `app` or the subcommand that it stands in; nothing
/// where there is none. Values of options are no options, whatever they look like, and nothing is after "--".
[[nodiscard]] std::optional<Error> unknown_option(const CLI::App& app, int argc, const char* const* argv);

}  // namespace palpate::experiments
