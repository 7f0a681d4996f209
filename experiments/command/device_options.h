// Options of the commands that run a device.
#pragma once

#include "experiments/command/subcommand.h"
#include "experiments/live/session_device.h"

namespace palpate::experiments {

/// --device, and what follows.
void declare_device(const Declaration& declare, DeviceArguments& device);
/// --device-file, --device-option, --guard-kill-after, where another option names the device.
void declare_device_details(const Declaration& declare, DeviceArguments& device);

}  // namespace palpate::experiments
