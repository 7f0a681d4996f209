// What a device says of itself, what it is calibrated with, and what its link has counted: see
// MadeDevice::facts.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace palpate::device {

/// Key and value, for people and reports; a key has its unit, as in files.
using DeviceFacts = std::vector<std::pair<std::string, std::string>>;

/// Appends what was counted.
inline void add_counts(DeviceFacts& facts,
                       std::initializer_list<std::pair<const char*, std::uint64_t>> counts) {
  for (const auto& [key, count] : counts) facts.emplace_back(key, std::to_string(count));
}

}  // namespace palpate::device
