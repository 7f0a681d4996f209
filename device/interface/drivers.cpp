#include <palpate/device/drivers.h>

#include <algorithm>
#include <cassert>
#include <chrono>
#include <cmath>
#include <string_view>
#include <thread>
#include <utility>

#include "device/interface/driver_options.h"
#include "toolkit/core/messages.h"

namespace palpate::device {

const char* device_status_name(DeviceStatus status) noexcept {
  return status == DeviceStatus::kReady ? "ready" : status == DeviceStatus::kRefused ? "refused" : "missing";
}

void Drivers::add(Driver driver) {
  assert(!driver.name.empty() && driver.look);
  assert(
      std::none_of(drivers_.begin(), drivers_.end(), [&](const Driver& d) { return d.name == driver.name; }));
  drivers_.push_back(std::move(driver));
}

const Driver* Drivers::of(const std::string& device_name) const noexcept {
  const std::string_view name = std::string_view(device_name).substr(0, device_name.find(':'));
  for (const Driver& driver : drivers_)
    if (driver.name == name) return &driver;
  return nullptr;
}

void sleep_ms(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

DriverOption text_option(std::string name, std::string& into) {
  return {std::move(name), [&into](const std::string& value) {
            into = value;
            return Status(Done{});
          }};
}

DriverOption number_option(std::string name, double& into, const NumberRange& range) {
  return {name, [name, &into, range](const std::string& value) -> Status {
            const Result<double> read = read_number(value, range);
            if (!read) return Error{name + ": " + read.error().what, read.error().remedy};
            into = *read;
            return Done{};
          }};
}

DriverOption switch_option(std::string name, bool& into) {
  return {name, [name, &into](const std::string& value) -> Status {
            into = value == "on" || value == "yes";
            if (into || value == "off" || value == "no") return Done{};
            return Error{name + " is " + shown(value), "give on or off"};
          }};
}

Status take_options(const DeviceRequest& request, const std::string& who,
                    const std::vector<DriverOption>& options) {
  for (const auto& [key, value] : request.options) {
    const auto found = std::find_if(options.begin(), options.end(),
                                    [&key = key](const DriverOption& one) { return one.name == key; });
    if (found == options.end())
      return Error{who + " has no option " + shown(key),
                   did_you_mean(key, names_of(options), "choose from " + joined(names_of(options)))};
    PALPATE_TRY(found->take(value));
  }
  return Done{};
}

Status check_numbers(std::span<const CheckedNumber> numbers, const std::string& device) {
  for (const CheckedNumber& one : numbers) {
    if (std::isfinite(one.value) && (one.value > 0.0 || (one.zero_is_right && one.value == 0.0))) continue;
    return Error{std::string(one.name) + " is " + std::to_string(one.value),
                 one.zero_is_right ? "give a finite number, 0 or above" : "give a finite number above 0",
                 device};
  }
  return Done{};
}

}  // namespace palpate::device
