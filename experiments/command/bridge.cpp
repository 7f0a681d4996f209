#include "experiments/bridge/serve.h"
#include "experiments/command/device_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_bridge(const Declaration& declare, BridgeArguments& a) {
  constexpr NumberRange kSeconds{0.0, 86'400.0}, kRates{500.0, 8000.0}, kTimes{1.0, 1000.0},
      kForces{0.0, 100.0};
  declare_device(declare, a.device);
  declare.text("--hand", a.device.grip,
               "on a simulated device: hand, finger, arm or released (default: hand); it roams about");
  declare.text("--listen", a.listen,
               "ADDRESS:PORT of this machine; 0.0.0.0 for all of its networks, port 0 for any (default: "
               "127.0.0.1:47800, this machine alone)");
  declare.number("--seconds", a.seconds, kSeconds, "how long (default: 0, until it is stopped)");
  declare.number("--rate", a.rate_hz, kRates, "of the device, Hz (default: 1000)");
  declare.number("--watchdog-ms", a.watchdog_ms, kTimes,
                 "without a command for longer: zero force (default: 20)");
  declare.number("--most-age-ms", a.most_age_ms, kTimes,
                 "a command that answers a state of longer ago is refused (default: 20)");
  declare.number("--force-limit", a.force_limit_n, kForces,
                 "N, whatever is commanded (default: 0, the device's own limit)");
  declare.flag("--json", a.json, "print what happened as JSON, at the end");
}

int run_bridge_command(const BridgeArguments& arguments, Context& context) {
  return run_bridge(arguments, context);
}

}  // namespace

Subcommand bridge_subcommand() {
  return subcommand(
      "bridge", "serves a device of this machine to programs at another one, over UDP",
      {"palpate bridge --device sim:omni --seconds 1",
       "palpate bridge --device sim:falcon --listen 127.0.0.1:0 --force-limit 2 --seconds 1 --json"},
      declare_bridge, run_bridge_command);
}

}  // namespace palpate::experiments
