// The end of a whole program under a force: what a guard process is for.
#pragma once

#include <cstdint>

#include "device/safety/guard.h"
#include "device/simulated/simulated_board.h"
#include "toolkit/core/result.h"

namespace palpate::device {

struct PressOptions {
  double rate_hz = 1000.0;
  bool guarded = true;
  GuardOptions guard{};
};

/// Runs a servo that presses into a wall on the machine's clock, for ever; what the machine does is no fault
/// of it, for this is about its end. In a process of its own: it leaves no core.
[[noreturn]] void press_for_ever(SimulatedBoard& board, const PressOptions& options);

struct DeathOutcome {
  bool pressed = false;   ///< there was a force that could be let go
  double zero_ms = -1.0;  ///< from the signal to motors let go; below 0: not within `patience_s`
};

/// Forks such a program, sends it a signal while it presses and waits for zero. Not under ThreadSanitizer.
[[nodiscard]] Result<DeathOutcome> run_death(int signal, const PressOptions& options, double patience_s);

}  // namespace palpate::device
