// The fault table over the real libusb.
#pragma once

#include <string>

namespace palpate::device {

/// As measure_link_faults().
[[nodiscard]] bool measure_usb_faults(int runs, std::string& rows_json);

}  // namespace palpate::device
