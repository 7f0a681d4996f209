// What the trials of a study say: pure functions of plan and rows.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "experiments/psychophysics/trials.h"

namespace palpate::experiments::psychophysics {

/// The answer of a study that compares two renderers.
struct Difference {
  Answers answers;
  Estimate share;              ///< of right answers, with Clopper and Pearson's interval
  double p = 1.0;              ///< of so many right answers by chance
  double equivalence_p = 1.0;  ///< of so few, where the share is the bound
  std::optional<Sensitivity> differencing, independent;  ///< the second where it is another one
};

/// The answer of a study that turns an option.
struct Threshold {
  std::vector<LevelAnswers> levels;
  PsychometricFit fit;
  Estimate jnd;                       ///< in the option's unit
  std::string method;                 ///< of value and interval
  std::optional<Estimate> procedure;  ///< what the procedure itself says
  std::string procedure_says;         ///< of what
};

struct Analysis {
  std::uint64_t practice = 0, main = 0, excluded = 0, catches = 0, catches_right = 0;
  std::string participant_excluded;  ///< why, by the plan's rule; empty: counts
  std::optional<Difference> difference;
  std::optional<Threshold> threshold;
  std::vector<std::string> warnings;
};
/// An Error where too few trials are left to say anything.
[[nodiscard]] Result<Analysis> analyse(const Plan& plan, const std::vector<Row>& rows);

}  // namespace palpate::experiments::psychophysics
