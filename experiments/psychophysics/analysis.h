// Analyses a study's trials: pure functions of plan and rows.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "experiments/psychophysics/trials.h"

namespace palpate::experiments::psychophysics {

/// The result of a study that compares two renderers.
struct Difference {
  Answers answers;
  Estimate share;              ///< share of right answers, with the Clopper-Pearson interval
  double p = 1.0;              ///< probability of at least as many right answers by chance
  double equivalence_p = 1.0;  ///< probability of at most as many if the share is the bound
  std::optional<Sensitivity> differencing, independent;  ///< the second if it differs
};

/// The result of a study that varies an option.
struct Threshold {
  std::vector<LevelAnswers> levels;
  PsychometricFit fit;
  Estimate jnd;                       ///< in the option's unit
  std::string method;                 ///< of the value and interval
  std::optional<Estimate> procedure;  ///< the procedure's own estimate
  std::string procedure_says;         ///< what it estimates
};

struct Analysis {
  std::uint64_t practice = 0, main = 0, excluded = 0, catches = 0, catches_right = 0;
  std::string participant_excluded;  ///< reason by the plan's rule; empty: not excluded
  std::optional<Difference> difference;
  std::optional<Threshold> threshold;
  std::vector<std::string> warnings;
};
/// Error: too few trials are left.
[[nodiscard]] Result<Analysis> analyse(const Plan& plan, const std::vector<Row>& rows);

}  // namespace palpate::experiments::psychophysics
