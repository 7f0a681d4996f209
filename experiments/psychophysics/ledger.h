// The rows of a study as they come: the course goes on with each, and the file has it before the next is
// asked.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "experiments/psychophysics/trials.h"

namespace palpate::experiments::psychophysics {

/// One thread at a time. Refers to plan, rows and observer.
class Ledger {
 public:
  /// `rows`: those of earlier sessions; new ones are added. `stop_after`: trials of this session; 0: all.
  Ledger(const Plan& plan, const std::string& observer, std::vector<Row>& rows, TrialFile file,
         long long stop_after);

  /// Whether this session has asked what it was to ask.
  [[nodiscard]] bool session_over() const noexcept { return stop_after_ > 0 && asked_ == stop_after_; }
  /// Nothing: the study is complete. An Error where excluded answers never let it end.
  [[nodiscard]] Result<std::optional<Trial>> next() const;
  /// The answer to `trial`, which was next(). It is with the system when this returns.
  [[nodiscard]] Status enter(const Trial& trial, const Answer& answer);

 private:
  const Plan& plan_;
  const std::string& observer_;
  std::vector<Row>& rows_;
  TrialFile file_;
  Course course_;
  long long stop_after_, asked_ = 0;
};

}  // namespace palpate::experiments::psychophysics
