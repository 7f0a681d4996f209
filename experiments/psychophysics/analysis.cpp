#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "experiments/driver/json_document.h"
#include "experiments/psychophysics/blinded.h"
#include "experiments/psychophysics/rig.h"

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

namespace {

DocumentJson needed_json(const std::optional<Needed>& needed) {
  if (!needed) return nullptr;
  return {{"first", needed->first}, {"safe", needed->safe}};
}

DocumentJson interval_json(const Interval& interval) {
  return DocumentJson::array({interval.low, interval.high});
}

DocumentJson estimate_json(const Estimate& estimate) {
  return {{"value", estimate.value}, {"interval", interval_json(estimate.interval)}};
}

DocumentJson sensitivity_json(const std::optional<Sensitivity>& found) {
  if (!found) return nullptr;
  DocumentJson json = {{"value", found->dprime.value}};
  json["interval"] = found->has_interval ? interval_json(found->dprime.interval) : DocumentJson(nullptr);
  json["criterion"] = found->criterion;
  return json;
}

DocumentJson procedure_json(const Plan& p) {
  DocumentJson json = {{"kind", name_of(p.procedure)}};
  if (p.procedure == ProcedureKind::kFixed) json["count"] = p.count, json["levels"] = p.levels;
  if (p.procedure == ProcedureKind::kUpDown)
    json.update({{"target", target_of(p.up_down)},
                 {"start", p.up_down.start},
                 {"factor", p.up_down.factor},
                 {"halved_after", p.up_down.halved_after},
                 {"reversals", p.up_down.reversals},
                 {"discarded", p.up_down.discarded},
                 {"most_trials", p.up_down.most_trials}});
  if (p.procedure == ProcedureKind::kPsi)
    json.update({{"low", p.psi.low}, {"high", p.psi.high}, {"trials", p.psi.trials}});
  return json;
}

DocumentJson design_json(const Plan& p) {
  DocumentJson json = {{"task", name_of(p.task)}, {"scene", p.scene}};
  if (p.compares()) {
    json["compare"] = {{"A", p.a}, {"B", p.b}};
    json["option"] = nullptr;
  } else {
    json["compare"] = nullptr;
    json["option"] = {{"renderer", p.option->renderer},
                      {"key", p.option->key},
                      {"unit", p.option->unit},
                      {"standard", p.option->standard},
                      {"direction", p.option->upwards ? "up" : "down"}};
  }
  json["procedure"] = procedure_json(p);
  json["seed"] = p.seed;
  json["practice"] = p.practice;
  json["catch_every"] = p.catch_every;
  json["break_every"] = p.break_every;
  json["switch_delay_s"] = p.switch_delay_s;
  json["interval_s"] = p.interval_s;
  json["power"] = {
      {"wanted", p.power.wanted},
      {"alpha", p.power.alpha},
      {"detect", p.power.detect},
      {"trials_to_detect", needed_json(trials_for_difference(p.power.detect, p.power.wanted, p.power.alpha))},
      {"equivalence", p.power.equivalence},
      {"trials_for_equivalence",
       needed_json(trials_for_equivalence(p.power.equivalence, p.power.wanted, p.power.alpha))}};
  json["exclusions"] = {{"missed_deadlines", p.exclusions.missed_deadlines},
                        {"clipped_frames", p.exclusions.clipped_frames},
                        {"fastest_s", p.exclusions.fastest_s},
                        {"slowest_s", p.exclusions.slowest_s},
                        {"catch_share", p.exclusions.catch_share}};
  return json;
}

DocumentJson difference_json(const Difference& d, const Plan& p) {
  return {{"correct", d.answers.correct()},
          {"trials", d.answers.trials()},
          {"hits", d.answers.hits},
          {"signals", d.answers.signals},
          {"false_alarms", d.answers.false_alarms},
          {"noises", d.answers.noises},
          {"share", estimate_json(d.share)},
          {"p_by_chance", d.p},
          {"dprime_differencing", sensitivity_json(d.differencing)},
          {"dprime_independent", sensitivity_json(d.independent)},
          {"equivalence", {{"bound", p.power.equivalence}, {"p", d.equivalence_p}}}};
}

DocumentJson threshold_json(const Threshold& t, const Plan& p) {
  DocumentJson json = {{"function", name_of(t.fit.function.shape)},
                       {"slope", t.fit.function.slope},
                       {"slope_fitted", !p.fitted_slope().has_value()},
                       {"lapse", t.fit.function.lapse},
                       {"log_likelihood", t.fit.log_likelihood},
                       {"deviance", t.fit.deviance},
                       {"weber_fraction", t.jnd.value / p.option->standard},
                       {"at_edge", t.fit.at_edge}};
  json["procedure"] = t.procedure ? estimate_json(*t.procedure) : DocumentJson(nullptr);
  json["procedure_says"] = t.procedure_says;
  json["levels"] = DocumentJson::array();
  for (const LevelAnswers& one : t.levels)
    json["levels"].push_back({{"level", one.level}, {"correct", one.correct}, {"trials", one.trials}});
  return json;
}

}  // namespace

std::string to_json(const ObservedDocument& document) {
  const Plan& p = document.plan;
  const Analysis& a = document.analysis;
  DocumentJson json = begin_json(kObservedSchema, document.head);
  json["title"] = p.title;
  json["plan"] = kPlanFile;
  json["participant"] = p.participant;
  json["observer"] = document.observer.text;
  json["simulated"] = document.observer.kind == ObserverKind::kSimulated;
  json["device"] = text_or_null(document.device);
  json["traces"] = document.device.empty() ? DocumentJson(nullptr) : DocumentJson(kTracesFolder);
  json["design"] = design_json(p);
  if (a.difference) {
    const Difference& d = *a.difference;
    json["estimate"] = {
        {"name", "dprime"},
        {"unit", "1"},
        {"value", d.differencing ? DocumentJson(d.differencing->dprime.value) : DocumentJson(nullptr)},
        {"method", p.task == Task::kAbx || p.task == Task::kSameDifferent ? "differencing model"
                                                                          : "unit normal sensations"}};
    json["interval"] =
        d.differencing ? interval_json(d.differencing->dprime.interval) : DocumentJson(nullptr);
  } else {
    json["estimate"] = {{"name", "jnd"},
                        {"unit", p.option->unit},
                        {"value", a.threshold->jnd.value},
                        {"method", a.threshold->method}};
    json["interval"] = interval_json(a.threshold->jnd.interval);
  }
  json["difference"] = a.difference ? difference_json(*a.difference, p) : DocumentJson(nullptr);
  json["threshold"] = a.threshold ? threshold_json(*a.threshold, p) : DocumentJson(nullptr);
  json["trials"] = {{"file", kTrialsFile},    {"rows", document.rows.size()},
                    {"main", a.main},         {"practice", a.practice},
                    {"catch", a.catches},     {"catch_right", a.catches_right},
                    {"excluded", a.excluded}, {"columns", DocumentJson::array()}};
  for (const Column& column : trial_columns())
    json["trials"]["columns"].push_back(
        {{"name", column.name}, {"unit", column.unit}, {"meaning", column.meaning}});
  json["sessions"] = DocumentJson::array();
  for (const SessionRecord& one : document.sessions)
    json["sessions"].push_back(DocumentJson::parse(session_line(one)));
  json["participant_excluded"] = a.participant_excluded;
  json["warnings"] = a.warnings;
  json["notes"] = document.notes;
  return document_text(json);
}

}  // namespace palpate::experiments::psychophysics
