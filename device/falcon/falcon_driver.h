// The Falcon as an entry of the list of drivers, over real USB.
#pragma once

#include "device/interface/drivers.h"

namespace palpate::device {

/// "falcon", or "falcon:SERIAL" for one of several. Options: `firmware=FILE`; `k=COUNTS`, motor counts per
/// N mm; `calibrated=yes` where the weight procedure of docs/devices.md found that number, for 8 N instead of
/// 2; `event-character=on`.
void register_falcon_driver(Drivers& drivers);

}  // namespace palpate::device
