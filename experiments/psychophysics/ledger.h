// A study's rows as they arrive. Each is in the file before the next question.
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
  /// `rows`: earlier sessions' rows; new ones are appended. `stop_after`: trials of this session; 0: all.
  Ledger(const Plan& plan, const std::string& observer, std::vector<Row>& rows, TrialFile file,
         long long stop_after);

  /// True once this session has asked its trials.
  [[nodiscard]] bool session_over() const noexcept { return stop_after_ > 0 && asked_ == stop_after_; }
  /// Empty: the study is complete. Error: excluded answers keep it from ever ending.
  [[nodiscard]] Result<std::optional<Trial>> next() const;
  /// Enters the answer to `trial`, which must be next(). The system has it when this returns.
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
