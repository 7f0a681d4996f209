#include "device/interface/drivers.h"

#include <algorithm>
#include <cassert>
#include <string_view>
#include <utility>

namespace palpate::device {

const char* device_status_name(DeviceStatus status) noexcept {
  switch (status) {
    case DeviceStatus::kReady:
      return "ready";
    case DeviceStatus::kMissing:
      return "missing";
    case DeviceStatus::kRefused:
      return "refused";
  }
  return "missing";
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

}  // namespace palpate::device
