#include "device/interface/drivers.h"

#include <algorithm>
#include <cassert>
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

}  // namespace palpate::device
