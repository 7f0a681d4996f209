// A link to a device that is also told things outside its stream: USB's control requests.
#pragma once

#include <cstdint>

#include "device/interface/link.h"

namespace palpate::device {

/// A control request to the device, without data.
struct ControlRequest {
  std::uint8_t type = 0;  ///< bmRequestType
  std::uint8_t request = 0;
  std::uint16_t value = 0, index = 0;

  friend bool operator==(const ControlRequest&, const ControlRequest&) = default;
};

/// poll() of such a link gives one packet of the bus a call, or as much of it as `into` holds, and the rest
/// in the next calls: where packets begin can be seen.
class ControlLink : public Link {
 public:
  /// Waits until the device has taken it: for setting up, not for frames. One thread.
  [[nodiscard]] virtual Status control(const ControlRequest& request) = 0;
};

}  // namespace palpate::device
