// Lengths as options of the rivals. They are in the options' own unit or in mm.
#pragma once

#include <string>
#include <utility>

#include <palpate/options.h>
#include "toolkit/core/option_specs.h"

namespace palpate::baselines::option {

using palpate::option::choice, palpate::option::Conditions, palpate::option::flag, palpate::option::integer,
    palpate::option::number;

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
