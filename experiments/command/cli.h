// What the library of the command line leaves to wish for: numbers read in one strict way, and options that
// are not known named as such, whatever else is missing.
#pragma once

#include <CLI/App.hpp>
#include <functional>
#include <optional>
#include <string>

#include "toolkit/core/options.h"

namespace palpate::experiments {

using TakeNumber = std::function<void(double)>;
using TakeInteger = std::function<void(long long)>;
CLI::Option* add_number_option(CLI::App& command, const std::string& name, const TakeNumber& take,
                               const NumberRange& range, const std::string& help);
CLI::Option* add_integer_option(CLI::App& command, const std::string& name, const TakeInteger& take,
                                const NumberRange& range, const std::string& help);

/// An option that takes a finite number in `range`, which --help shows too; left as it is where not given.
template <class T>
CLI::Option* add_number(CLI::App& command, const std::string& name, T& value, const NumberRange& range,
                        const std::string& help) {
  return add_number_option(
      command, name, [&value](double given) { value = static_cast<T>(given); }, range, help);
}
/// The same for whole numbers; T must hold all of `range`.
template <class T>
CLI::Option* add_integer(CLI::App& command, const std::string& name, T& value, const NumberRange& range,
                         const std::string& help) {
  return add_integer_option(
      command, name, [&value](long long given) { value = static_cast<T>(given); }, range, help);
}

/// The first word that looks like an option and is none of `app` or the subcommand that it stands in; nothing
/// where there is none. Values of options are no options, whatever they look like, and nothing is after "--".
[[nodiscard]] std::optional<Error> unknown_option(const CLI::App& app, int argc, const char* const* argv);

}  // namespace palpate::experiments
