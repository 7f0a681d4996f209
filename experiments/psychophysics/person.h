// Runs trials with a person who answers by keys, on a device or watching a simulated hand.
#pragma once

#include "experiments/psychophysics/ledger.h"
#include "experiments/psychophysics/markers.h"
#include "experiments/psychophysics/rig.h"
#include "experiments/psychophysics/sessions.h"

namespace palpate::experiments::psychophysics {

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
