// Tells the person at a device how to home it and when it is homed. Used by sessions, the bridge's far end
// and `palpate list devices --report`.
#pragma once

#include <optional>
#include <string>

#include "experiments/live/session_device.h"

namespace palpate::experiments {

/// One thread, not the servo's. Refers to the device.
class HomingTeller {
 public:
  /// `then`: text after "the device knows its zero".
  HomingTeller(const SessionDevice& device, std::string then) : device_(device), then_(std::move(then)) {}
  /// A sentence not told yet; empty if nothing changed.
  [[nodiscard]] std::optional<std::string> news();

 private:
  const SessionDevice& device_;
  std::string then_, told_;  // the present instruction
};

}  // namespace palpate::experiments
