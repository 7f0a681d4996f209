// The texts of the local service that its maker ships with the Haply Inverse3 (format 3.1 and later): states
// that come, commands that go. Facts from the maker's public pages, version 3.5; no service of theirs was
// run.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "toolkit/core/vec.h"

namespace palpate::device {

/// What one text of the service says of one device.
struct Inverse3Text {
  bool is_json = false;       ///< an object
  bool has_device = false;    ///< the one that was asked for is listed
  bool has_position = false;  ///< with three finite numbers
  std::string device_id;
  Vec3 position_mm = Vec3::Zero();  ///< in the service's frame
  std::uint32_t buttons = 0;        ///< a, b, c of a grip: bits 0 to 2
  std::string config;               ///< of the device, as JSON: in the first text of a session alone
  int devices = -1;                 ///< Inverse3 that the service lists; -1: it says nothing of them
};

/// Of the device `wanted_id`; empty: the first that is listed. Never fails: what is not there stays unset.
[[nodiscard]] Inverse3Text parsed_inverse3(std::string_view text, const std::string& wanted_id);

/// A force for one device; N in the service's frame. Zero where it is not finite.
[[nodiscard]] std::string inverse3_force_text(const std::string& device_id, const Vec3& force_n);
/// Sets the gain of the service's force gate, which weakens forces that make the device swing.
[[nodiscard]] std::string inverse3_gate_text(const std::string& device_id, double gain);
/// Body of a request that switches the service's torque scaling.
[[nodiscard]] std::string inverse3_scaling_body(bool on);

}  // namespace palpate::device
