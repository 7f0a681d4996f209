// Many renderers on one stage: prepared one after the other, then timed in turns.
#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "experiments/run/work.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

constexpr std::uint64_t kOrderSeed = 12;  // of the order in which renderers take turns

/// A renderer that is prepared and has a trace.
struct Sitting {
  std::size_t index = 0;  ///< among the requests
  std::unique_ptr<Seat> seat;
  double passes_s = 0.0;     ///< one round took
  std::uint64_t rounds = 0;  ///< that it gets
  trace::PassTimes times;
};

class Rounds {
 public:
  Rounds(const Stage& stage, const std::vector<RendererRequest>& requests, const render::Registry& registry,
         const RunOptions& options, Progress& progress, const RunNews& news)
      : stage_(stage),
        requests_(requests),
        registry_(registry),
        options_(options),
        progress_(progress),
        news_(news),
        run_options_(requests.size(), options),
        runs_(requests.size()),
        random_(kOrderSeed) {}

  /// The next renderer, up to where it can take turns.
  Status sit_down(std::size_t index);
  /// All that sit take their turns and leave.
  Status take_turns();
  [[nodiscard]] bool anybody() const { return !sitting_.empty(); }
  [[nodiscard]] std::vector<Run> runs() { return std::move(runs_); }

 private:
  Status pass_once(Sitting& one);
  Status first_times(Sitting& one);
  void note_times(Sitting& one, const char* contact_of);
  void give_up(const Sitting& one, const Error& error);
  Status announce(std::size_t index) {
    return news_ ? news_(requests_[index], runs_[index]) : Status(Done{});
  }
  void choose_contact(const char*& whose);

  const Stage& stage_;
  const std::vector<RendererRequest>& requests_;
  const render::Registry& registry_;
  const RunOptions& options_;
  Progress& progress_;
  const RunNews& news_;
  std::vector<RunOptions> run_options_;  ///< one for each: the first mesh is the one that is saved
  std::vector<Run> runs_;
  std::vector<Sitting> sitting_;
  Random random_;
  bool saved_mesh_ = false;
};

Status Rounds::sit_down(std::size_t index) {
  RunOptions& own = run_options_[index];
  if (saved_mesh_) own.save_mesh.clear();
  Sitting one;
  one.index = index;
  one.seat = std::make_unique<Seat>(stage_, requests_[index], registry_, own, options_.own_process);
  const Result<std::string> prepared = one.seat->ask(Task::kPrepare, progress_);
  if (!prepared) {
    // A file that cannot be written is the caller's; what ends a process is the renderer's.
    if (!prepared.error().file.empty()) return prepared.error();
    runs_[index].result = begin_result(stage_, requests_[index], registry_, options_.threads);
    give_up(one, prepared.error());
    return announce(index);
  }
  PALPATE_ASSIGN(runs_[index], run_of(*prepared));
  Run& run = runs_[index];
  saved_mesh_ = saved_mesh_ || run.saved_mesh;
  if (run.result.status != metrics::RunStatus::kOk) return announce(index);
  const Answers& answers = one.seat->answers();
  run.trace.label = requests_[index].label;
  run.trace.frames.assign(answers.frames.begin(), answers.frames.end());
  run.result.trace_hash = trace::trace_hash(run.trace);
  if (const Status timed = first_times(one); !timed) {
    give_up(one, timed.error());
    return announce(index);
  }
  progress_.report("scoring " + run.result.label, -1.0);
  if (const Status scored = score_run(stage_, run); !scored) {
    give_up(one, scored.error());
    return announce(index);
  }
  PALPATE_TRY(announce(index));
  sitting_.push_back(std::move(one));
  return Done{};
}

/// Times of its own, alone: what stands if nothing comes after it.
Status Rounds::first_times(Sitting& one) {
  Run& run = runs_[one.index];
  const std::span<std::uint8_t> contact = one.seat->answers().contact;
  const std::vector<std::uint8_t> own = trace::contact_of(run.trace.frames);
  for (std::size_t i = 0; i < contact.size(); ++i)
    contact[i] = stage_.reference ? (stage_.reference->frames[i].frame.contact ? 1 : 0) : own[i];
  metrics::TimingConditions& timing = run.result.timing.emplace();
  timing.own_process = one.seat->is_apart();
  if (timing.own_process) {
    PALPATE_ASSIGN(const std::string cpu, one.seat->ask(Task::kPin, progress_));
    if (!cpu.empty()) timing.pinned_cpu = std::stoull(cpu);
  }
  progress_.report("timing " + run.result.label, -1.0);
  const Stopwatch watch;
  PALPATE_TRY(pass_once(one));
  constexpr double kMsPerS = 1e3;
  one.passes_s = watch.ms() / kMsPerS;
  note_times(one, stage_.reference ? "truth" : "own");
  if (options_.paced_frames == 0) return Done{};
  PALPATE_TRY(one.seat->ask(Task::kPaced, progress_));
  run.result.paced = one.seat->answers().paced[0];
  run.result.paced_evicted = one.seat->answers().paced[1];
  return Done{};
}

/// One pass of each kind; its times are added.
Status Rounds::pass_once(Sitting& one) {
  PALPATE_TRY(one.seat->ask(Task::kPasses, progress_));
  const Answers& answers = one.seat->answers();
  if (one.times.stretches.empty()) one.times.stretches = trace::frame_spans_of(answers.contact);
  const auto of_stretches = answers.stretch_times.first(one.times.stretches.size());
  one.times.by_span.emplace_back(of_stretches.begin(), of_stretches.end());
  one.times.by_frame.emplace_back(answers.frame_ns.begin(), answers.frame_ns.end());
  return Done{};
}

void Rounds::note_times(Sitting& one, const char* contact_of) {
  Run& run = runs_[one.index];
  one.times.clock_overhead_ns = trace::measure_clock_overhead_ns();
  trace::PassStatistics statistics = trace::pass_statistics(one.times, run.trace.frames);
  run.result.timing->contact_of = contact_of;
  PageFaults faults;
  for (const auto& pass : one.times.by_span)
    for (const trace::FrameSpanTime& span : pass) faults += span.page_faults;
  run.result.timing->minor_faults = faults.minor;
  run.result.timing->major_faults = faults.major;
  run.result.frame = statistics.contact;
  run.result.frame_free = statistics.free;
  run.result.frame_all = statistics.all;
  run.trace.frame_ns = std::move(statistics.frame_ns);
}

void Rounds::give_up(const Sitting& one, const Error& error) {
  metrics::RendererResult& result = runs_[one.index].result;
  result.status = error.gave_up ? metrics::RunStatus::kDidNotFinish : metrics::RunStatus::kFailed;
  result.reason = error.message();
  result.frame = result.frame_free = result.frame_all = {};
  result.timing.reset();
  result.accuracy.reset();
  result.energy.reset();
  result.trace_hash.clear();
  runs_[one.index].trace = {};
  runs_[one.index].per_frame = {};
}

/// Without a truth, the frames that at least half of the renderers call contact, the same for all.
void Rounds::choose_contact(const char*& whose) {
  whose = stage_.reference ? "truth" : "majority";
  if (stage_.reference) return;
  std::vector<std::size_t> votes(stage_.path.size());
  for (const Sitting& one : sitting_)
    for (std::size_t i = 0; i < votes.size(); ++i)
      votes[i] += runs_[one.index].trace.frames[i].contact ? 1u : 0u;
  for (Sitting& one : sitting_)
    for (std::size_t i = 0; i < votes.size(); ++i)
      one.seat->answers().contact[i] = 2 * votes[i] >= sitting_.size() ? 1 : 0;
}

Status Rounds::take_turns() {
  const char* whose = nullptr;
  choose_contact(whose);
  std::uint64_t most = 0;
  for (Sitting& one : sitting_) {
    const double affordable = options_.budget_s / std::max(one.passes_s, 1e-9);
    one.rounds = static_cast<std::uint64_t>(std::min(affordable, static_cast<double>(options_.passes)));
    if (options_.passes <= 1) one.rounds = 0;  // what it has is what was asked for
    most = std::max(most, one.rounds);
    if (one.rounds > 0) one.times = {};
  }
  std::vector<std::size_t> order(sitting_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  for (std::uint64_t round = 0; round < most; ++round) {
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random_.below(i)]);
    progress_.report("timing in turns", static_cast<double>(round) / static_cast<double>(most));
    if (progress_.cancelled()) return Error{"stopped by the user"};
    for (const std::size_t i : order) {
      Sitting& one = sitting_[i];
      if (round >= one.rounds || runs_[one.index].result.status != metrics::RunStatus::kOk) continue;
      if (const Status passed = pass_once(one); !passed) give_up(one, passed.error());
    }
  }
  for (Sitting& one : sitting_) {
    one.seat.reset();
    metrics::RendererResult& result = runs_[one.index].result;
    if (result.status == metrics::RunStatus::kOk && one.rounds > 0) {
      result.timing->in_turns_with = static_cast<std::uint64_t>(
          std::count_if(sitting_.begin(), sitting_.end(),
                        [&](const Sitting& other) { return &other != &one && other.rounds > 0; }));
      note_times(one, whose);
    }
    if (one.rounds > 0) PALPATE_TRY(announce(one.index));
  }
  sitting_.clear();
  return Done{};
}

}  // namespace

Result<std::vector<Run>> run_renderers(const Stage& stage, const std::vector<RendererRequest>& requests,
                                       const render::Registry& registry, const RunOptions& options,
                                       Progress& progress, metrics::MeasurementConditions& conditions,
                                       const RunNews& news) {
  PALPATE_TRY(trace::check_path(stage.path));
  conditions = metrics::current_conditions();
  conditions.rounds = options.passes;
  conditions.budget_s = options.budget_s;
  conditions.order_seed = kOrderSeed;
  const auto before = metrics::processor_ticks();
  Rounds rounds(stage, requests, registry, options, progress, news);
  for (std::size_t i = 0; i < requests.size(); ++i) {
    if (rounds.anybody() && !has_room()) PALPATE_TRY(rounds.take_turns());
    PALPATE_TRY(rounds.sit_down(i));
  }
  if (rounds.anybody()) PALPATE_TRY(rounds.take_turns());
  conditions.load_after = metrics::load_now();
  conditions.steal_percent = metrics::stolen_percent(before, metrics::processor_ticks());
  return rounds.runs();
}

Result<Run> run_renderer(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
                         const RunOptions& options, Progress& progress) {
  metrics::MeasurementConditions conditions;
  PALPATE_ASSIGN(std::vector<Run> runs,
                 run_renderers(stage, {request}, registry, options, progress, conditions, {}));
  return std::move(runs.front());
}

}  // namespace palpate::experiments
