#include "experiments/stability/stability.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

#include "experiments/run/choices.h"
#include "experiments/session/run_key.h"
#include "experiments/session/terminal.h"
#include "experiments/stability/measure.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::experiments {
namespace {

constexpr double kBaseHz = 1000.0;  // the rate of haptics, about which everything else is turned
// A search is some twelve runs; known better as it goes on.
constexpr double kRunsOfASearch = 12.0;
constexpr double kPresses = 8.0;  // tasks and scores, in runs

constexpr const char* kControls[] = {"none", "coupling", "passivity"};

struct AskedLoop {
  std::vector<double> rates, delays, dampings;
  bool cross = false;
  Bench bench;
};

/// What is searched for one renderer.
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

/// Control as the scene has it, with one thing more.
control::ControlOptions control_of(const StabilityPoint& point, const Bench& bench, const Stage& stage) {
  control::ControlOptions options = stage.scene.control;
  if (point.control == "coupling") {
    const double b =
        bench.arm ? bench.arm->damping_n_s_per_mm : device::AdmittanceOptions{}.damping_n_s_per_mm;
    const double most =
        control::coupling_stability({1.0, 0.0}, b, 1.0 / point.rate_hz).most_stiffness_n_per_mm;
    options.coupling = control::Coupling{most, 0.0};
  }
  if (point.control == "passivity") options.passivity = control::PassivityOptions{};
  return options;
}

/// Increasing numbers of a list.
Result<std::vector<double>> rising_numbers(const std::string& option, const std::string& text,
                                           const NumberRange& range) {
  std::vector<double> numbers;
  for (const std::string& word : split_list(text)) {
    const Result<double> number = read_number(word, range);
    if (!number)
      return Error{fmt::format("{} has {}: {}", option, shown(word), number.error().what),
                   "give numbers separated by commas",
                   {},
                   0};
    if (!numbers.empty() && !(*number > numbers.back()))
      return Error{fmt::format("the numbers of {} do not rise at {}", option, shown(word)),
                   "give each once, the smallest first",
                   {},
                   0};
    numbers.push_back(*number);
  }
  if (numbers.empty()) return Error{option + " is empty", "give at least one number", {}, 0};
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
                 "give less jitter, or lower --rates",
                 {},
                 0};
  return asked;
}

/// Searches, tasks and scores of the renderers, one after the other.
class Measuring {
 public:
  Measuring(const Stage& stage, const AskedLoop& asked, const Places& places, StabilityDocument& document,
            Context& context)
      : stage_(stage), asked_(asked), places_(places), document_(document), context_(context) {}

  Status measure(const RendererRequest& request, const render::Registry& registry, int threads,
                 std::size_t index, std::size_t of);
  Status search(const std::string& label, render::HapticRenderer& unit, double unit_n_per_mm, double runs);

 private:
  const Stage& stage_;
  const AskedLoop& asked_;
  const Places& places_;
  StabilityDocument& document_;
  Context& context_;
};

Status Measuring::measure(const RendererRequest& request, const render::Registry& registry, int threads,
                          std::size_t index, std::size_t of) {
  context_.progress.set_prefix(fmt::format("[{}/{}] {}: ", index + 1, of, request.label));
  Result<std::unique_ptr<render::HapticRenderer>> made = registry.make(request.name, request.options);
  if (!made) return std::move(made).error();
  // What limits forces here is the device.
  render::SceneInput scene = stage_.scene.input;
  scene.force_limit_n = 0.0;
  const Result<render::PrepareReport> ready = (*made)->prepare(scene, {threads, &context_.progress});
  if (!ready) return ready.error();
  double runs = 0.0;
  const RunDone done = [&] { context_.progress.report("tasks of the hand", ++runs / kPresses); };
  std::unique_ptr<render::HapticRenderer> controlled =
      control::wrap(std::make_unique<GainRenderer>(**made, 1.0), stage_.scene.control);
  Result<std::vector<TaskResult>> tasks = do_tasks(*controlled, stage_, asked_.bench, places_, done);
  if (!tasks) return std::move(tasks).error();
  for (TaskResult& task : *tasks) {
    task.renderer = request.label;
    document_.tasks.push_back(std::move(task));
  }
  Result<LoopScores> scores = score_loop(*controlled, stage_, asked_.bench, places_, context_.progress, done);
  if (!scores) return std::move(scores).error();
  scores->renderer = request.label;
  document_.scores.push_back(*std::move(scores));
  return search(request.label, **made, scene_stiffness(stage_), runs);
}

/// Every point of one renderer; what stands under several headings is searched once.
Status Measuring::search(const std::string& label, render::HapticRenderer& unit, double unit_n_per_mm,
                         double runs) {
  std::vector<StabilityPoint> points = searches_of(asked_);
  const double all = kRunsOfASearch * static_cast<double>(points.size()) + kPresses;
  const RunDone done = [&] {
    runs += 1.0;
    context_.progress.report("runs of the loop", std::min(1.0, runs / all));
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    StabilityPoint& point = points[i];
    point.renderer = label;
    runs = kPresses + kRunsOfASearch * static_cast<double>(i);
    const auto same = std::find_if(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(i),
                                   [&](const StabilityPoint& p) { return same_run(p, point); });
    if (same != points.begin() + static_cast<std::ptrdiff_t>(i)) {
      const std::string varied = point.varied;
      point = *same;
      point.varied = varied;
    } else {
      PALPATE_TRY(find_largest_stable(unit, unit_n_per_mm, control_of(point, asked_.bench, stage_),
                                      asked_.bench, places_, point, done));
    }
    document_.points.push_back(point);
  }
  return Done{};
}

/// Whether even the truth swings: then the others say nothing of renderers.
Status ask_truth(const Stage& stage, const AskedLoop& asked, const Places& places,
                 StabilityDocument& document) {
  TruthRenderer truth(*stage.truth, scene_stiffness(stage));
  PALPATE_ASSIGN(const std::vector<TaskResult> tasks, do_tasks(truth, stage, asked.bench, places, [] {}));
  document.truth_stable =
      std::all_of(tasks.begin(), tasks.end(), [](const TaskResult& t) { return t.stable; });
  if (!document.truth_stable)
    document.warnings.push_back(
        fmt::format("At {} N/mm the true surface itself is not stable on this device: paths and scores under "
                    "the hand say "
                    "little. Choose a smaller --stiffness.",
                    document.stiffness_n_per_mm));
  if (!stage.forces_comparable)
    document.warnings.emplace_back(
        "The truth is a rigid surface without friction or texture, and the scene asks for more: the hand's "
        "way "
        "differs from the truth's for that too, and forces are not scored.");
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

std::string key_of_run(const StabilityArguments& a, const StageRequest& stage) {
  RunKey key;
  for (const std::string& text : {a.run.scene, a.run.renderers, a.run.path, a.run.reference, a.device, a.hand,
                                  a.rates, a.delays, a.dampings})
    key.add(text);
  key.add(a.jitter_ms).add(a.slew_n_per_s).add(static_cast<std::uint64_t>(a.cross));
  for (const std::string& file : files_read(stage)) key.add_file(file);
  return key.word();
}

/// Writes and prints it. The exit status.
int finish_stability(const StabilityDocument& document, const OutputFolder& folder, bool json, int status,
                     Context& context) {
  context.progress.set_prefix("");
  context.progress.report("drawing the report", -1.0);
  Status written = write_stability(document, folder);
  if (written) written = folder.complete();
  context.progress.clear();
  if (!written) return fail(written.error(), kExitFellShort);
  if (json) {
    fmt::print("{}", to_json(document));
    return status;
  }
  for (const Table& table : stability_tables(document))
    fmt::print("{}\n", to_text(table, terminal_columns(STDOUT_FILENO)));
  std::fflush(stdout);
  for (const std::string& warning : document.warnings) tell("palpate: warning: {}\n", warning);
  fmt::print("report: {}\n", std::filesystem::absolute(folder.file(kReportFile)).string());
  return status;
}

}  // namespace

int run_stability(const StabilityArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  const Result<AskedLoop> asked = asked_of(arguments);
  if (!asked) return fail(asked.error(), kExitBadInput);
  Result<CheckedRun> checked = check_run(arguments.run, registry, context.progress);
  if (!checked) return fail(checked.error(), kExitBadInput);
  checked->stage.usual_frames = kStabilityFrames;
  const Result<OutputFolder> folder = OutputFolder::open(
      arguments.run.out.empty() ? usual_folder("stability", arguments.run.scene) : arguments.run.out);
  if (!folder) return fail(folder.error(), kExitBadInput);
  if (const Status apart = folder->check_not_read(files_read(checked->stage)); !apart)
    return fail(apart.error(), kExitBadInput);
  const Result<Stage> stage = set_up(checked->stage, all_readers(), context.progress);
  if (!stage) return fail(stage.error(), kExitBadInput, &context.progress);
  const Result<Places> places = places_on(*stage);
  if (!places) return fail(places.error(), kExitBadInput, &context.progress);
  StabilityDocument document;
  begin_document(arguments, *stage, context, document);
  if (checked->renderers.empty()) {
    Chosen chosen = usual_renderers(stage->scene.input, checked->own, registry);
    checked->renderers = std::move(chosen.renderers);
    for (std::string& note : chosen.notes) document.notes.push_back(std::move(note));
  }
  for (const RendererRequest& request : checked->renderers)
    if (Status able = registry.check_supports(*registry.find(request.name), stage->scene.input); !able)
      return fail(able.error(), kExitBadInput, &context.progress);
  if (const Status begun = begin_run(*folder, key_of_run(arguments, checked->stage), context); !begun)
    return fail(begun.error(), kExitFellShort, &context.progress);
  if (const Status asked_truth = ask_truth(*stage, *asked, *places, document); !asked_truth)
    return fail(asked_truth.error(), kExitFellShort, &context.progress);
  int status = kExitOk;
  Measuring measuring(*stage, *asked, *places, document, context);
  context.progress.set_prefix("truth: ");
  TruthRenderer truth(*stage->truth, document.stiffness_n_per_mm);
  if (const Status searched = measuring.search("truth", truth, document.stiffness_n_per_mm, 0.0); !searched)
    return fail(searched.error(), kExitBadInput, &context.progress);
  for (std::size_t i = 0; i < checked->renderers.size(); ++i) {
    const RendererRequest& request = checked->renderers[i];
    const Status measured =
        measuring.measure(request, registry, arguments.run.load.threads, i, checked->renderers.size());
    if (measured) continue;
    status = kExitFellShort;
    document.warnings.push_back(
        fmt::format("{} was not measured: {}", request.label, measured.error().message()));
  }
  return finish_stability(document, *folder, arguments.run.json, status, context);
}

}  // namespace palpate::experiments
