// The far end of the UDP bridge as a command: lets a program at another machine feel a device of this one.
#pragma once

#include <string>

#include "experiments/live/session_device.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

struct BridgeArguments {
  DeviceArguments device;
  std::string listen = "127.0.0.1:47800";
  double seconds = 0.0;  ///< 0: until it is stopped
  double rate_hz = 1000.0;
  double watchdog_ms = 20.0, most_age_ms = 20.0;
  double force_limit_n = 0.0;  ///< 0: the device's own
  bool json = false;
};

/// Serves. Zero force on every way out: its own end, Ctrl-C, a servo that hangs (watchdog), a death of the
/// process (guard, where the device has motors). Answers the exit status.
[[nodiscard]] int run_bridge(const BridgeArguments& arguments, Context& context);

}  // namespace palpate::experiments
