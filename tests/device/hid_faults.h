// The fault table over the real hidapi, a pseudo-terminal and UDP sockets.
#pragma once

#include <string>

namespace palpate::device {

/// As measure_link_faults(), for all three.
[[nodiscard]] bool measure_hid_faults(int runs, std::string& rows_json);

}  // namespace palpate::device
