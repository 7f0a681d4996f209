// One fault on the whole chain: hand, link, device, renderer, governor and watchdog, and how soon the motors
// let go.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "device/interface/force_governor.h"
#include "toolkit/core/result.h"

namespace palpate::device {

/// What goes wrong, and what has to answer.
struct TrialFault {
  enum class Where : std::uint8_t {
    kLink,      ///< on the simulated link: `kind` of LinkFault
    kRenderer,  ///< the renderer answers NaN
    kStuck,     ///< the renderer does not come back for `lasts_s`
    kLate,      ///< the loop is not run for `lasts_s`
  };
  std::string name;
  Where where = Where::kLink;
  int kind = 0;           ///< of LinkFault::Kind
  double lasts_s = 1.0;   ///< longer than any limit
  bool harmless = false;  ///< short enough to be felt through: no fault, and the force stays or comes back
  Fault expected = Fault::kNone;
};

/// Every fault that one process can live through; docs/safety.md tells what each is.
[[nodiscard]] const std::vector<TrialFault>& trial_faults();

struct TrialOptions {
  double rate_hz = 1000.0;
  std::uint64_t seed = 1;  ///< of the phase in a period at which it goes wrong
  bool real_time = false;  ///< on the machine's clock, with the watchdog's thread; else on a virtual one
};

struct TrialOutcome {
  Fault fault = Fault::kNone;    ///< that was latched
  double force_before_n = 0.0;   ///< what the motors held when it went wrong
  double force_at_end_n = 0.0;   ///< and when the trial was over
  double detected_ms = -1.0;     ///< from going wrong to the fault; below 0: never
  double zero_ms = -1.0;         ///< from going wrong to motors let go, for good
  double zero_after_ms = -1.0;   ///< from the detection to it, 0 where the zero came first
  int frames_to_zero = 0;        ///< frames with force, begun after the detection
  std::uint64_t late_looks = 0;  ///< of the watchdog: the machine stood still
};

/// Presses into a wall, lets it go wrong, goes on for 0.1 s. Virtual time: the same on every machine. An
/// Error where the device does not open.
[[nodiscard]] Result<TrialOutcome> run_trial(const TrialFault& fault, const TrialOptions& options);

}  // namespace palpate::device
