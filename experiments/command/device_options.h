// Options of the commands that run a device.
#pragma once

#include "experiments/command/subcommand.h"
#include "experiments/live/session_device.h"

namespace palpate::experiments {

/// --device, --device-file, --device-option, --guard-kill-after.
void declare_device(const Declaration& declare, DeviceArguments& device);

}  // namespace palpate::experiments
