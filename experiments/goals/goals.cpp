#include "experiments/goals/goals.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/driver/suite.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

PALPATE_JSON_MEMBERS(Finding, about, value, unit, limit, at_most, limit_from, baseline)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Goal, id, title, words, method, findings, tables, figures, short_of, notes,
                                   picture)

namespace {

std::string with_unit(double value, const std::string& unit) {
  return format_number(value) + (unit.empty() ? "" : " " + unit);
}

std::string asked_text(const Finding& finding) {
  return (finding.at_most ? "at most " : "at least ") + with_unit(finding.limit, finding.unit);
}

std::string section_id(const Goal& goal) {
  return "goal-" + goal.id;
}

std::string goal_file(const Goal& goal) {
  return section_id(goal) + ".html";
}

const char* class_of(Verdict verdict) {
  return verdict == Verdict::kReached ? "reached" : verdict == Verdict::kInPart ? "part" : "missed";
}

std::string verdict_html(const Goal& goal) {
  const auto good = std::count_if(goal.findings.begin(), goal.findings.end(), kept);
  const Verdict verdict = verdict_of(goal);
  return fmt::format(
      "<p class=\"verdict {}\"><strong>{}</strong>: {} of {} numbers are as asked. The numbers decide, "
      "nobody else.</p>\n",
      class_of(verdict), name_of(verdict), good, goal.findings.size());
}

DocumentJson finding_json(const Finding& finding) {
  DocumentJson json = finding;
  json.erase("at_most");
  json["limit_is"] = finding.at_most ? "at most" : "at least";
  json["kept"] = kept(finding);
  return json;
}

Table findings_table(const Goal& goal) {
  Table table;
  table.title = "Measures that decide";
  table.columns = {"measured", "value", "asked", "because", "mesh"};
  for (const Finding& finding : goal.findings) {
    table.rows.push_back(
        {{finding.about},
         {finding.value ? with_unit(*finding.value, finding.unit) : "not measured", false, !kept(finding)},
         {asked_text(finding)},
         {finding.limit_from},
         {finding.baseline ? with_unit(*finding.baseline, finding.unit) : std::string(kMissingNumber)}});
  }
  table.bad_means = "is not as asked";
  return table;
}

/// Missed findings and other shortcomings.
std::vector<std::string> shortcomings(const Goal& goal) {
  std::vector<std::string> all;
  for (const Finding& finding : goal.findings)
    if (!kept(finding)) all.push_back(finding.about + ": " + text_of(finding));
  all.insert(all.end(), goal.short_of.begin(), goal.short_of.end());
  if (all.empty()) all.emplace_back("Nothing that was measured here.");
  return all;
}

Section section_of(const Goal& goal, const GoalsDocument& document) {
  Section section;
  section.id = section_id(goal);
  section.title = "Goal: " + goal.title;
  section.opening = verdict_html(goal) + goal.picture;
  for (const std::string& sentence : shortcomings(goal))
    section.found.push_back({section.found.empty() ? "Falls short" : "", sentence});
  section.paragraphs = document.warnings;
  section.paragraphs.push_back("Section 1.4 of the thesis asks for it; in our own words: " + goal.words);
  section.paragraphs.insert(section.paragraphs.end(), goal.method.begin(), goal.method.end());
  section.tables.push_back(findings_table(goal));
  section.tables.insert(section.tables.end(), goal.tables.begin(), goal.tables.end());
  section.figures = goal.figures;
  if (!goal.notes.empty()) section.facts.push_back({"notes", goal.notes});
  return section;
}

/// The first page, with a line and link per goal, and a page for each.
Page goals_page(const GoalsDocument& document) {
  Page page = begin_page("The goals of the thesis, measured", document.head);
  page.apart = true;
  page.tables = {goals_table(document)};
  add_known(page, Known{{}, document.warnings, document.notes});
  for (const Goal& goal : document.goals) page.sections.push_back(section_of(goal, document));
  return page;
}

}  // namespace

bool kept(const Finding& finding) {
  if (!finding.value) return false;
  return finding.at_most ? *finding.value <= finding.limit : *finding.value >= finding.limit;
}

const char* name_of(Verdict verdict) {
  constexpr const char* kNames[] = {"reached", "reached in part", "not reached", "not measured"};
  return kNames[static_cast<std::size_t>(verdict)];
}

Verdict verdict_of(const Goal& goal) {
  const std::vector<Finding>& all = goal.findings;
  if (all.empty() || std::any_of(all.begin(), all.end(), [](const Finding& f) { return !f.value; }))
    return Verdict::kNotMeasured;
  const auto good = std::count_if(all.begin(), all.end(), kept);
  if (good == static_cast<std::ptrdiff_t>(all.size())) return Verdict::kReached;
  return good > 0 ? Verdict::kInPart : Verdict::kMissed;
}

std::string text_of(const Finding& finding) {
  std::string text = finding.value ? with_unit(*finding.value, finding.unit) : std::string("not measured");
  text += fmt::format(" (asked: {}, {}", asked_text(finding), finding.limit_from);
  if (finding.baseline) text += "; mesh " + with_unit(*finding.baseline, finding.unit);
  return text + ")";
}

std::string to_json(const GoalsDocument& document) {
  DocumentJson json = begin_json(kGoalsSchema, document.head);
  json.update({{"quick", document.quick}, {"warnings", document.warnings}, {"notes", document.notes}});
  json["goals"] = DocumentJson::array();
  for (const Goal& goal : document.goals) {
    DocumentJson findings = DocumentJson::array();
    for (const Finding& finding : goal.findings) findings.push_back(finding_json(finding));
    json["goals"].push_back({{"id", goal.id},
                             {"title", goal.title},
                             {"thesis_section", "1.4"},
                             {"page", goal_file(goal)},
                             {"verdict", name_of(verdict_of(goal))},
                             {"findings", std::move(findings)},
                             {"falls_short", shortcomings(goal)},
                             {"notes", goal.notes}});
  }
  return document_text(json);
}

Table goals_table(const GoalsDocument& document) {
  Table table;
  table.title = "The goals of section 1.4";
  table.caption =
      "Section 1.4 of the thesis sets seven goals. Each has a page with what was measured in this run, "
      "beside the same on a mesh of the same points, and with what falls short. A goal is reached where "
      "every number that decides is as asked, reached in part where some are.";
  table.columns = {"goal", "verdict", "as asked", "first that is not"};
  for (const Goal& goal : document.goals) {
    const auto good = std::count_if(goal.findings.begin(), goal.findings.end(), kept);
    const auto first = std::find_if_not(goal.findings.begin(), goal.findings.end(), kept);
    table.rows.push_back({{goal.title, false, false, goal_file(goal)},
                          {name_of(verdict_of(goal)), false, verdict_of(goal) != Verdict::kReached},
                          {fmt::format("{} of {}", good, goal.findings.size())},
                          {first == goal.findings.end() ? std::string("all are kept")
                                                        : first->about + ": " + text_of(*first)}});
  }
  table.bad_means = "not reached as a whole";
  return table;
}

namespace {

constexpr const char* kGoalsFolder = "out/goals";

/// Runs shared by several pages; on failure these pages state missing numbers.
std::vector<GoalRuns> shared_runs(Result<std::vector<GoalRuns>> runs, const std::string& what,
                                  GoalsDocument& document) {
  if (runs) return *std::move(runs);
  document.warnings.push_back(fmt::format("{} could not be run: {}", what, runs.error().message()));
  return {};
}

/// A goal that no run of others serves: measured once, unless a number of it is missing.
Status add_goal(const GoalBench& bench, const std::string& id, Goal (*measure)(const GoalBench&),
                GoalsDocument& document) {
  Goal& goal = document.goals.emplace_back();
  if (bench.suite.take(id, id, goal) || !bench.suite.measures({id, {}, {}, id})) return Done{};
  bench.suite.folder().start_part();
  goal = measure(bench);
  return verdict_of(goal) == Verdict::kNotMeasured ? Status(Done{}) : bench.suite.keep(id, id, goal);
}

Status measure_goals(const GoalBench& bench, GoalsDocument& document) {
  ProgressBar& progress = bench.suite.progress();
  // Runs first, before the program starts other processes.
  const std::vector<GoalRuns> shapes = shared_runs(run_on_shapes(bench), "The models", document);
  const std::vector<GoalRuns> sizes = shared_runs(run_by_size(bench), "The sizes", document);
  progress.set_prefix("");
  const bool whole = !bench.suite.partial();
  if (whole) document.goals = {fidelity_goal(bench, shapes), no_mesh_goal(bench, shapes)};
  progress.set_prefix("one machine: ");
  PALPATE_TRY(add_goal(bench, "one-machine", one_machine_goal, document));
  progress.set_prefix("");
  if (whole) document.goals.push_back(worst_case_goal(bench, shapes, sizes));
  if (whole) document.goals.push_back(size_goal(bench, sizes));
  progress.set_prefix("the closed loop: ");
  PALPATE_TRY(add_goal(bench, "stable", stability_goal, document));
  PALPATE_TRY(add_goal(bench, "many-models", many_models_goal, document));
  progress.set_prefix("");
  return Done{};
}

}  // namespace

Result<int> run_goals(const GoalsArguments& arguments, Context& context) {
  Suite suite(context);
  PALPATE_TRY(suite.open(arguments.out.empty() ? kGoalsFolder : arguments.out));
  const render::Registry registry = all_renderers();
  PALPATE_TRY(suite.begin(RunKey()
                              .add("goals")
                              .add(std::uint64_t{arguments.quick})
                              .add(static_cast<std::uint64_t>(arguments.threads))));
  GoalsDocument document;
  document.head = new_head(context.command_line);
  document.quick = arguments.quick;
  if (arguments.quick)
    document.warnings.emplace_back(
        "A quick run: small models and short paths, a trial of the machinery. Its numbers are no "
        "measurement.");
  PALPATE_ASSIGN(const OutputFolder figures, suite.folder().inside("figures"));
  PALPATE_TRY(measure_goals({registry, suite, figures, arguments.quick, arguments.threads}, document));
  if (suite.partial()) return suite.leave();
  suite.progress().report("drawing the pages", -1.0);
  PALPATE_TRY(suite.publish({kGoalsFile, to_json(document), {goals_table(document)}, document.warnings},
                            goals_page(document), arguments.json));
  const bool all = std::none_of(document.goals.begin(), document.goals.end(),
                                [](const Goal& goal) { return verdict_of(goal) == Verdict::kNotMeasured; });
  return all ? kExitOk : kExitFellShort;
}

}  // namespace palpate::experiments
