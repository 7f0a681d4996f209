// Tells the person at a device what to do until it knows its zero, and that it does: in sessions, in the far
// end of a bridge and in `palpate devices --report` alike.
#pragma once

#include <optional>
#include <string>

#include "experiments/live/session_device.h"

namespace palpate::experiments {

/// One thread's, any but the servo's. Refers to the device.
class HomingTeller {
 public:
  /// `then`: what follows once it is homed, after "the device knows its zero".
  HomingTeller(const SessionDevice& device, std::string then) : device_(device), then_(std::move(then)) {}
  /// A sentence that has not been told yet; nothing: there is no news.
  [[nodiscard]] std::optional<std::string> news();

 private:
  const SessionDevice& device_;
  std::string then_, told_;  // what is to be done now
};

}  // namespace palpate::experiments
