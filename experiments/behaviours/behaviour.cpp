#include "experiments/behaviours/behaviour.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <palpate/accuracy.h>
#include <palpate/generate.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "toolkit/core/tolerances.h"

namespace palpate::experiments {

BehaviourOutcome observe(const Behaviour& behaviour, const RendererRequest& request,
                         const render::Registry& registry, int threads, Progress& progress) {
  BehaviourOutcome outcome;
  std::vector<std::unique_ptr<render::HapticRenderer>> renderers;
  for (const BehaviourScene& scene : behaviour.scenes) {
    auto made = registry.make(request.name, request.options);
    if (!made) {
      outcome.failure = made.error().what;
      return outcome;
    }
    progress.report(behaviour.id + ": preparing " + request.label, -1.0);
    if (const Result<render::PrepareReport> ready = (*made)->prepare(scene.input, {threads, &progress});
        !ready) {
      outcome.failure = ready.error().what;
      return outcome;
    }
    renderers.push_back(*std::move(made));
  }
  for (std::size_t k = 0; k < behaviour.strokes.size(); ++k) {
    const Stroke& stroke = behaviour.strokes[k];
    Result<trace::ForceTrace> felt = trace::replay(*renderers[stroke.scene], stroke.path,
                                                   behaviour.scenes[stroke.scene].input.simulation.get());
    if (!felt) {
      outcome.failure = felt.error().what;
      return outcome;
    }
    const std::vector<render::Frame>& frames = felt->frames;
    outcome.wrong += behaviour.judge(stroke, frames);
    outcome.of += behaviour.whole(stroke);
    if (k != behaviour.shown) continue;
    for (const render::Frame& frame : frames) outcome.shown.push_back(behaviour.y(frame));
  }
  return outcome;
}

namespace {

constexpr double kRateHz = 1000.0;
constexpr double kFloorN = kBehaviourStiffness * metrics::kOmniResolutionMm;

BehaviourScene with_model(render::ModelInput model,
                          std::shared_ptr<const geometry::AnalyticSurface> surface) {
  model.surface.stiffness_n_per_mm = kBehaviourStiffness;
  BehaviourScene scene;
  scene.input.models.push_back(std::move(model));
  scene.surface = std::move(surface);
  return scene;
}

}  // namespace

Result<BehaviourScene> generated_scene(const std::string& generator) {
  PALPATE_ASSIGN(const NamedOptions spec, parse_named_options(generator));
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(spec));
  render::ModelInput model;
  model.name = generator;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  model.original_mesh = made.original_mesh;
  model.analytic = made.surface;
  return with_model(std::move(model), made.surface);
}

Result<BehaviourScene> scene_of_points(const std::vector<Vec3>& points, std::string name,
                                       std::shared_ptr<const geometry::AnalyticSurface> surface) {
  Result<cloud::Cloud> cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  if (!cloud) return std::move(cloud).error();
  render::ModelInput model;
  model.name = std::move(name);
  model.cloud = std::make_shared<const cloud::Cloud>(*std::move(cloud));
  model.analytic = surface;
  return with_model(std::move(model), std::move(surface));
}

Result<Stroke> stroke_along(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                            trace::ProbePath path) {
  PALPATE_ASSIGN(trace::ReferenceTrace truth,
                 metrics::analytic_reference(*scenes[scene].surface, path, kBehaviourStiffness, 0.0, {}, {}));
  Stroke made{scene, std::move(path), std::move(truth)};
  const auto first = std::find_if(made.truth.frames.begin(), made.truth.frames.end(),
                                  [](const trace::TruthFrame& t) { return t.frame.contact; });
  if (first != made.truth.frames.end()) made.entry = first->normal;
  return made;
}

Result<Stroke> stroke(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                      const std::vector<Vec3>& corners, double speed_mm_s) {
  trace::ProbePath path;
  path.name = "straight ways";
  const double step_mm = speed_mm_s / kRateHz;
  double left_mm = 0.0;  // remainder of the last step, beyond the previous corner
  for (std::size_t c = 0; c + 1 < corners.size(); ++c) {
    const Vec3 way = corners[c + 1] - corners[c];
    const double length = way.norm();
    for (; left_mm < length; left_mm += step_mm) {
      path.t_s.push_back(static_cast<double>(path.t_s.size()) / kRateHz);
      path.hip_mm.emplace_back(corners[c] + way * (left_mm / length));
    }
    left_mm -= length;
  }
  path.t_s.push_back(static_cast<double>(path.t_s.size()) / kRateHz);
  path.hip_mm.push_back(corners.back());
  return stroke_along(scenes, scene, std::move(path));
}

double scattered(std::size_t i, double low, double high) noexcept {
  const double turns = static_cast<double>(i + 1) * (std::numbers::phi - 1.0);
  return low + (high - low) * (turns - std::floor(turns));
}

bool out_of_band(const render::Frame& frame, const trace::TruthFrame& truth) noexcept {
  const double allowed = std::max(kForceJnd * truth.frame.force_n.norm(), kFloorN);
  return (frame.force_n - truth.frame.force_n).norm() > allowed;
}

bool turned_by(const render::Frame& frame, const trace::TruthFrame& truth, double deg) noexcept {
  const double sizes = frame.force_n.norm() * truth.frame.force_n.norm();
  return !(frame.force_n.dot(truth.frame.force_n) >= sizes * std::cos(deg * std::numbers::pi / 180.0)) ||
         !(sizes > 0.0);
}

std::uint64_t contact_frames(const Stroke& stroke) noexcept {
  return static_cast<std::uint64_t>(std::count_if(stroke.truth.frames.begin(), stroke.truth.frames.end(),
                                                  [](const auto& t) { return t.frame.contact; }));
}

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(BehaviourOutcome, failure, wrong, of, shown)

namespace {

/// Share of faults beyond which a renderer falls short; one push or crossing always exceeds it.
constexpr double kFallsShort = 0.01;
constexpr std::size_t kPictureSamples = 700;  // a panel is some 250 wide

std::string cell_text(const BehaviourOutcome& outcome) {
  if (!outcome.failure.empty()) return kMissingNumber;
  return fmt::format("{} of {}", format_count(outcome.wrong), format_count(outcome.of));
}

std::uint64_t whole_of(const Behaviour& behaviour) {
  std::uint64_t whole = 0;
  for (const Stroke& stroke : behaviour.strokes) whole += behaviour.whole(stroke);
  return whole;
}

bool falls_short(const BehaviourOutcome& outcome) {
  return outcome.failure.empty() &&
         static_cast<double>(outcome.wrong) > kFallsShort * static_cast<double>(outcome.of);
}

Series thinned(const Behaviour& behaviour, std::string label, std::string colour,
               const std::function<double(std::size_t)>& y, std::size_t count) {
  Series s{std::move(label), std::move(colour), {}, {}};
  const std::size_t every = std::max<std::size_t>(1, count / kPictureSamples);
  for (std::size_t i = 0; i < count; i += every) {
    s.x.push_back(behaviour.x(behaviour.strokes[behaviour.shown], i));
    s.y.push_back(y(i));
  }
  return s;
}

Chart picture(const BehaviourMatrix& matrix, std::size_t b) {
  const Behaviour& behaviour = matrix.behaviours[b];
  const Stroke& shown = behaviour.strokes[behaviour.shown];
  Chart chart;
  chart.name = "behaviour-" + behaviour.id;
  chart.title = behaviour.title;
  chart.caption = fmt::format("{}, {}; grey is the truth. Under each name: {}.", behaviour.y_label,
                              behaviour.x_label, behaviour.counted);
  chart.x_label = behaviour.x_label;
  chart.y_label = behaviour.y_label;
  chart.style = Chart::Style::kPanels;
  chart.wide = true;
  chart.series.push_back(thinned(
      behaviour, "truth", "#c4c4c4", [&](std::size_t i) { return behaviour.y(shown.truth.frames[i].frame); },
      shown.truth.frames.size()));
  for (std::size_t r = 0; r < matrix.outcomes.size(); ++r) {
    if (b >= matrix.outcomes[r].size()) continue;
    const BehaviourOutcome& outcome = matrix.outcomes[r][b];
    if (!outcome.failure.empty()) continue;
    const std::string& label = matrix.renderers[r].label;
    chart.series.push_back(thinned(
        behaviour, fmt::format("{}: {}", label, cell_text(outcome)),
        falls_short(outcome) ? "#d55e00" : "#0072b2", [&](std::size_t i) { return outcome.shown[i]; },
        outcome.shown.size()));
  }
  return chart;
}

std::vector<Headline> headlines_of(const BehaviourMatrix& matrix) {
  std::vector<Headline> lines;
  for (std::size_t r = 0; r < matrix.outcomes.size(); ++r) {
    std::size_t ran = 0, right = 0;
    std::string where;
    for (std::size_t b = 0; b < matrix.outcomes[r].size(); ++b) {
      const BehaviourOutcome& outcome = matrix.outcomes[r][b];
      if (!outcome.failure.empty()) continue;
      ++ran;
      if (!falls_short(outcome))
        ++right;
      else
        where += (where.empty() ? "; falls short: " : ", ") + matrix.behaviours[b].title;
    }
    lines.push_back({matrix.renderers[r].label, fmt::format("right on {} of {}{}", right, ran, where)});
  }
  return lines;
}

/// A row per renderer with its role, a column per behaviour: "wrong of all".
Table matrix_table(const BehaviourMatrix& matrix) {
  Table table;
  table.title = "Behaviour: what goes wrong, counted";
  table.caption =
      "Each column's count is explained with its picture in the report. A dash: the renderer does not take "
      "the "
      "scene.";
  table.best_means = "nothing went wrong";
  table.bad_means = "more than 1 % of what there is";
  table.columns = {"renderer", "role"};
  for (const Behaviour& behaviour : matrix.behaviours)
    table.columns.push_back(fmt::format("{}, of {}", behaviour.title, format_count(whole_of(behaviour))));
  for (std::size_t r = 0; r < matrix.outcomes.size(); ++r) {
    std::vector<Cell> row = {{matrix.renderers[r].label, false, false},
                             {std::string(name_of(matrix.roles[r])), false, false}};
    for (const BehaviourOutcome& outcome : matrix.outcomes[r])
      row.push_back({outcome.failure.empty() ? format_count(outcome.wrong) : kMissingNumber,
                     outcome.failure.empty() && outcome.wrong == 0, falls_short(outcome)});
    row.resize(table.columns.size(), {kMissingNumber, false, false});
    table.rows.push_back(std::move(row));
  }
  return table;
}

}  // namespace

std::vector<RendererRequest> methods_of(const render::Registry& registry) {
  std::vector<RendererRequest> requests;
  for (const render::RendererInfo& info : registry.all()) {
    if (info.geometry == render::Geometry::kFormula || info.geometry == render::Geometry::kImages ||
        info.role == render::Role::kOracle)
      continue;
    RendererRequest request{info.name, info.name, {}, {}};
    // The mesh is reconstructed from the points, not the generator's own.
    for (const OptionSpec& spec : info.options)
      if (spec.key == "mesh") request.options.set("mesh", "advancing-front");
    requests.push_back(std::move(request));
  }
  return requests;
}

Result<BehaviourMatrix> run_behaviours(std::vector<Behaviour> behaviours,
                                       std::vector<RendererRequest> renderers,
                                       const render::Registry& registry, int threads, Progress& progress,
                                       const Suite* suite) {
  BehaviourMatrix matrix{std::move(behaviours), std::move(renderers), {}, {}};
  for (const RendererRequest& request : matrix.renderers)
    matrix.roles.push_back(registry.find(request.name)->role);
  for (const RendererRequest& request : matrix.renderers) {
    using Row = std::vector<BehaviourOutcome>;
    const auto measure = [&]() -> Result<Row> {
      Row row;
      for (const Behaviour& behaviour : matrix.behaviours)
        row.push_back(observe(behaviour, request, registry, threads, progress));
      return row;
    };
    PALPATE_ASSIGN(Row row, suite == nullptr ? measure()
                                             : suite->once<Row>(request.label, key_of(request), measure,
                                                                untimed(request)));
    matrix.outcomes.push_back(std::move(row));
  }
  return matrix;
}

std::string matrix_json(const BehaviourMatrix& matrix, const metrics::DocumentHead& head) {
  DocumentJson root = begin_json("palpate-behaviours-1", head);
  for (std::size_t r = 0; r < matrix.outcomes.size(); ++r) {
    DocumentJson row = {{"label", matrix.renderers[r].label},
                        {"name", matrix.renderers[r].name},
                        {"role", name_of(matrix.roles[r])}};
    for (std::size_t b = 0; b < matrix.outcomes[r].size(); ++b) {
      const BehaviourOutcome& outcome = matrix.outcomes[r][b];
      DocumentJson one = {{"id", matrix.behaviours[b].id}, {"counted", matrix.behaviours[b].counted}};
      if (outcome.failure.empty()) {
        one["wrong"] = outcome.wrong;
        one["of"] = outcome.of;
      } else {
        one["failure"] = outcome.failure;
      }
      row["behaviours"].push_back(std::move(one));
    }
    root["renderers"].push_back(std::move(row));
  }
  return document_text(root);
}

void add_behaviours(Page& page, const BehaviourMatrix& matrix, const OutputFolder& folder) {
  Section section;
  section.id = "behaviours";
  section.title = "Behaviour suite";
  section.paragraphs.push_back(
      "Scenes on which the methods differ, each small, fixed and with one thing that is counted against the "
      "exact surface.");
  section.tables.push_back(matrix_table(matrix));
  const Result<OutputFolder> figures = folder.inside("figures");
  for (std::size_t b = 0; b < matrix.behaviours.size() && figures; ++b) {
    section.figures.push_back(draw(picture(matrix, b), *figures));
    section.figures.back().caption = matrix.behaviours[b].text + " " + section.figures.back().caption;
  }
  for (std::size_t r = 0; r < matrix.outcomes.size(); ++r) {
    Fact fact{matrix.renderers[r].label, {}};
    for (std::size_t b = 0; b < matrix.outcomes[r].size(); ++b)
      if (const std::string& why = matrix.outcomes[r][b].failure; !why.empty())
        fact.sentences.push_back(matrix.behaviours[b].title + ": " + why + ".");
    if (!fact.sentences.empty()) section.facts.push_back(std::move(fact));
  }
  page.sections.push_back(std::move(section));
  page.headlines.push_back({"Behaviour", headlines_of(matrix)});
}

namespace {

/// The behaviours named in "a,b"; empty: all.
Result<std::vector<Behaviour>> chosen(std::vector<Behaviour> suite, const std::string& only) {
  if (only.empty()) return suite;
  std::string known;
  for (const Behaviour& behaviour : suite) known += (known.empty() ? "" : ", ") + behaviour.id;
  std::vector<std::string> names = split_list(only);
  for (const std::string& name : names)
    if (std::none_of(suite.begin(), suite.end(), [&](const Behaviour& b) { return b.id == name; }))
      return Error{fmt::format("there is no behaviour '{}'", name), "choose from " + known};
  std::erase_if(
      suite, [&](const Behaviour& b) { return std::find(names.begin(), names.end(), b.id) == names.end(); });
  return suite;
}

}  // namespace

Result<int> watch_behaviours(const BehavioursArguments& arguments, Context& context) {
  Suite suite(context);
  const render::Registry registry = all_renderers();
  std::vector<RendererRequest> renderers = methods_of(registry);
  if (!arguments.renderers.empty()) {
    PALPATE_ASSIGN(renderers, parse_renderers(arguments.renderers, registry));
  }
  PALPATE_TRY(suite.open(arguments.out));
  PALPATE_ASSIGN(std::vector<Behaviour> all, behaviour_suite(suite.progress()));
  PALPATE_ASSIGN(std::vector<Behaviour> wanted, chosen(std::move(all), arguments.only));
  PALPATE_TRY(suite.begin(RunKey().add(arguments.only).add(static_cast<std::uint64_t>(arguments.threads))));
  PALPATE_ASSIGN(const BehaviourMatrix matrix,
                 run_behaviours(std::move(wanted), std::move(renderers), registry, arguments.threads,
                                suite.progress(), &suite));
  if (suite.partial()) return suite.leave();
  suite.progress().report("drawing the report", -1.0);
  const metrics::DocumentHead head = new_head(context.command_line);
  Page page = begin_page("How haptic renderers behave", head);
  add_behaviours(page, matrix, suite.folder());
  PALPATE_TRY(suite.publish({"behaviours.json", matrix_json(matrix, head), {matrix_table(matrix)}}, page,
                            arguments.json));
  return kExitOk;
}

}  // namespace palpate::experiments
