// One fault in the chain from hand to motors. The chain is hand, link, device, renderer, governor and
// watchdog, up to motor release.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/device/force_governor.h>
#include <palpate/device/guard.h>
#include <palpate/result.h>
#include "device/simulated/simulated_link.h"

namespace palpate::device {

/// The fault's place and kind.
struct TrialFault {
  enum class Where : std::uint8_t {
    kLink,      ///< in the simulated link: `kind` of LinkFault
    kRenderer,  ///< the renderer answers NaN
    kStuck,     ///< the renderer blocks for `lasts_s`
    kLate,      ///< the loop pauses for `lasts_s`
  };
  std::string name;
  Where where = Where::kLink;
  int kind = 0;           ///< of LinkFault::Kind
  double lasts_s = 1.0;   ///< exceeds every limit
  bool harmless = false;  ///< too short for a fault: the force stays or returns
  Fault expected = Fault::kNone;
};

/// All faults that a process survives; described in docs/results/hands-and-loops.md.
[[nodiscard]] const std::vector<TrialFault>& trial_faults();

struct TrialOptions {
  double rate_hz = 1000.0;
  std::uint64_t seed = 1;  ///< decides the phase of the fault within a period
  bool real_time = false;  ///< real clock with the watchdog's thread; else a virtual clock
};

struct TrialOutcome {
  Fault fault = Fault::kNone;    ///< latched
  double force_before_n = 0.0;   ///< motor force at the start of the fault
  double force_at_end_n = 0.0;   ///< at the trial's end
  double detected_ms = -1.0;     ///< from the fault's start to its detection; below 0: never
  double zero_ms = -1.0;         ///< from the fault's start to the final release of the motors
  double zero_after_ms = -1.0;   ///< from detection to release; 0 if released first
  int frames_to_zero = 0;        ///< frames with force begun after the detection
  std::uint64_t late_looks = 0;  ///< the watchdog's: the machine stalled
};

/// Presses into a wall, triggers the fault and continues for 0.1 s. Virtual time is deterministic. Error: the
/// device does not open.
[[nodiscard]] Result<TrialOutcome> run_trial(const TrialFault& fault, const TrialOptions& options);

// Ends a program under force, to test the guard.

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
