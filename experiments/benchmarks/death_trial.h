// Ends a program under force, to test the guard.
#pragma once

#include <cstdint>

#include <palpate/device/guard.h>
#include <palpate/result.h>
#include "device/simulated/simulated_link.h"

namespace palpate::device {

struct PressOptions {
  double rate_hz = 1000.0;
  bool guarded = true;
  GuardOptions guard{};
};

/// Runs a servo that presses into a wall on the real clock for ever, ignoring delays of the machine. Call in
/// a process of its own; it leaves no core dump.
[[noreturn]] void press_for_ever(SimulatedBoard& board, const PressOptions& options);

struct DeathOutcome {
  bool pressed = false;   ///< a force was present
  double zero_ms = -1.0;  ///< from the signal to released motors; below 0: not within `patience_s`
};

/// Forks a pressing program, sends it a signal and waits for zero force. Not under ThreadSanitizer.
[[nodiscard]] Result<DeathOutcome> run_death(int signal, const PressOptions& options, double patience_s);

}  // namespace palpate::device
