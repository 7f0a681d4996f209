// Runs trials with a person who answers by keys. The person holds a device or watches a simulated hand. Time
// markers tell external recorders when something happened, never which renderer was felt.
#pragma once

#include <memory>
#include <string>

#include <palpate/result.h>
#include "experiments/psychophysics/rig.h"
#include "experiments/psychophysics/trials.h"

namespace palpate::experiments::psychophysics {

/// One worker at a time.
class Markers {
 public:
  Markers() = default;
  Markers(const Markers&) = delete;
  Markers& operator=(const Markers&) = delete;
  virtual ~Markers() = default;
  /// Marks an event `seconds_ago`. Does nothing here.
  virtual void push(const std::string& /*text*/, double /*seconds_ago*/) {}
};

/// Sends markers as a Lab Streaming Layer stream of type "Markers", named "Palpate", with source `source`.
/// Loads liblsl at this call: `library` is a file or a name that the system can resolve. Errors: library or
/// function missing; no outlet available.
[[nodiscard]] Result<std::unique_ptr<Markers>> lsl_markers(const std::string& library,
                                                           const std::string& source);
inline constexpr const char* kLslLibrary = "liblsl.so.2";

/// The end of a person's session.
struct PersonSession {
  bool complete = false;
  bool sat = false;      ///< the loop ran; else nothing was left to ask
  SessionRecord record;  ///< of the loop, if it ran
};

/// The question after the intervals, with its keys.
[[nodiscard]] std::string question_of(const Plan& plan);
/// 0 or 1; -1: no answer of this task.
[[nodiscard]] int choice_of(Task task, char key) noexcept;

/// Asks until the study or session ends or somebody presses q; no data is lost. Errors: the rig's; a renderer
/// failed for good; a row or trace cannot be written.
[[nodiscard]] Result<PersonSession> ask_person(const Plan& plan, Bench& bench, SessionClock& clock,
                                               SessionDevice& device, Ledger& ledger,
                                               const OutputFolder& folder, Markers& markers,
                                               ProgressBar& progress);

}  // namespace palpate::experiments::psychophysics
