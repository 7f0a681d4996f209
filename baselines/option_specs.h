// Options in one call each, for tables of them.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include <palpate/options.h>

namespace palpate::baselines::option {

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

/// The option `key`, a length in the rival's unit, which acts where `key`_mm is 0.
[[nodiscard]] inline OptionSpec in_spacings(const std::string& key, std::string value, std::string help,
                                            double low, double high) {
  return number(key, std::move(value), std::move(help), low, high, {{key + "_mm", {"0"}}});
}
/// The option `key`_mm beside it.
[[nodiscard]] inline OptionSpec in_mm(const std::string& key) {
  return number(key + "_mm", "0", "the same in mm; 0: by " + key, 0.0, 1e12);
}
/// The length that the two give.
[[nodiscard]] inline double length_mm(const Options& options, const std::string& key, double unit_mm) {
  const double given_mm = options.number(key + "_mm");
  return given_mm > 0.0 ? given_mm : options.number(key) * unit_mm;
}

}  // namespace palpate::baselines::option
