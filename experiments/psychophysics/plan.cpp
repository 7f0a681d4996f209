#include "experiments/psychophysics/trials.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/run/arguments.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/scene/toml_fields.h"

namespace palpate::experiments::psychophysics {
namespace {

using scene::choice;
using scene::field;
using scene::Fields;
using scene::inner;
using scene::TomlFile;

constexpr std::size_t kLongestCode = 32;  // a participant's code is in every row
const std::vector<std::string> kOptionKinds = {"fixed", "up-down", "psi"};
// Options of scene and loop that no renderer names.
const std::vector<std::string> kSceneKeys = {"stiffness", "spacing", "noise", "rate"};

/// The plan's kind by its tables: "compare", or how levels are chosen.
Result<std::string> kind_of(const toml::table& root, const TomlFile& in_file) {
  const bool compares = root.contains("compare"), turns = root.contains("option");
  if (compares && turns)
    return in_file.at(*root.get("option"), "a plan has either [compare] or [option]",
                      "leave one of them away, and make two plans");
  if (compares) return std::string("compare");
  if (!turns)
    return in_file.at(
        root.source(), "a plan needs [compare] or [option]",
        "write [compare] with a and b, renderers, or [option] with renderer, key, unit and standard");
  const toml::node* procedure = root.at_path("trials.procedure").node();
  const std::string named = procedure == nullptr ? "fixed" : procedure->value_or(std::string());
  if (std::find(kOptionKinds.begin(), kOptionKinds.end(), named) == kOptionKinds.end())
    return in_file.at(*procedure, "there is no procedure " + shown(named),
                      did_you_mean(named, kOptionKinds, "choose from " + joined(kOptionKinds)));
  return named;
}

enum class Rule : std::uint8_t { kTwoDown, kThreeDown, kWeighted };

struct Reading {
  Plan plan;
  OptionUnderTest option;
  Rule rule = Rule::kTwoDown;
  double slope = 0.0;  ///< 0: not given
  double target = 0.75;
  std::uint64_t halved_after = 2, reversals = 12, discarded = 4;
};

Fields fields_of(Reading& r) {
  Plan& p = r.plan;
  constexpr NumberRange kShare{0.5, 1.0, true}, kOpen{0.0, 1.0, true}, kPositive{0.0, 1e12, true},
      kFactor{1.0, 100.0, true}, kSeconds{0.0, 60.0}, kInterval{0.5, 60.0}, kLapse{0.0, 0.2},
      kSlope{0.25, 8.0}, kAnswerS{0.0, 1e9};
  return {
      field("title", p.title),
      choice<Task>("task", p.task,
                   {{"abx", Task::kAbx},
                    {"same-different", Task::kSameDifferent},
                    {"2ifc", Task::kTwoInterval},
                    {"yes-no", Task::kYesNo}})
          .must("task = \"abx\""),
      field("scene", p.scene).must("scene = \"sinusoid:points=10201\""),
      field("participant", p.participant),
      field("seed", p.seed),
      inner("compare", {field("a", p.a).must(), field("b", p.b).must()}).of({"compare"}),
      inner("option",
            {field("renderer", r.option.renderer).must(), field("key", r.option.key).must(),
             field("unit", r.option.unit).must(), field("standard", r.option.standard, kPositive).must(),
             choice<bool>("direction", r.option.upwards, {{"up", true}, {"down", false}})})
          .of(kOptionKinds),
      inner("trials",
            {choice<ProcedureKind>("procedure", p.procedure,
                                   {{"fixed", ProcedureKind::kFixed},
                                    {"up-down", ProcedureKind::kUpDown},
                                    {"psi", ProcedureKind::kPsi}}),
             field("count", p.count), field("levels", p.levels), field("practice", p.practice),
             field("catch_every", p.catch_every), field("catch_level", p.catch_level, kPositive),
             field("break_every", p.break_every), field("switch_delay_s", p.switch_delay_s, kSeconds),
             field("interval_s", p.interval_s, kInterval)})
          .must("[trials] with count = 80"),
      inner("up_down", {choice<Rule>("rule", r.rule,
                                     {{"1up-2down", Rule::kTwoDown},
                                      {"1up-3down", Rule::kThreeDown},
                                      {"weighted", Rule::kWeighted}}),
                        field("target", r.target, kShare), field("start", p.up_down.start, kPositive).must(),
                        field("factor", p.up_down.factor, kFactor), field("halved_after", r.halved_after),
                        field("reversals", r.reversals), field("discarded", r.discarded),
                        field("most_trials", p.up_down.most_trials)})
          .of({"up-down"}),
      inner("psi", {field("low", p.psi.low, kPositive).must(), field("high", p.psi.high, kPositive).must(),
                    field("trials", p.psi.trials).must()})
          .of({"psi"}),
      inner("fit",
            {choice<Shape>("function", p.shape, {{"dprime", Shape::kDprime}, {"weibull", Shape::kWeibull}}),
             field("slope", r.slope, kSlope), field("lapse", p.lapse, kLapse)})
          .of(kOptionKinds),
      inner("power",
            {field("wanted", p.power.wanted, kOpen), field("alpha", p.power.alpha, kOpen),
             field("detect", p.power.detect, kShare), field("equivalence", p.power.equivalence, kShare)}),
      inner("exclusions", {field("missed_deadlines", p.exclusions.missed_deadlines),
                           field("clipped_frames", p.exclusions.clipped_frames),
                           field("fastest_s", p.exclusions.fastest_s, kAnswerS),
                           field("slowest_s", p.exclusions.slowest_s, kAnswerS),
                           field("catch_share", p.exclusions.catch_share, NumberRange{0.0, 1.0})})};
}

/// Reports errors at a key of the file, or at the table that lacks it.
class Checking {
 public:
  Checking(const toml::table& root, const TomlFile& in_file) : root_(root), in_file_(in_file) {}
  [[nodiscard]] Error at(const char* path, std::string what, std::string remedy) const {
    const toml::node* node = root_.at_path(path).node();
    std::string table(path);
    if (node == nullptr && table.find('.') != std::string::npos)
      node = root_.get(table.substr(0, table.find('.')));
    return node != nullptr ? in_file_.at(*node, std::move(what), std::move(remedy))
                           : in_file_.at(root_.source(), std::move(what), std::move(remedy));
  }

 private:
  const toml::table& root_;
  const TomlFile& in_file_;
};

Status check_renderers(const Plan& p, const Checking& check, const render::Registry& registry) {
  const auto good = [&](const char* path, const std::string& text) -> Status {
    const auto parsed = parse_renderers(text, registry);
    if (!parsed) return check.at(path, parsed.error().what, parsed.error().remedy);
    if (parsed->size() != 1)
      return check.at(path, "one renderer stands here", "name one: NAME[:option=value...]");
    return Done{};
  };
  if (p.compares()) {
    PALPATE_TRY(good("compare.a", p.a));
    PALPATE_TRY(good("compare.b", p.b));
    if (p.a == p.b) return check.at("compare.b", "both renderers are the same", "name two that differ");
    return Done{};
  }
  PALPATE_TRY(good("option.renderer", p.option->renderer));
  const std::string& key = p.option->key;
  if (std::find(kSceneKeys.begin(), kSceneKeys.end(), key) != kSceneKeys.end()) return Done{};
  const auto request = parse_renderers(p.option->renderer, registry);
  std::vector<std::string> known = kSceneKeys;
  for (const OptionSpec& spec : registry.find(request->front().name)->options) {
    if (spec.kind != OptionKind::kNumber && spec.kind != OptionKind::kInteger) continue;
    if (spec.key == key) return Done{};
    known.push_back(spec.key);
  }
  return check.at("option.key", fmt::format("{} is no number that can be turned", shown(key)),
                  did_you_mean(key, known, "choose from " + joined(known)));
}

Status check_levels(const Plan& p, const Checking& check) {
  if (p.levels.empty())
    return check.at("trials.levels", "fixed trials of an option need 'levels'",
                    "write levels = [..], differences from the standard");
  for (std::size_t i = 0; i < p.levels.size(); ++i)
    if (!(p.levels[i] > (i > 0 ? p.levels[i - 1] : 0.0)) || !(p.levels[i] < 1e12))
      return check.at("trials.levels", "the levels do not rise from above 0",
                      "give differences from the standard, the smallest first");
  if (!p.option->upwards && p.levels.back() > p.option->standard)
    return check.at("trials.levels", "a level goes below nothing", "keep differences within the standard");
  return Done{};
}

Status check_counts(const Plan& p, const Checking& check) {
  const bool fixed = p.procedure == ProcedureKind::kFixed;
  const std::size_t levels = p.compares() ? 1 : p.levels.size();
  if (!fixed && p.count > 0)
    return check.at("trials.count", "the procedure decides how many trials there are",
                    "leave count away; [up_down] has most_trials, [psi] has trials");
  if (!fixed && !p.levels.empty())
    return check.at("trials.levels", "the procedure chooses the levels", "leave levels away");
  if (fixed && (p.count == 0 || p.count % p.cells() != 0 || p.count > kMostTrials / levels))
    return check.at(
        "trials.count",
        fmt::format("'count' must be a multiple of {}, so that every order is shown equally often, "
                    "and {} trials in all at most",
                    p.cells(), kMostTrials),
        fmt::format("write count = {}", 20 * p.cells()));
  if (p.practice > kMostTrials || p.up_down.most_trials > kMostTrials || p.psi.trials > kMostTrials)
    return check.at("trials", fmt::format("nobody sits through over {} trials", kMostTrials),
                    "ask for fewer");
  return Done{};
}

Status check_procedure(Reading& r, const Checking& check) {
  Plan& p = r.plan;
  if (p.option && p.task != Task::kTwoInterval && p.task != Task::kAbx)
    return check.at("task",
                    fmt::format("a JND needs a task whose guesses are right half the time, and {} is none",
                                name_of(p.task)),
                    "write task = \"2ifc\" or task = \"abx\"");
  if (p.compares() && p.procedure != ProcedureKind::kFixed)
    return check.at("trials.procedure", "two renderers have no levels to choose from",
                    "leave procedure away, or turn an option with [option]");
  if (p.option && p.procedure == ProcedureKind::kFixed) PALPATE_TRY(check_levels(p, check));
  if (p.procedure == ProcedureKind::kUpDown) {
    constexpr std::uint64_t kMostReversals = 1000;
    if (r.reversals > kMostReversals || r.reversals < r.discarded + 2)
      return check.at("up_down.reversals",
                      "too few reversals are left for an estimate, or over 1000 asked for",
                      "ask for at least two more than are discarded");
    p.up_down.down = r.rule == Rule::kThreeDown ? 3 : 2;
    p.up_down.target = r.rule == Rule::kWeighted ? r.target : 0.0;
    p.up_down.halved_after = static_cast<int>(std::min(r.halved_after, kMostReversals));
    p.up_down.reversals = static_cast<int>(r.reversals);
    p.up_down.discarded = static_cast<int>(r.discarded);
    if (!p.option->upwards) p.up_down.high = p.option->standard;
  }
  if (p.procedure == ProcedureKind::kPsi) {
    if (!(p.psi.low < p.psi.high) || p.psi.trials == 0)
      return check.at("psi", "'low' must be below 'high', and 'trials' above 0", "widen the range");
    if (!p.option->upwards && p.psi.high > p.option->standard)
      return check.at("psi.high", "a level goes below nothing", "keep differences within the standard");
    p.psi.like = p.like();
  }
  return check_counts(p, check);
}

Status check_participant(const Plan& p, const Checking& check) {
  if (is_participant_code(p.participant)) return Done{};
  return check.at("participant", "a participant is a code of at most 32 letters, digits, - and _",
                  "write a code that says nothing of the person, such as P01");
}

}  // namespace

const char* name_of(ProcedureKind kind) noexcept {
  return kind == ProcedureKind::kFixed ? "fixed" : kind == ProcedureKind::kUpDown ? "up-down" : "psi";
}

bool is_participant_code(std::string_view code) noexcept {
  const auto fits = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
  };
  return !code.empty() && code.size() <= kLongestCode && std::all_of(code.begin(), code.end(), fits);
}

Result<Plan> parse_plan(std::string_view text, const std::string& name, const render::Registry& registry) {
  try {
    const toml::table root = toml::parse(text, name);
    const TomlFile in_file{name};
    const Checking check(root, in_file);
    PALPATE_ASSIGN(const std::string kind, kind_of(root, in_file));
    Reading r;
    r.plan.name = name;
    r.plan.text = text;
    PALPATE_TRY(scene::read_fields(root, fields_of(r), "a plan", kind, in_file));
    Plan& p = r.plan;
    if (kind != "compare") p.option = r.option;
    if (r.slope > 0.0) p.slope = r.slope;
    for (const auto& [needed, table] :
         {std::pair{ProcedureKind::kUpDown, "up_down"}, {ProcedureKind::kPsi, "psi"}})
      if (p.procedure == needed && !root.contains(table))
        return check.at("trials.procedure", fmt::format("this procedure needs [{}]", table),
                        needed == ProcedureKind::kPsi ? "write [psi] with low, high and trials"
                                                      : "write [up_down] with start");
    PALPATE_TRY(check_renderers(p, check, registry));
    PALPATE_TRY(check_participant(p, check));
    PALPATE_TRY(check_procedure(r, check));
    if (!(p.exclusions.fastest_s < p.exclusions.slowest_s))
      return check.at("exclusions.fastest_s", "every answer would be excluded",
                      "lower it, or raise slowest_s");
    if (p.title.empty()) p.title = p.compares() ? p.a + " against " + p.b : p.option->key;
    return p;
  } catch (const toml::parse_error& error) {
    return Error{std::string(error.description()), "a plan is TOML", name,
                 static_cast<std::int64_t>(error.source().begin.line)};
  }
}

Result<PlanText> read_plan(const std::string& file_or_example) {
  if (!file_or_example.ends_with(".toml")) {
    for (const PlanText& example : example_plans())
      if (example.name == file_or_example) return example;
    return Error{"there is no example " + shown(file_or_example),
                 did_you_mean(file_or_example, names_of(example_plans()),
                              "name a plan (.toml), or choose from " + joined(names_of(example_plans())))};
  }
  PALPATE_ASSIGN(std::string text, read_file(file_or_example, kMostPlanBytes));
  return PlanText{file_or_example, std::move(text)};
}

namespace {

// Built-in plans: `palpate study abx` runs one, --save-plan writes it for editing.

constexpr const char* kAbxPlan = R"(# Are two renderers told apart? A, B, then X: which of them is X?
title = "cloud against cloud-smooth, ABX"
task = "abx"
scene = "sinusoid:points=10201"
seed = 20260401

[compare]
a = "cloud"
b = "cloud-smooth"

[trials]
count = 80          # a multiple of 4: every order equally often
practice = 4
catch_every = 10    # one in ten that nobody misses
break_every = 40
switch_delay_s = 0.5   # of every switch, sham or not

[power]
detect = 0.65       # a difference heard in 65 % of trials is to be found
equivalence = 0.65  # and its absence shown

[exclusions]        # registered before the first trial
missed_deadlines = 0
clipped_frames = 0
fastest_s = 0.2
slowest_s = 30.0
catch_share = 0.75
)";

constexpr const char* kSameDifferentPlan = R"(# Two touches: the same or different?
title = "cloud against a mesh, same or different"
task = "same-different"
scene = "sinusoid:points=10201"
seed = 20260402

[compare]
a = "cloud"
b = "mesh-godobject"

[trials]
count = 120
practice = 4
)";

constexpr const char* kConstantPlan = R"(# Differences chosen beforehand: the whole psychometric function.
title = "stiffness, five differences"
task = "2ifc"
scene = "sinusoid:points=10201"
seed = 20260403

[option]
renderer = "cloud"
key = "stiffness"
unit = "N/mm"
standard = 0.5
direction = "up"

[trials]
procedure = "fixed"
count = 40                                    # at each difference
levels = [0.02, 0.035, 0.05, 0.075, 0.11]     # N/mm above the standard
practice = 4
catch_every = 20
catch_level = 0.5

[fit]
function = "dprime"
lapse = 0.0
)";

constexpr const char* kStaircasePlan = R"(# One up, two down: the difference that is felt in 71 of 100 trials.
title = "stiffness, staircase"
task = "2ifc"
scene = "sinusoid:points=10201"
seed = 20260404

[option]
renderer = "cloud"
key = "stiffness"
unit = "N/mm"
standard = 0.5

[trials]
procedure = "up-down"
practice = 4

[up_down]
rule = "1up-2down"
start = 0.2
factor = 1.5
reversals = 14
discarded = 4
)";

constexpr const char* kPsiPlan = R"(# The Psi method: each difference is the one that tells most.
title = "stiffness, Psi"
task = "2ifc"
scene = "sinusoid:points=10201"
seed = 20260405

[option]
renderer = "cloud"
key = "stiffness"
unit = "N/mm"
standard = 0.5

[trials]
procedure = "psi"
practice = 4

[psi]
low = 0.005
high = 0.5
trials = 60
)";

}  // namespace

const std::vector<PlanText>& example_plans() {
  static const std::vector<PlanText> kPlans = {{"abx", kAbxPlan},
                                               {"same-different", kSameDifferentPlan},
                                               {"constant", kConstantPlan},
                                               {"staircase", kStaircasePlan},
                                               {"psi", kPsiPlan}};
  return kPlans;
}

}  // namespace palpate::experiments::psychophysics
