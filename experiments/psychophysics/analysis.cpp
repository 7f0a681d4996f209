#include "experiments/psychophysics/blinded.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

namespace palpate::experiments::psychophysics {
namespace {

constexpr std::uint64_t kBootstrapPurpose = 100;

std::vector<LevelAnswers> by_level(const std::vector<const Row*>& rows) {
  // Levels reached by different steps are equal up to rounding.
  constexpr double kSameLevel = 1e-9;
  std::map<double, LevelAnswers> levels;
  for (const Row* row : rows) {
    const double level = row->trial.level;
    const auto near = levels.lower_bound(level * (1.0 - kSameLevel));
    const double key =
        near != levels.end() && near->first <= level * (1.0 + kSameLevel) ? near->first : level;
    LevelAnswers& one = levels.try_emplace(key, LevelAnswers{key, 0, 0}).first->second;
    ++one.trials;
    one.correct += row->correct() ? 1u : 0u;
  }
  std::vector<LevelAnswers> all;
  for (const auto& [level, answers] : levels) all.push_back(answers);
  return all;
}

Difference difference_of(const Plan& plan, const std::vector<const Row*>& rows) {
  Difference d;
  for (const Row* row : rows) {
    (row->trial.right == 1 ? d.answers.signals : d.answers.noises) += 1;
    if (row->answer.choice == 1) (row->trial.right == 1 ? d.answers.hits : d.answers.false_alarms) += 1;
  }
  const std::uint64_t n = d.answers.trials(), k = d.answers.correct();
  d.share = {static_cast<double>(k) / static_cast<double>(n), clopper_pearson(n, k)};
  d.p = difference_p(n, k);
  d.equivalence_p = equivalence_p(n, k, plan.power.equivalence);
  d.differencing = sensitivity(plan.task, Strategy::kDifferencing, d.answers);
  if (plan.task == Task::kAbx || plan.task == Task::kSameDifferent)
    d.independent = sensitivity(plan.task, Strategy::kIndependent, d.answers);
  return d;
}

Result<Threshold> threshold_of(const Plan& plan, const std::vector<const Row*>& rows) {
  Threshold t;
  t.levels = by_level(rows);
  const std::optional<PsychometricFit> fit = fit_psychometric(t.levels, plan.like(), plan.fitted_slope());
  if (!fit) return Error{"no trial is left at a level above 0", "ask for more trials", plan.name};
  t.fit = *fit;
  const std::uint64_t seed = seed_for(plan.seed, kBootstrapPurpose);
  if (plan.procedure == ProcedureKind::kPsi) {
    const std::unique_ptr<Adaptive> procedure = Course::new_procedure(plan);
    for (const Row* row : rows) procedure->answered(row->correct());
    t.jnd = *procedure->estimate();
    t.method = "mean of the posterior of log JND, and the 95 % that it holds (Kontsevich and Tyler)";
    t.procedure = Estimate{fit->function.jnd, {fit->function.jnd, fit->function.jnd}};
    t.procedure_says = fmt::format("maximum likelihood, slope {:g}", fit->function.slope);
    return t;
  }
  t.jnd.value = fit->function.jnd;
  if (plan.procedure == ProcedureKind::kFixed) {
    t.jnd.interval = bootstrap_jnd(t.levels, *fit, plan.fitted_slope(), seed);
    t.method = fmt::format("maximum likelihood; {} studies simulated from the fit, percentiles",
                           kPsychometricResamples);
    return t;
  }
  t.jnd = bootstrap_procedure([&] { return Course::new_procedure(plan); }, *fit, plan.fitted_slope(), seed);
  t.method = fmt::format(
      "maximum likelihood with slope {:g}, less its bias in {} staircases simulated from the fit; "
      "basic bootstrap",
      fit->function.slope, kPsychometricResamples);
  UpDown staircase(plan.up_down);
  for (const Row* row : rows) staircase.answered(row->correct());
  t.procedure = staircase.estimate();
  t.procedure_says =
      fmt::format("mean reversal: the level of {:.1f} % right answers", 100.0 * target_of(plan.up_down));
  return t;
}

void count_rows(const Plan& plan, const std::vector<Row>& rows, Analysis& found,
                std::vector<const Row*>& counted) {
  for (const Row& row : rows) {
    if (row.trial.kind == TrialKind::kPractice) {
      ++found.practice;
    } else if (!row.excluded.empty()) {
      ++found.excluded;
    } else if (row.trial.kind == TrialKind::kCatch) {
      ++found.catches;
      found.catches_right += row.correct() ? 1u : 0u;
    } else {
      ++found.main;
      counted.push_back(&row);
    }
  }
  const double share = found.catches == 0
                           ? 1.0
                           : static_cast<double>(found.catches_right) / static_cast<double>(found.catches);
  if (share < plan.exclusions.catch_share)
    found.participant_excluded =
        fmt::format("{} of {} catch trials right, and the plan asks for {:g} %", found.catches_right,
                    found.catches, 100.0 * plan.exclusions.catch_share);
}

}  // namespace

Result<Analysis> analyse(const Plan& plan, const std::vector<Row>& rows) {
  Analysis found;
  std::vector<const Row*> counted;
  count_rows(plan, rows, found, counted);
  if (counted.empty())
    return Error{"every trial was excluded by the plan's rule", "look at the column 'excluded' of trials.csv",
                 plan.name};
  if (plan.compares()) {
    found.difference = difference_of(plan, counted);
  } else {
    Result<Threshold> threshold = threshold_of(plan, counted);
    if (!threshold) return std::move(threshold).error();
    if (threshold->fit.at_edge)
      found.warnings.emplace_back(
          "The JND lies at the end of what the levels can tell: take levels nearer to it, and ask again.");
    found.threshold = *std::move(threshold);
  }
  if (!found.participant_excluded.empty())
    found.warnings.push_back(
        "By the plan's rule this participant counts for nothing: " + found.participant_excluded + ".");
  return found;
}

}  // namespace palpate::experiments::psychophysics
