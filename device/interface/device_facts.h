// What a device says of itself, what it is calibrated with, and what its link has counted: see
// MadeDevice::facts.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace palpate::device {

/// Key and value, for people and reports; a key has its unit, as in files.
using DeviceFacts = std::vector<std::pair<std::string, std::string>>;

}  // namespace palpate::device
