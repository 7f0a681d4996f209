// OptionSpecs in one call each, for tables of them; apart from palpate/options.h, which is installed.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include <palpate/options.h>

namespace palpate::option {

using Conditions = std::vector<OptionCondition>;

[[nodiscard]] inline OptionSpec number(std::string key, std::string value, std::string help, double low,
                                       double high, Conditions only_with = {},
                                       OptionKind kind = OptionKind::kNumber) {
  return {std::move(key), kind, std::move(value), std::move(help), {}, low, high, std::move(only_with)};
}
[[nodiscard]] inline OptionSpec integer(std::string key, std::string value, std::string help, double low,
                                        double high, Conditions only_with = {}) {
  return number(std::move(key), std::move(value), std::move(help), low, high, std::move(only_with),
                OptionKind::kInteger);
}
[[nodiscard]] inline OptionSpec choice(std::string key, std::string value, std::string help,
                                       std::vector<std::string> choices, Conditions only_with = {},
                                       OptionKind kind = OptionKind::kChoice) {
  OptionSpec spec{std::move(key), kind, std::move(value), std::move(help), std::move(choices)};
  spec.only_with = std::move(only_with);
  return spec;
}
[[nodiscard]] inline OptionSpec flag(std::string key, std::string value, std::string help,
                                     Conditions only_with = {}) {
  return choice(std::move(key), std::move(value), std::move(help), {}, std::move(only_with),
                OptionKind::kFlag);
}

}  // namespace palpate::option
