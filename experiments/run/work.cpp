#include "experiments/run/work.h"

#include <fmt/format.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <nlohmann/json.hpp>

#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <memory>
#include <new>

#include <palpate/clock.h>
#include <palpate/control.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "baselines/renderers/mesh_source.h"
#include "experiments/run/run.h"
#include "experiments/run/stage.h"
#include "toolkit/core/parallel.h"
#include "toolkit/deformation/deformer.h"

namespace palpate::experiments {
namespace {

// Half of a paced pass's pause: caches and clock rates are steady long before.
constexpr double kWarmUpS = 0.1;

/// Processor time of all threads and of the programs that were run, ms.
double cpu_ms() {
  constexpr double kMsPerS = 1e3, kMsPerNs = 1e-6, kMsPerUs = 1e-3;
  timespec own{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &own);
  rusage ran{};
  ::getrusage(RUSAGE_CHILDREN, &ran);
  const auto of = [&](const timeval& t) {
    return kMsPerS * static_cast<double>(t.tv_sec) + kMsPerUs * static_cast<double>(t.tv_usec);
  };
  return kMsPerS * static_cast<double>(own.tv_sec) + kMsPerNs * static_cast<double>(own.tv_nsec) +
         of(ran.ru_utime) + of(ran.ru_stime);
}

/// Passes progress on and asks to stop when time is up.
class TimeLimit final : public Progress {
 public:
  TimeLimit(Progress& inner, double limit_s) : inner_(inner), limit_s_(limit_s) {}
  void report(std::string_view what, double fraction) override { inner_.report(what, fraction); }
  [[nodiscard]] bool cancelled() const override { return inner_.cancelled() || expired(); }
  [[nodiscard]] bool expired() const { return limit_s_ > 0.0 && watch_.ms() * 1e-3 > limit_s_; }

 private:
  Progress& inner_;
  double limit_s_;
  Stopwatch watch_;
};

/// The time of cleaning stands before the renderer's own phases: it is needed as well before the first frame.
void put_before(const std::vector<render::PreparePhase>& phases, const std::vector<std::string>& notes,
                render::PrepareReport& report) {
  report.phases.insert(report.phases.begin(), phases.begin(), phases.end());
  report.notes.insert(report.notes.begin(), notes.begin(), notes.end());
  for (const render::PreparePhase& phase : phases) report.total_ms += phase.ms;
}

Status save_mesh(const render::HapticRenderer& renderer, const std::string& file, bool& saved) {
  const auto* holder = dynamic_cast<const baselines::MeshHolder*>(&renderer);
  const geometry::TriangleMesh* mesh = holder == nullptr ? nullptr : holder->mesh(0);
  if (mesh != nullptr) {
    saved = true;
    return io::write_mesh_ply(file, *mesh);
  }
  saved = false;
  return Done{};
}

Status save_edited(const render::HapticRenderer& renderer, const std::string& file) {
  const auto* editable = dynamic_cast<const deformation::Editable*>(&renderer);
  if (editable == nullptr)
    return Error{"this renderer does not change its model",
                 "run cloud, on a scene with [model.surface.dent]"};
  PALPATE_ASSIGN(const cloud::Cloud edited, editable->edited(0));
  return io::write_cloud(file, edited);
}

/// Whether the mesh is the file's own, with none of its faces changed.
bool feels_own_faces(const render::PrepareReport& report) {
  if (report.decisions.models.empty()) return false;
  bool as_it_is = false;
  for (const render::Decision& d : report.decisions.models.front().decisions) {
    if (d.about == "mesh") as_it_is = d.choice == "original";
    if ((d.about == "repair" || d.about == "facets") && d.given) as_it_is = false;
  }
  return as_it_is;
}

metrics::StreamScores stream_scores(const Stage& stage, const StreamFeed& feed,
                                    const trace::ForceTrace& trace, const render::FrameCounters& counted) {
  metrics::StreamScores scores = metrics::score_stream(
      stage.path, trace, feed.deliveries(), stage.scene.input.models.front().surface.stiffness_n_per_mm);
  scores.skipped = feed.skipped();
  scores.swaps = counted.swaps;
  scores.stalled_frames = counted.stalled_frames;
  return scores;
}

void warn(Run& run, const std::string& text) {
  run.result.prepare->warnings.push_back(text);
}

/// One processor for this thread from here on, the last of those that it may use: the first ones get the
/// interrupts. Its number, or nothing where that is not allowed.
std::optional<std::uint64_t> pin() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (::sched_getaffinity(0, sizeof(allowed), &allowed) != 0) return std::nullopt;
  for (std::size_t cpu = CPU_SETSIZE; cpu-- > 0;) {
    if (!CPU_ISSET(cpu, &allowed)) continue;
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(cpu, &one);
    if (::sched_setaffinity(0, sizeof(one), &one) != 0) return std::nullopt;
    return std::uint64_t{cpu};
  }
  return std::nullopt;
}

}  // namespace

metrics::RendererResult begin_result(const Stage& stage, const RendererRequest& request,
                                     const render::Registry& registry, int threads) {
  metrics::RendererResult result;
  result.label = request.label;
  result.name = request.name;
  const render::RendererInfo& info = *registry.find(request.name);
  result.role = info.role;
  result.works_on = info.geometry;
  result.missing = render::names_of(render::features_required_by(stage.scene.input).without(info.supports));
  result.threads = threads > 0 ? threads : available_threads();
  std::uint64_t points = 0;
  for (const render::ModelInput& model : stage.scene.input.models) points += model.cloud->size();
  result.model = metrics::RendererResult::Model{points, stage.spacing.resolution_mm};
  if (const Result<Options> complete = validate(request.options, info.options, request.name))
    result.options.assign(complete->all().begin(), complete->all().end());
  if (!request.clean.empty()) result.options.emplace_back("clean", cleaning_text(request.clean));
  return result;
}

std::string result_text(const Run& run) {
  metrics::ResultDocument document;
  document.renderers.push_back(run.result);
  return nlohmann::ordered_json{
      {"saved_mesh", run.saved_mesh}, {"own_faces", run.own_faces}, {"result", metrics::to_json(document)}}
      .dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

Result<Run> run_of(const std::string& text) {
  const nlohmann::json kept = nlohmann::json::parse(text, nullptr, false);
  const bool is_run = kept.is_object() && kept.contains("result") && kept["result"].is_string();
  PALPATE_ASSIGN(metrics::ResultDocument document,
                 metrics::parse_result(is_run ? kept["result"].get<std::string>() : std::string(),
                                       "what was kept of an interrupted run"));
  Run run;
  if (document.renderers.size() != 1) return Error{"what was kept is not one run"};
  run.result = std::move(document.renderers.front());
  run.saved_mesh = kept.contains("saved_mesh") && kept["saved_mesh"] == true;
  run.own_faces = kept.contains("own_faces") && kept["own_faces"] == true;
  return run;
}

Work::Work(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
           const RunOptions& options, const Answers& answers)
    : stage_(stage), request_(request), registry_(registry), options_(options), answers_(answers) {}
Work::~Work() = default;

Result<std::string> Work::operator()(Task task, Progress& progress) {
  switch (task) {
    case Task::kPrepare:
      return prepare(progress);
    case Task::kPasses:
      PALPATE_TRY(passes());
      return std::string();
    case Task::kPaced:
      PALPATE_TRY(paced(progress));
      return std::string();
    case Task::kPin:
      if (const std::optional<std::uint64_t> cpu = pin()) return std::to_string(*cpu);
      return std::string();
  }
  return Error{"no such task"};
}

Result<std::string> Work::prepare(Progress& progress) {
  Run run;
  run.result = begin_result(stage_, request_, registry_, options_.threads);
  PALPATE_ASSIGN(renderer_, registry_.make(request_.name, request_.options));
  inner_ = renderer_.get();
  renderer_ = control::wrap(std::move(renderer_), stage_.scene.control);
  TimeLimit limit(progress, options_.prepare_limit_s);
  const auto give_up = [&](metrics::RunStatus status, std::string reason) {
    run.result.status = status;
    run.result.reason = std::move(reason);
    return result_text(run);
  };
  const std::uint64_t meshes_before = baselines::meshes_from_cache();
  const double cpu_before_ms = cpu_ms();
  const Stopwatch watch;
  std::optional<CleanedScene> cleaned;
  if (!request_.clean.empty()) {
    Result<CleanedScene> made = clean_scene(stage_.scene.input, request_.clean, options_.threads, limit);
    if (!made) return give_up(metrics::RunStatus::kFailed, made.error().message());
    cleaned = *std::move(made);
    run.result.model->points = 0;
    for (const render::ModelInput& model : cleaned->input.models)
      run.result.model->points += model.cloud->size();
  }
  progress.report("preparing " + request_.label, -1.0);
  Result<render::PrepareReport> prepared =
      renderer_->prepare(cleaned ? cleaned->input : stage_.scene.input, {options_.threads, &limit});
  const metrics::PrepareTimes clock{watch.ms(), cpu_ms() - cpu_before_ms,
                                    baselines::meshes_from_cache() > meshes_before};
  if (!prepared)
    return limit.expired() ? give_up(metrics::RunStatus::kDidNotFinish,
                                     fmt::format("preparation stopped after {} s", options_.prepare_limit_s))
                           : give_up(prepared.error().gave_up ? metrics::RunStatus::kDidNotFinish
                                                              : metrics::RunStatus::kFailed,
                                     prepared.error().message());
  run.result.prepare = *std::move(prepared);
  run.result.prepare_clock = clock;
  if (cleaned) put_before(cleaned->phases, cleaned->notes, *run.result.prepare);
  // The clock's values, not the renderer's; from a cache, those of the day it was made count.
  if (!clock.from_cache) run.result.prepare->total_ms = clock.wall_ms;
  for (const scene::Provenance& p : stage_.scene.provenance)
    put_before(p.cleaning, p.cleaned, *run.result.prepare);
  for (const std::string& text :
       render::unsupported_features(*registry_.find(request_.name), stage_.scene.input))
    warn(run, text);
  run.own_faces = feels_own_faces(*run.result.prepare);
  if (!options_.save_mesh.empty()) PALPATE_TRY(save_mesh(*inner_, options_.save_mesh, run.saved_mesh));
  if (stage_.stream) {
    stream::DepthReceiver* const receiver = renderer_->depth_receiver();
    if (receiver == nullptr)
      return give_up(metrics::RunStatus::kFailed,
                     "it takes no depth images: choose depth-image, stream-proxy or mesh-godobject");
    feed_ = std::make_unique<StreamFeed>(stage_.stream->images, *receiver, stage_.path, stage_.stream->delay);
  }
  progress.report("replaying " + request_.label, -1.0);
  PALPATE_TRY(replay(run));
  if (!options_.save_edited.empty()) PALPATE_TRY(save_edited(*inner_, options_.save_edited));
  return result_text(run);
}

Status Work::replay(Run& run) {
  render::Simulation* simulation = feed_ ? feed_.get() : stage_.scene.input.simulation.get();
  PALPATE_ASSIGN(const trace::ForceTrace trace, trace::replay(*renderer_, stage_.path, simulation));
  std::copy(trace.frames.begin(), trace.frames.end(), answers_.frames.begin());
  if (feed_) run.result.stream = stream_scores(stage_, *feed_, trace, renderer_->counters());
  const std::uint64_t edges = renderer_->counters().edges;
  if (edges > 0)
    warn(run, fmt::format(
                  "Nothing is felt under the surface after a border or a hole until the HIP has been above "
                  "again: it came there {} time{}.",
                  edges, edges == 1 ? "" : "s"));
  for (const std::string& warning : warnings_about_tiles(renderer_->counters())) warn(run, warning);
  if (!stage_.starts_free && trace.frames.front().contact)
    warn(run,
         "It is in contact at the path's first position already: it feels the surface from so far away, or "
         "the path starts inside. Without a ground truth nobody can tell; start farther away.");
  passes_.emplace(*renderer_, stage_.path, simulation, answers_.frames);
  return Done{};
}

Status Work::passes() {
  passes_->warm_up(kWarmUpS);
  const std::vector<trace::FrameSpan> stretches = trace::frame_spans_of(answers_.contact);
  PALPATE_TRY(passes_->time_spans(stretches, answers_.stretch_times.first(stretches.size())));
  return passes_->time_frames(answers_.frame_ns);
}

Status Work::paced(Progress& progress) {
  const std::uint64_t cold =
      (options_.paced_frames + kWarmFramesPerEvictedFrame - 1) / kWarmFramesPerEvictedFrame;
  PALPATE_ASSIGN(answers_.paced[0],
                 passes_->paced(options_.paced_frames, false, answers_.contact, &progress));
  PALPATE_ASSIGN(answers_.paced[1], passes_->paced(cold, true, answers_.contact, &progress));
  return Done{};
}

namespace {

/// Memory that a forked process shares with this one.
class SharedMemory {
 public:
  explicit SharedMemory(std::size_t bytes) : bytes_(bytes) {
    data_ = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (data_ == MAP_FAILED) throw std::bad_alloc();
  }
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  ~SharedMemory() { ::munmap(data_, bytes_); }
  /// The next `count` of them, made anew.
  template <class T>
  std::span<T> take(std::size_t count) {
    used_ = (used_ + alignof(T) - 1) / alignof(T) * alignof(T);
    T* first = reinterpret_cast<T*>(static_cast<std::byte*>(data_) + used_);
    used_ += count * sizeof(T);
    std::uninitialized_default_construct_n(first, count);
    return {first, count};
  }
  static std::size_t bytes_for(std::size_t frames) {
    constexpr std::size_t kSlack = 1024;  // alignment
    return frames * (sizeof(render::Frame) + 1 + sizeof(trace::FrameSpanTime) + sizeof(std::uint32_t)) +
           2 * sizeof(trace::PacedStatistics) + kSlack;
  }

 private:
  void* data_;
  std::size_t bytes_, used_ = 0;
};

}  // namespace

struct Seat::State {
  SharedMemory memory;
  Answers answers;
  Work work;
  Child child;

  State(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
        const RunOptions& options, bool apart)
      : memory(SharedMemory::bytes_for(stage.path.size())),
        answers{memory.take<render::Frame>(stage.path.size()), memory.take<std::uint8_t>(stage.path.size()),
                memory.take<trace::FrameSpanTime>(stage.path.size()),
                memory.take<std::uint32_t>(stage.path.size()),
                std::span<trace::PacedStatistics, 2>(memory.take<trace::PacedStatistics>(2))},
        work(stage, request, registry, options, answers),
        child([this](std::uint64_t task,
                     Progress& progress) { return work(static_cast<Task>(task), progress); },
              apart) {}
};

Seat::Seat(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
           const RunOptions& options, bool apart)
    : state_(std::make_unique<State>(stage, request, registry, options, apart)) {}
Seat::~Seat() = default;

Result<std::string> Seat::ask(Task task, Progress& progress) {
  return state_->child.ask(static_cast<std::uint64_t>(task), progress);
}
const Answers& Seat::answers() const {
  return state_->answers;
}
bool Seat::is_apart() const {
  return state_->child.is_apart();
}

bool has_room() {
  constexpr double kLeastFree = 1.0 / 3.0;
  std::ifstream file("/proc/meminfo");
  double total = 0.0, available = 0.0;
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("MemTotal:", 0) == 0)
      total = std::strtod(line.c_str() + std::strlen("MemTotal:"), nullptr);
    if (line.rfind("MemAvailable:", 0) == 0)
      available = std::strtod(line.c_str() + std::strlen("MemAvailable:"), nullptr);
  }
  return !(total > 0.0) || available > kLeastFree * total;
}

}  // namespace palpate::experiments
