// The bridge among the drivers.
#pragma once

#include "device/interface/drivers.h"

namespace palpate::device {

/// "bridge:HOST:PORT" or "bridge:HOST" (port kBridgePort). Options: most-age-ms.
void register_bridge_driver(Drivers& drivers);

/// Tells whoever listens at HOST:PORT to let go, and whether it said that it did: for a guard process. Opens
/// a socket of its own. 50 ms at most, and what finding the host takes.
[[nodiscard]] bool release_far_end(const std::string& host_and_port);

}  // namespace palpate::device
