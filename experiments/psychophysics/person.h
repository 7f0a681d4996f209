// A person who answers by keys: trials in one live session, on a device or under a simulated hand.
#pragma once

#include "experiments/psychophysics/ledger.h"
#include "experiments/psychophysics/markers.h"
#include "experiments/psychophysics/rig.h"
#include "experiments/psychophysics/sessions.h"

namespace palpate::experiments::psychophysics {

/// How a session with a person ended.
struct PersonSession {
  bool complete = false;
  bool sat = false;      ///< the loop ran; else there was nothing left to ask
  SessionRecord record;  ///< of the loop, where it ran
};

/// What is asked after the intervals, and which keys answer it.
[[nodiscard]] std::string question_of(const Plan& plan);
/// 0 or 1; -1 for a key that answers nothing of this task.
[[nodiscard]] int choice_of(Task task, char key) noexcept;

/// Asks until the study or the session ends, or somebody presses q: nothing is lost then. Errors: of the rig;
/// a renderer that cannot be felt any more; a row or a trace that cannot be written.
[[nodiscard]] Result<PersonSession> ask_person(const Plan& plan, Bench& bench, SessionClock& clock,
                                               SessionDevice& device, Ledger& ledger,
                                               const OutputFolder& folder, Markers& markers,
                                               ProgressBar& progress);

}  // namespace palpate::experiments::psychophysics
