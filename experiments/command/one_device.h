// The options of every command that uses one device without a scene.
#pragma once

#include "experiments/command/subcommand.h"
#include "experiments/live/any_device.h"

namespace palpate::experiments {

inline void declare_one_device(const Declaration& declare, OneDevice& a) {
  declare.text("--device", a.name, "as `palpate devices` lists it (default: sim, a simulated arm)");
  declare.text("--device-file", a.file, "a device description, where the device needs one");
  declare.repeated("--device-option", a.options, "KEY=VALUE for its driver; may be given again for others");
  declare.text("--hand", a.hand,
               "on a simulated device: hand, finger, arm or released (default: hand); it roams about");
}

}  // namespace palpate::experiments
