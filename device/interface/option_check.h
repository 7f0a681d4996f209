// Internal to simulations: numbers of a device that must be 0 or above, or above 0.
#pragma once

#include <cmath>
#include <span>
#include <string>

#include "toolkit/core/result.h"

namespace palpate::device {

struct CheckedNumber {
  const char* name;
  double value;
  bool zero_is_right;
};

/// The first that is not right, as an error of the device.
[[nodiscard]] inline Status check_numbers(std::span<const CheckedNumber> numbers, const std::string& device) {
  for (const CheckedNumber& one : numbers) {
    if (std::isfinite(one.value) && (one.value > 0.0 || (one.zero_is_right && one.value == 0.0))) continue;
    return Error{std::string(one.name) + " is " + std::to_string(one.value),
                 one.zero_is_right ? "give a finite number, 0 or above" : "give a finite number above 0",
                 device, 0};
  }
  return Done{};
}

}  // namespace palpate::device
