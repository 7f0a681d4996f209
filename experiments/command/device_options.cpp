#include "experiments/command/device_options.h"

namespace palpate::experiments {

void declare_device(const Declaration& declare, DeviceArguments& device) {
  declare.text("--device", device.device,
               "sim, or sim:NAME with omni, touch, falcon, omega3 or admittance, or one of `palpate devices` "
               "(default: sim, which is sim:omni)");
  declare_device_details(declare, device);
}

void declare_device_details(const Declaration& declare, DeviceArguments& device) {
  constexpr NumberRange kKillAfter{0.0, 10'000.0};
  declare.text("--device-file", device.file, "a device description, for drivers that take one");
  declare.repeated("--device-option", device.options,
                   "KEY=VALUE for the device's driver; may be given again for others");
  declare.number("--guard-kill-after", device.guard_kill_after_ms, kKillAfter,
                 "ms without a tick after which the guard process of a real device kills this program and "
                 "commands zero: it hangs or was stopped (default: 0, never)");
}

}  // namespace palpate::experiments
