#include "experiments/goals/goals.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/data/scans.h"
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

/// A run without its traces.
static void to_json(nlohmann::json& json, const GoalRuns& runs) {
  metrics::ResultDocument document;
  document.renderers = runs.results;
  json = {{"name", runs.name}, {"points", runs.points}, {"results", metrics::to_json(document)}};
}
static void from_json(const nlohmann::json& json, GoalRuns& runs) {
  Result<metrics::ResultDocument> document =
      metrics::parse_result(json.at("results").get<std::string>(), "a kept run");
  if (!document) throw nlohmann::json::other_error::create(0, document.error().what, nullptr);
  runs = {json.at("name").get<std::string>(), json.at("points").get<std::uint64_t>(),
          std::move(document->renderers)};
}

namespace {

/// Timed passes with quick and of a measurement.
constexpr std::uint64_t kQuickPasses = 2, kGoalPasses = 8;
constexpr double kQuickBudgetS = 0.5, kGoalBudgetS = 3.0;
constexpr double kGoalPrepareLimitS = 300.0;

}  // namespace

Result<Stage> goal_stage(const GoalBench& bench, const std::string& scene, const std::string& path,
                         ReferenceChoice reference) {
  Progress& progress = bench.suite.progress();
  PALPATE_ASSIGN(scene::SceneFile file, open_scene(scene, bench.registry, progress));
  StageRequest request;
  request.scene_name = scene;
  request.scene = std::move(file);
  request.path = path;
  request.reference = reference;
  request.threads = bench.threads;
  return set_up(request, all_readers(), progress);
}

Result<GoalRuns> goal_runs(const GoalBench& bench, const Stage& stage, const std::string& name,
                           const std::string& renderers) {
  PALPATE_ASSIGN(const std::vector<RendererRequest> requests, parse_renderers(renderers, bench.registry));
  RunOptions options;
  options.threads = bench.threads;
  options.passes = bench.quick ? kQuickPasses : kGoalPasses;
  options.budget_s = bench.quick ? kQuickBudgetS : kGoalBudgetS;
  options.prepare_limit_s = kGoalPrepareLimitS;
  metrics::MeasurementConditions conditions;
  PALPATE_ASSIGN(std::vector<Run> runs, run_renderers(stage, requests, bench.registry, options,
                                                      bench.suite.progress(), conditions, {}));
  GoalRuns out;
  out.name = name;
  for (const render::ModelInput& model : stage.scene.input.models) out.points += model.cloud->size();
  for (Run& run : runs) {
    out.results.push_back(std::move(run.result));
    out.traces.push_back(std::move(run.trace));
  }
  return out;
}

const metrics::RendererResult* ran(const GoalRuns& runs, const std::string& label) {
  for (const metrics::RendererResult& result : runs.results)
    if (result.label == label && result.status == metrics::RunStatus::kOk) return &result;
  return nullptr;
}

Result<std::vector<GoalRuns>> run_on_shapes(const GoalBench& bench) {
  const std::string points = bench.quick ? "4000" : "40000";
  const std::string path =
      fmt::format("weave:frames={}:depth_mm=1:period_frames=300", bench.quick ? 2000 : 20000);
  const std::string renderers =
      "cloud,cloud-smooth,mesh-godobject:mesh=advancing-front:label=" + std::string(kMeshLabel);
  struct Shape {
    const char* name;
    std::string scene;
  };
  const Shape shapes[] = {
      {"a ring, points at random", "torus:sampling=random:seed=11:points=" + points},
      {"a ring, 30 times as dense on one side", "torus:sampling=random:density=30:seed=12:points=" + points},
      {"a relief, points at random", "relief:sampling=random:seed=13:points=" + points},
      {"a ring, a tenth of a spacing of noise", "torus:sampling=random:noise=0.1:seed=14:points=" + points}};
  std::vector<GoalRuns> all;
  for (const Shape& shape : shapes) {
    bench.suite.progress().set_prefix(std::string(shape.name) + ": ");
    const auto measure = [&]() -> Result<GoalRuns> {
      PALPATE_ASSIGN(const Stage stage, goal_stage(bench, shape.scene, path, ReferenceChoice::kAuto));
      return goal_runs(bench, stage, shape.name, renderers);
    };
    PALPATE_ASSIGN(GoalRuns runs, bench.suite.once<GoalRuns>(fmt::format("model-{}", all.size() + 1),
                                                             shape.scene, measure, {{}, shape.scene}));
    all.push_back(std::move(runs));
  }
  return all;
}

Result<std::vector<GoalRuns>> run_by_size(const GoalBench& bench) {
  const std::string path = fmt::format("weave:frames={}:seed=1", bench.quick ? 2000 : 20000);
  // All sizes use one surface in a scanner's raster, from which the mesh takes no time to make.
  const std::string renderers =
      "cloud,cloud-smooth,mesh-godobject:mesh=organised:label=" + std::string(kMeshLabel);
  const std::vector<std::string> sizes = bench.quick ? std::vector<std::string>{"2601", "10201"}
                                                     : std::vector<std::string>{"10201", "101761", "1002001"};
  std::vector<GoalRuns> all;
  for (const std::string& points : sizes) {
    bench.suite.progress().set_prefix(points + " points: ");
    const std::string scene = "sinusoid:mesh=false:points=" + points;
    const auto measure = [&]() -> Result<GoalRuns> {
      PALPATE_ASSIGN(const Stage stage, goal_stage(bench, scene, path, ReferenceChoice::kNone));
      return goal_runs(bench, stage, format_count(stage.scene.input.models.front().cloud->size()) + " points",
                       renderers);
    };
    PALPATE_ASSIGN(GoalRuns runs,
                   bench.suite.once<GoalRuns>(points + "-points", scene, measure, {{}, scene}));
    all.push_back(std::move(runs));
  }
  return all;
}

std::string number_or_dash(const std::optional<double>& value) {
  return value ? format_number(*value) : std::string(kMissingNumber);
}

std::vector<Series> lines_of(const std::vector<std::string>& labels) {
  const std::vector<LineStyle> styles = line_styles_of(labels);
  std::vector<Series> lines;
  for (std::size_t i = 0; i < labels.size(); ++i)
    lines.push_back({labels[i], styles[i].colour, {}, {}, styles[i].dash});
  return lines;
}

Chart growth_chart(const std::string& name, const std::string& counted, const std::string& caption) {
  Chart chart;
  chart.name = name;
  chart.title = "Mean of all frames by number of " + counted;
  chart.caption = caption;
  chart.x_label = counted;
  chart.y_label = "mean of all frames, µs";
  chart.log_x = chart.log_y = true;
  chart.style = Chart::Style::kMarkedLines;
  chart.extra = "set offsets graph 0.03, graph 0.03, graph 0.1, graph 0.1\n";
  return chart;
}

Chart bar_chart(const std::string& name, const std::string& title, const std::string& x_label,
                const std::string& caption, const std::vector<Bar>& bars) {
  constexpr double kMargin = 0.6;
  constexpr int kBarHeight = 26, kAxisHeight = 80;
  Chart chart;
  chart.name = name;
  chart.title = title;
  chart.caption = caption;
  chart.x_label = x_label;
  chart.style = Chart::Style::kBars;
  chart.height = kAxisHeight + kBarHeight * static_cast<int>(bars.size());
  std::vector<std::string> labels;
  for (const Bar& bar : bars) labels.push_back(bar.label);
  chart.series = lines_of(labels);
  std::string tics;
  for (std::size_t i = 0; i < bars.size(); ++i) {
    const double row = -static_cast<double>(i);
    // gnuplot reads labels as number formats.
    std::string label = bars[i].label;
    for (std::size_t at = 0; (at = label.find('%', at)) != std::string::npos; at += 2) label.insert(at, "%");
    tics += fmt::format("{}'{}' {}", tics.empty() ? "" : ", ", label, row);
    chart.series[i].x = {bars[i].value};
    chart.series[i].y = {row};
  }
  chart.extra = fmt::format("set ytics ({})\nset yrange [{}:{}]\nset xrange [0:*]\nunset key\n", tics,
                            -static_cast<double>(bars.size()) + 1.0 - kMargin, kMargin);
  return chart;
}

}  // namespace palpate::experiments
