// The UDP bridge's far end: serves this machine's device to a program on another.
#pragma once

#include <string>

#include "experiments/live/session_device.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

struct BridgeArguments {
  DeviceArguments device;
  std::string listen = "127.0.0.1:47800";
  double seconds = 0.0;  ///< 0: until stopped
  double rate_hz = 1000.0;
  double watchdog_ms = 20.0, most_age_ms = 20.0;
  double force_limit_n = 0.0;  ///< 0: the device's own
  bool json = false;
};

/// Serves until stopped. Zero force is sent at every end: regular, Ctrl-C, a hanging servo (watchdog), death
/// of the process (guard, if the device has motors). Returns the exit status.
[[nodiscard]] Result<int> run_bridge(const BridgeArguments& arguments, Context& context);

}  // namespace palpate::experiments
