#include "experiments/stability/stability.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include <palpate/result.h>
#include "experiments/driver/suite.h"
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr double kBaseHz = 1000.0;  // common haptic rate, from which single axes are varied
// Estimated runs of a search, refined during measurement.
constexpr double kRunsOfASearch = 12.0;
constexpr double kPresses = 8.0;  // tasks and scores, in runs

constexpr const char* kControls[] = {"none", "coupling", "passivity"};

struct AskedLoop {
  std::vector<double> rates, delays, dampings;
  bool cross = false;
  Bench bench;
};

std::vector<StabilityPoint> searches_of(const AskedLoop& asked) {
  const bool impedance = asked.bench.arm.has_value();
  const std::vector<double> at_once = {0.0};
  std::vector<std::string> hands = {asked.bench.hand.name};
  if (hands.front() != "released") hands.emplace_back("released");
  std::vector<StabilityPoint> points;
  for (const std::string& held : hands) {
    StabilityPoint base;
    base.hand = held;
    base.rate_hz = kBaseHz;
    const auto add = [&](const char* varied, auto change) {
      StabilityPoint point = base;
      point.varied = varied;
      change(point);
      points.push_back(std::move(point));
    };
    for (const double rate : asked.rates) add("rate", [&](StabilityPoint& p) { p.rate_hz = rate; });
    if (impedance)
      for (const double delay : asked.delays) add("delay", [&](StabilityPoint& p) { p.delay_ms = delay; });
    for (const double damping : asked.dampings)
      add("damping", [&](StabilityPoint& p) { p.damping_n_s_per_mm = damping; });
    for (const char* const control : kControls)
      add("control", [&](StabilityPoint& p) { p.control = control; });
    if (!asked.cross) continue;
    for (const char* const control : kControls)
      for (const double delay : impedance ? asked.delays : at_once)
        for (const double rate : asked.rates)
          add("cross", [&](StabilityPoint& p) {
            p.control = control;
            p.delay_ms = delay;
            p.rate_hz = rate;
          });
  }
  return points;
}

bool same_run(const StabilityPoint& a, const StabilityPoint& b) {
  return a.hand == b.hand && a.control == b.control && a.rate_hz == b.rate_hz && a.delay_ms == b.delay_ms &&
         a.damping_n_s_per_mm == b.damping_n_s_per_mm;
}

/// The scene's control with one addition.
control::ControlOptions control_of(const StabilityPoint& point, const Bench& bench, const Stage& stage) {
  control::ControlOptions options = stage.scene.control;
  if (point.control == "coupling") {
    const double b =
        bench.arm ? bench.arm->damping_n_s_per_mm : device::AdmittanceOptions{}.damping_n_s_per_mm;
    const double most =
        control::coupling_stability({1.0, 0.0}, b, 1.0 / point.rate_hz).max_stiffness_n_per_mm;
    options.coupling = control::Coupling{most, 0.0};
  }
  if (point.control == "passivity") options.passivity = control::PassivityOptions{};
  return options;
}

/// Parses a list of rising numbers.
Result<std::vector<double>> rising_numbers(const std::string& option, const std::string& text,
                                           const NumberRange& range) {
  std::vector<double> numbers;
  for (const std::string& word : split_list(text)) {
    const Result<double> number = read_number(word, range);
    if (!number)
      return Error{fmt::format("{} has {}: {}", option, shown(word), number.error().what),
                   "give numbers separated by commas"};
    if (!numbers.empty() && !(*number > numbers.back()))
      return Error{fmt::format("the numbers of {} do not rise at {}", option, shown(word)),
                   "give each once, the smallest first"};
    numbers.push_back(*number);
  }
  if (numbers.empty()) return Error{option + " is empty", "give at least one number"};
  return numbers;
}

Result<AskedLoop> asked_of(const StabilityArguments& arguments) {
  constexpr NumberRange kRates{100.0, 16'000.0}, kDelays{0.0, 20.0}, kDampings{0.0, 1.0};
  AskedLoop asked;
  PALPATE_ASSIGN(asked.bench, bench_of(arguments.device, arguments.hand));
  PALPATE_ASSIGN(asked.rates, rising_numbers("--rates", arguments.rates, kRates));
  PALPATE_ASSIGN(asked.delays, rising_numbers("--delays", arguments.delays, kDelays));
  PALPATE_ASSIGN(asked.dampings, rising_numbers("--dampings", arguments.dampings, kDampings));
  asked.cross = arguments.cross;
  asked.bench.jitter_s = arguments.jitter_ms / kMillisecondsPerS;
  asked.bench.slew_n_per_s = arguments.slew_n_per_s;
  if (asked.bench.jitter_s * asked.rates.back() >= 1.0 || asked.bench.jitter_s * kBaseHz >= 1.0)
    return Error{fmt::format("--jitter {} ms is not below the period of {} Hz", arguments.jitter_ms,
                             std::max(asked.rates.back(), kBaseHz)),
                 "give less jitter, or lower --rates"};
  return asked;
}

/// Runs searches, tasks and scores of one renderer after the other.
class Measuring {
 public:
  Measuring(const Stage& stage, const AskedLoop& asked, const Places& places, ProgressBar& progress)
      : stage_(stage), asked_(asked), places_(places), progress_(progress) {}

  Result<MeasuredLoop> measure(const RendererRequest& request, const render::Registry& registry, int threads);
  /// Searches every point of one renderer; points under several headings are searched once.
  Status search(const std::string& label, render::HapticRenderer& unit, MeasuredLoop& loop);

 private:
  const Stage& stage_;
  const AskedLoop& asked_;
  const Places& places_;
  ProgressBar& progress_;
};

Result<MeasuredLoop> Measuring::measure(const RendererRequest& request, const render::Registry& registry,
                                        int threads) {
  MeasuredLoop loop;
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> made,
                 registry.make(request.name, request.options));
  // The device limits forces here.
  render::SceneInput scene = stage_.scene.input;
  scene.force_limit_n = 0.0;
  PALPATE_TRY(made->prepare(scene, {threads, &progress_}));
  double runs = 0.0;
  const RunDone done = [&] { progress_.report("tasks of the hand", ++runs / kPresses); };
  std::unique_ptr<render::HapticRenderer> controlled =
      control::wrap(std::make_unique<GainRenderer>(*made, 1.0), stage_.scene.control);
  PALPATE_ASSIGN(loop.tasks, do_tasks(*controlled, stage_, asked_.bench, places_, done));
  for (TaskResult& task : loop.tasks) task.renderer = request.label;
  PALPATE_ASSIGN(LoopScores scores, score_loop(*controlled, stage_, asked_.bench, places_, progress_, done));
  scores.renderer = request.label;
  loop.scores.push_back(std::move(scores));
  PALPATE_TRY(search(request.label, *made, loop));
  return loop;
}

Status Measuring::search(const std::string& label, render::HapticRenderer& unit, MeasuredLoop& loop) {
  std::vector<StabilityPoint>& points = loop.points = searches_of(asked_);
  const double all = kRunsOfASearch * static_cast<double>(points.size()) + kPresses;
  double runs = 0.0;
  const RunDone done = [&] {
    runs += 1.0;
    progress_.report("runs of the loop", std::min(1.0, runs / all));
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    StabilityPoint& point = points[i];
    point.renderer = label;
    runs = kPresses + kRunsOfASearch * static_cast<double>(i);
    const auto here = points.begin() + static_cast<std::ptrdiff_t>(i);
    const auto same =
        std::find_if(points.begin(), here, [&](const StabilityPoint& p) { return same_run(p, point); });
    if (same != here) {
      const std::string varied = point.varied;
      point = *same;
      point.varied = varied;
    } else {
      PALPATE_TRY(find_largest_stable(unit, scene_stiffness(stage_), control_of(point, asked_.bench, stage_),
                                      asked_.bench, places_, point, done));
    }
  }
  return Done{};
}

void add_loop(MeasuredLoop loop, StabilityDocument& document) {
  const auto append = [](auto& to, auto& from) {
    to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
  };
  append(document.points, loop.points);
  append(document.tasks, loop.tasks);
  append(document.scores, loop.scores);
}

/// Checks whether the truth itself swings: then swings say nothing of renderers.
Status ask_truth(const Stage& stage, const AskedLoop& asked, const Places& places,
                 StabilityDocument& document) {
  TruthRenderer truth(*stage.truth, scene_stiffness(stage));
  PALPATE_ASSIGN(const std::vector<TaskResult> tasks, do_tasks(truth, stage, asked.bench, places, [] {}));
  document.truth_stable =
      std::all_of(tasks.begin(), tasks.end(), [](const TaskResult& t) { return t.stable; });
  if (!document.truth_stable)
    document.warnings.push_back(
        fmt::format("At {} N/mm the true surface itself is not stable on this device: paths and scores under "
                    "the hand say little. Choose a smaller --stiffness.",
                    document.stiffness_n_per_mm));
  if (!stage.forces_comparable)
    document.warnings.emplace_back(
        "The truth is a rigid surface without friction or texture, and the scene asks for more: the hand's "
        "way differs from the truth's for that too, and forces are not scored.");
  if (!places.has_edge)
    document.notes.emplace_back("The path meets no edge: the task of following one was left out.");
  return Done{};
}

void begin_document(const StabilityArguments& arguments, const Stage& stage, Context& context,
                    StabilityDocument& document) {
  document.head = new_head(context.command_line);
  document.scene = stage.scene_name;
  document.path = stage.path.name;
  document.truth = stage.reference->name + ": " + stage.reference->exactness;
  document.device = arguments.device;
  document.hand = arguments.hand;
  document.stiffness_n_per_mm = scene_stiffness(stage);
  document.warnings = stage.warnings;
  document.notes = stage.notes;
}

}  // namespace

Result<int> run_stability(const StabilityArguments& arguments, Context& context) {
  Suite suite(context);
  const render::Registry registry = all_renderers();
  ProgressBar& progress = suite.progress();
  PALPATE_ASSIGN(const AskedLoop asked, asked_of(arguments));
  PALPATE_ASSIGN(CheckedRun checked, check_run(arguments.run, registry, progress));
  checked.stage.usual_frames = kStabilityFrames;
  PALPATE_TRY(open_folder(arguments.run, "stability", checked.stage, suite));
  PALPATE_ASSIGN(const Stage stage, set_up(checked.stage, all_readers(), progress));
  PALPATE_ASSIGN(const Places places, places_on(stage));
  StabilityDocument document;
  begin_document(arguments, stage, context, document);
  PALPATE_TRY(choose_renderers(false, registry, stage.scene.input, checked, document.notes));
  RunKey key = key_of(arguments.run, checked.stage);
  for (const std::string& text :
       {arguments.device, arguments.hand, arguments.rates, arguments.delays, arguments.dampings})
    key.add(text);
  key.add(arguments.jitter_ms).add(arguments.slew_n_per_s).add(static_cast<std::uint64_t>(arguments.cross));
  PALPATE_TRY(suite.begin(key));
  PALPATE_TRY(ask_truth(stage, asked, places, document));
  Measuring measuring(stage, asked, places, progress);
  progress.set_prefix("truth: ");
  const auto search_truth = [&]() -> Result<MeasuredLoop> {
    TruthRenderer truth(*stage.truth, document.stiffness_n_per_mm);
    MeasuredLoop loop;
    PALPATE_TRY(measuring.search("truth", truth, loop));
    return loop;
  };
  PALPATE_ASSIGN(MeasuredLoop of_truth,
                 suite.once<MeasuredLoop>("truth", "truth", search_truth, {{}, arguments.run.scene}));
  if (!suite.partial()) add_loop(std::move(of_truth), document);
  int status = kExitOk;
  for (std::size_t i = 0; i < checked.renderers.size(); ++i) {
    const RendererRequest& request = checked.renderers[i];
    progress.set_prefix(fmt::format("[{}/{}] {}: ", i + 1, checked.renderers.size(), request.label));
    Case one = untimed(request);
    one.scene = arguments.run.scene;
    Result<MeasuredLoop> loop = suite.once<MeasuredLoop>(
        request.label, key_of(request),
        [&] { return measuring.measure(request, registry, arguments.run.load.threads); }, one);
    if (suite.partial() && loop) continue;
    if (loop) {
      add_loop(*std::move(loop), document);
      continue;
    }
    status = kExitFellShort;
    document.warnings.push_back(
        fmt::format("{} was not measured: {}", request.label, loop.error().message()));
  }
  progress.set_prefix("");
  if (suite.partial()) {
    for (const std::string& warning : document.warnings) tell("palpate: warning: {}\n", warning);
    PALPATE_TRY(suite.leave());
    return status;
  }
  progress.report("drawing the report", -1.0);
  const Page page = stability_page(document, suite.folder());
  PALPATE_TRY(
      suite.publish({kStabilityFile, to_json(document), stability_tables(document), document.warnings}, page,
                    arguments.run.json));
  return status;
}

}  // namespace palpate::experiments
