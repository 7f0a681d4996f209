// A device by its name, whatever its driver: for commands that use one device without a scene. A simulated
// arm stands under a simulated hand that roams about.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "device/interface/drivers.h"
#include "toolkit/core/clock.h"

namespace palpate::experiments {

/// As the command line has it.
struct OneDevice {
  std::string name = "sim";
  std::string file;                  ///< a device description
  std::vector<std::string> options;  ///< each KEY=VALUE
  std::string hand = "hand";
};

/// Of each KEY=VALUE. An Error names what is none.
[[nodiscard]] Result<std::vector<std::pair<std::string, std::string>>> option_pairs(
    const std::vector<std::string>& texts);

/// Not yet open. It keeps a reference to the clock. An Error lists the drivers where none has the name.
[[nodiscard]] Result<device::MadeDevice> any_device(const OneDevice& arguments,
                                                    const device::Drivers& drivers, const Clock& clock,
                                                    double rate_hz);

}  // namespace palpate::experiments
