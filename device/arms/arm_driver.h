// Open arms in the list of drivers: "arm:NAME" of a known description, or "arm" with a description file.
#pragma once

#include <memory>

#include "device/arms/arm_description.h"
#include "device/interface/drivers.h"

namespace palpate::device {

/// "arm". Their ids are those of the boards' frameworks, which other gadgets have too: an arm is opened only
/// when somebody names it. Options: path, serial, current_cap_a, force_n, weight.
void register_arm_driver(Drivers& drivers);

/// The link that a description names, not yet open.
[[nodiscard]] std::unique_ptr<Link> arm_link(const ArmDescription& arm);

/// The description of a request, with its options applied.
[[nodiscard]] Result<ArmDescription> requested_arm(const DeviceRequest& request);

}  // namespace palpate::device
