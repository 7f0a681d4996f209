// Internal to drivers and simulations: options of a request, facts for reports, checks of numbers.
#pragma once

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <palpate/device/drivers.h>
#include <palpate/options.h>
#include <palpate/result.h>

namespace palpate::device {

/// Keys and values for people and reports (MadeDevice::facts); a key ends with its unit, as in files.
using DeviceFacts = std::vector<std::pair<std::string, std::string>>;

inline void add_counts(DeviceFacts& facts,
                       std::initializer_list<std::pair<const char*, std::uint64_t>> counts) {
  for (const auto& [key, count] : counts) facts.emplace_back(key, std::to_string(count));
}

/// Where this user may not open a device.
inline constexpr const char* kUdevRemedy =
    "install Palpate's udev rules (`palpate list devices --doctor` prints them)";

/// Sleeps; not for frames.
void sleep_ms(int ms = 1);

/// One option of a driver, and what takes its value.
struct DriverOption {
  std::string name;
  std::function<Status(const std::string& value)> take;
};
[[nodiscard]] DriverOption text_option(std::string name, std::string& into);
[[nodiscard]] DriverOption number_option(std::string name, double& into, const NumberRange& range = {});
/// "on" or "off", or "yes" or "no".
[[nodiscard]] DriverOption switch_option(std::string name, bool& into);
/// Takes all options of a request, in order. An Error names a key that is none of `options`, as of `who`
/// ("the 2DIY"), or a wrong value.
[[nodiscard]] Status take_options(const DeviceRequest& request, const std::string& who,
                                  const std::vector<DriverOption>& options);

/// A number that must be finite, and positive or not negative.
struct CheckedNumber {
  const char* name;
  double value;
  bool zero_is_right;
};
/// An Error for the first invalid number.
[[nodiscard]] Status check_numbers(std::span<const CheckedNumber> numbers, const std::string& device);

}  // namespace palpate::device
