#include "toolkit/plan/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <numeric>
#include <sstream>
#include <utility>
#include <vector>

#include <palpate/options.h>
#include <palpate/paths.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/hardware.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/metrics/machine_info.h"
#include "toolkit/trace/timed_passes.h"

namespace palpate::plan {
namespace {

namespace fs = std::filesystem;

// From a first-level cache to beyond every desktop cache.
constexpr std::size_t kMinBytes = std::size_t{1} << 14, kMaxBytes = std::size_t{1} << 26;
constexpr std::size_t kGrowth = 4;
constexpr std::size_t kLine = 64;
// 0.03 s at 100 ns a read; the fastest of three runs counts.
constexpr std::size_t kReads = 300'000;
constexpr int kRepeats = 3;
constexpr std::uint64_t kSeed = 20'090'413;
constexpr std::uint64_t kMaxFileBytes = 1 << 16;
constexpr const char* kHead = "palpate-machine-1";

constexpr double kNsPerUs = 1e3;

/// Thread time since `start_ns`, an earlier trace::thread_cpu_ns().
double thread_ns_since(std::int64_t start_ns) {
  return static_cast<double>(trace::thread_cpu_ns() - start_ns);
}

/// One random cycle through all lines (Sattolo 1986): no read is predictable.
double chase_ns(std::size_t bytes) {
  struct alignas(kLine) Line {
    std::uint64_t next = 0;
  };
  const std::size_t count = bytes / kLine;
  LargePageVector<Line> lines(count);
  for (std::size_t i = 0; i < count; ++i) lines[i].next = i;
  Random random(kSeed);
  for (std::size_t i = count - 1; i > 0; --i)
    std::swap(lines[i].next, lines[static_cast<std::size_t>(random.below(i))].next);
  double fastest = std::numeric_limits<double>::max();
  std::uint64_t at = 0;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const std::int64_t start_ns = trace::thread_cpu_ns();
    for (std::size_t i = 0; i < kReads; ++i) at = lines[at].next;
    fastest = std::min(fastest, thread_ns_since(start_ns));
  }
  // Using the final position prevents optimising the loop away.
  return at < count ? fastest / static_cast<double>(kReads) : 0.0;
}

fs::path cache_file(const std::string& cpu, const std::string& version) {
  const fs::path folder = cache_folder();
  if (folder.empty()) return {};
  Hash64 hash;
  for (const char c : fmt::format("{}\n{}", cpu, version)) hash.byte(static_cast<std::uint8_t>(c));
  return folder / fmt::format("machine-{}.txt", hash.hex());
}

/// No reads if the file is missing or invalid.
std::vector<ReadLatency> read_cached(const fs::path& file, const std::string& cpu) {
  const Result<std::string> text = read_file(file.string(), kMaxFileBytes);
  if (!text) return {};
  std::istringstream lines(*text);
  std::string head, named;
  if (!std::getline(lines, head) || head != kHead || !std::getline(lines, named) || named != cpu) return {};
  std::vector<ReadLatency> reads;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t blank = line.find(' ');
    if (blank == std::string::npos) return {};
    const Result<double> bytes = parse_number(line.substr(0, blank)),
                         ns = parse_number(line.substr(blank + 1));
    if (!bytes || !ns || !(*ns > 0.0) || (!reads.empty() && !(*bytes > reads.back().bytes))) return {};
    reads.push_back({*bytes, *ns});
  }
  return reads;
}

/// If it cannot be kept, it is measured again next time.
void keep(const fs::path& file, const Machine& machine) {
  std::error_code code;
  fs::create_directories(file.parent_path(), code);
  std::string text = fmt::format("{}\n{}\n", kHead, machine.cpu);
  for (const ReadLatency& read : machine.reads) text += fmt::format("{} {}\n", read.bytes, read.ns);
  Result<AtomicFile> out = AtomicFile::create(file.string());
  if (out && out->write(text)) (void)out->commit();
}

}  // namespace

double Machine::read_ns(double bytes) const noexcept {
  if (reads.empty()) return 0.0;
  if (!(bytes > reads.front().bytes)) return reads.front().ns;
  for (std::size_t i = 1; i < reads.size(); ++i) {
    if (bytes > reads[i].bytes) continue;
    const ReadLatency &below = reads[i - 1], &above = reads[i];
    const double share = std::log(bytes / below.bytes) / std::log(above.bytes / below.bytes);
    return below.ns + share * (above.ns - below.ns);
  }
  return reads.back().ns;
}

Machine measure_machine(const std::string& version, bool anew, Progress* progress) {
  Machine machine;
  machine.cpu = metrics::machine_info().cpu;
  const fs::path file = cache_file(machine.cpu, version);
  if (!anew && !file.empty()) machine.reads = read_cached(file, machine.cpu);
  machine.from_cache = !machine.reads.empty();
  if (machine.from_cache) return machine;
  for (std::size_t bytes = kMinBytes; bytes <= kMaxBytes; bytes *= kGrowth) {
    if (progress != nullptr)
      progress->report("measuring this machine", std::log(static_cast<double>(bytes / kMinBytes) + 1.0) /
                                                     std::log(static_cast<double>(kMaxBytes / kMinBytes)));
    machine.reads.push_back({static_cast<double>(bytes), chase_ns(bytes)});
  }
  if (!file.empty()) keep(file, machine);
  return machine;
}

std::string text(const Machine& machine) {
  std::string out = machine.cpu + ":";
  for (const ReadLatency& read : machine.reads)
    out += fmt::format("{} {} ns from {}", &read == machine.reads.data() ? " a read waits" : ",",
                       format_number(read.ns), format_bytes(read.bytes));
  return out;
}

namespace {

/// Timed passes; the fastest counts, because slower ones include other work of the machine.
constexpr int kWarmPasses = 5, kColdPasses = 3;
constexpr double kWarmUpS = 0.005;
constexpr std::size_t kWordsALine = kLine / sizeof(std::uint64_t);
/// Memory walked through before a cold pass: the largest size with a measured read.
constexpr std::size_t kEvictedWords = kMaxBytes / sizeof(std::uint64_t);
/// The slowest of several models is expected; the bound limits the time.
constexpr std::size_t kMaxModels = 4;

/// A renderer prepared for a scene, with its path.
struct Prepared {
  std::unique_ptr<render::HapticRenderer> renderer;
  trace::ProbePath path;
  double bytes = 0.0, bytes_estimated = 0.0;

  void restart() const noexcept { trace::PathRun(*renderer, path, nullptr).restart(); }
  void step(std::size_t begin, std::size_t end) const noexcept {
    for (std::size_t k = begin; k < end; ++k) (void)renderer->step(path.hip_mm[k], path.t_s[k]);
  }
};

/// An excerpt of a scene with its renderer.
struct Piece : Prepared {
  std::vector<trace::FrameSpan> stretches;
  double contact_frames = 0.0;

  /// Time of the contact frames.
  [[nodiscard]] double step_contact_ns() const noexcept {
    double ns = 0.0;
    for (const trace::FrameSpan& stretch : stretches) {
      if (!stretch.contact) {
        step(stretch.begin, stretch.end);
        continue;
      }
      const std::int64_t start_ns = trace::thread_cpu_ns();
      step(stretch.begin, stretch.end);
      ns += thread_ns_since(start_ns);
    }
    return ns;
  }
};

/// Boxes and cells follow the whole cloud's resolution.
Options options_for(const NamedOptions& renderer, const render::ModelDecisions& decided) {
  Options options = renderer.options;
  const bool boxed = std::any_of(decided.decisions.begin(), decided.decisions.end(),
                                 [](const render::Decision& d) { return d.about == "boxes"; });
  if (!boxed || options.has("resolution_mm") || !decided.spacing_mm || !(*decided.spacing_mm > 0.0))
    return options;
  options.set("resolution_mm", fmt::format("{}", *decided.spacing_mm));
  return options;
}

/// Without a path.
Result<Prepared> prepare(const render::SceneInput& scene, const NamedOptions& renderer,
                         const render::Registry& registry, int threads) {
  Prepared out;
  PALPATE_ASSIGN(out.renderer, registry.make(renderer.name, renderer.options));
  PALPATE_ASSIGN(const render::Decisions estimated, out.renderer->decide(scene, {threads, nullptr}));
  PALPATE_ASSIGN(const render::PrepareReport report, out.renderer->prepare(scene, {threads, nullptr}));
  out.bytes = static_cast<double>(report.bytes);
  out.bytes_estimated = static_cast<double>(estimated.bytes);
  return out;
}

Result<Piece> prepare_piece(SceneExcerpt excerpt, const NamedOptions& renderer,
                            const render::Registry& registry) {
  PALPATE_ASSIGN(Prepared made, prepare(excerpt.scene, renderer, registry, 1));
  Piece piece{std::move(made), {}, 0.0};
  piece.path = std::move(excerpt.path);
  PALPATE_ASSIGN(const trace::ForceTrace trace, trace::replay(*piece.renderer, piece.path));
  piece.stretches = trace::frame_spans_of(trace::contact_of(trace.frames));
  for (const trace::FrameSpan& stretch : piece.stretches)
    if (stretch.contact) piece.contact_frames += static_cast<double>(stretch.end - stretch.begin);
  return piece;
}

/// The prepared pieces of a model, and the whole path's length relative to theirs.
struct SampledPieces {
  std::vector<Piece> pieces;
  double frames = 0.0, path_frames = 0.0;
  std::size_t points = 0;  ///< of all pieces
};

Result<SampledPieces> sample_pieces(const CostQuery& expected, std::size_t index,
                                    const render::Registry& registry) {
  const render::ModelInput& model = expected.scene.models[index];
  paths::PathTarget target;
  target.cloud = model.cloud.get();
  target.surface = model.analytic.get();
  target.box_mm = target.cloud->box_mm();
  PALPATE_ASSIGN(const NamedOptions generator, parse_named_options(expected.path));
  PALPATE_ASSIGN(const trace::ProbePath path, paths::make_path(generator, target));
  PALPATE_ASSIGN(const NamedOptions made, parse_named_options(path.name.substr(0, path.name.find(' '))));
  const auto number = [&](const char* key) { return made.options.has(key) ? made.options.number(key) : 0.0; };
  FeltReach reach;
  reach.felt_mm = std::max(number("depth_mm"), number("clearance_mm"));
  reach.spacing_mm = expected.spacing_mm[index];
  reach.heights = registry.find(expected.renderer.name)->geometry == render::Geometry::kHeights;
  const NamedOptions on_piece{expected.renderer.name,
                              options_for(expected.renderer, expected.decided.models[index])};
  const auto period = static_cast<std::size_t>(number("period_frames"));
  const bool whole = model.cloud->size() <= kMaxWholePoints;
  SampledPieces sampled;
  sampled.path_frames = static_cast<double>(path.size());
  Error last{"no piece"};
  for (const Window& window : choose_windows(path.size(), period, whole ? 1 : kMaxExcerpts)) {
    SceneExcerpt excerpt = extract_excerpt(expected.scene, model, path, window.begin, window.end, reach);
    const std::size_t points = excerpt.scene.models.front().cloud->size();
    if (points == 0) continue;
    Result<Piece> piece = prepare_piece(std::move(excerpt), on_piece, registry);
    if (!piece) {
      last = piece.error();
      continue;
    }
    sampled.points += points;
    sampled.frames += static_cast<double>(piece->path.size());
    sampled.pieces.push_back(*std::move(piece));
  }
  if (sampled.pieces.empty()) return last;
  return sampled;
}

/// One pass over all pieces in turn, like successive places of one model.
double pass_ns(const std::vector<Piece>& pieces, std::vector<std::uint64_t>* evicted) {
  for (const Piece& piece : pieces) piece.restart();
  if (evicted != nullptr)
    for (std::size_t i = 0; i < evicted->size(); i += kWordsALine) ++(*evicted)[i];
  double ns = 0.0;
  for (const Piece& piece : pieces) ns += piece.step_contact_ns();
  return ns;
}

double fastest_pass_ns(const std::vector<Piece>& pieces, int passes, std::vector<std::uint64_t>* evicted) {
  double fastest = std::numeric_limits<double>::max();
  for (int pass = 0; pass < passes; ++pass) fastest = std::min(fastest, pass_ns(pieces, evicted));
  return fastest;
}

Result<FrameCost> model_cost(const CostQuery& expected, std::size_t index, const render::Registry& registry,
                             const Machine& machine) {
  PALPATE_ASSIGN(const SampledPieces sampled, sample_pieces(expected, index, registry));
  FrameCost cost;
  cost.excerpts = sampled.pieces.size();
  double frames = 0.0, bytes = 0.0, estimated = 0.0;
  for (const Piece& piece : sampled.pieces) {
    frames += piece.contact_frames;
    bytes += piece.bytes;
    estimated += piece.bytes_estimated;
  }
  cost.bytes_share = {estimated > 0.0 ? bytes / estimated : 1.0};
  if (!(frames > 0.0)) return cost;
  const double warm_ns = fastest_pass_ns(sampled.pieces, kWarmPasses, nullptr);
  std::vector<std::uint64_t> evicted(kEvictedWords, 1);
  const double cold_ns = fastest_pass_ns(sampled.pieces, kColdPasses, &evicted) - warm_ns;
  cost.warm_us = warm_ns / frames / kNsPerUs;
  const double share = sampled.frames > 0.0 ? sampled.path_frames / sampled.frames : 1.0;
  const double whole = static_cast<double>(expected.decided.models[index].bytes);
  cost.miss_us = memory_wait_ns({cold_ns / frames, frames, share, whole}, machine) / kNsPerUs;
  cost.frame_us = cost.warm_us + cost.miss_us;
  cost.reason = fmt::format(
      "{} µs over {} frames in contact on {} pieces of {} points together, where the probe will go; {} µs of "
      "waiting for memory, from {} µs with cold caches",
      format_number(cost.warm_us), format_count(static_cast<std::uint64_t>(frames)), cost.excerpts,
      format_count(sampled.points), format_number(cost.miss_us),
      format_number((warm_ns + cold_ns) / frames / kNsPerUs));
  return cost;
}

/// For the whole scene, with a path from a generator.
Result<Prepared> prepare_whole(const render::SceneInput& scene, const NamedOptions& renderer,
                               const render::Registry& registry, const std::string& path_text, int threads) {
  PALPATE_ASSIGN(Prepared out, prepare(scene, renderer, registry, threads));
  paths::PathTarget target;
  const render::ModelInput& model = scene.models.front();
  target.cloud = model.cloud.get();
  target.surface = model.analytic.get();
  target.world_from_model = model.world_from_model;
  target.box_mm = target.cloud->box_mm();
  PALPATE_ASSIGN(const NamedOptions generator, parse_named_options(path_text));
  PALPATE_ASSIGN(out.path, paths::make_path(generator, target));
  return out;
}

}  // namespace

double memory_wait_ns(const ColdCacheRun& pieces, const Machine& machine) {
  if (machine.reads.size() < 2 || !(pieces.cold_ns > 0.0)) return 0.0;
  const double far_ns = machine.reads.back().ns, near_ns = machine.reads.front().ns;
  if (!(far_ns > near_ns)) return 0.0;
  const double lines_a_frame = pieces.cold_ns / (far_ns - near_ns);
  const double here = lines_a_frame * pieces.frames * static_cast<double>(kLine);
  const double all = std::max(here, std::min(here * pieces.path_share, pieces.whole_bytes));
  return lines_a_frame * std::max(0.0, machine.read_ns(all) - machine.read_ns(here));
}

Result<SceneRun> run_scene(const render::SceneInput& scene, const NamedOptions& renderer,
                           const render::Registry& registry, const std::string& path_text, int threads) {
  PALPATE_ASSIGN(const Prepared whole, prepare_whole(scene, renderer, registry, path_text, threads));
  PALPATE_ASSIGN(const trace::ForceTrace trace,
                 trace::replay(*whole.renderer, whole.path, scene.simulation.get()));
  const std::vector<std::uint8_t> contact = trace::contact_of(trace.frames);
  const std::vector<trace::FrameSpan> stretches = trace::frame_spans_of(contact);
  std::vector<trace::FrameSpanTime> times(stretches.size());
  trace::TimedPasses passes(*whole.renderer, whole.path, scene.simulation.get(), trace.frames);
  passes.warm_up(kWarmUpS);
  double fastest_ns = std::numeric_limits<double>::max(), frames = 0.0;
  for (int pass = 0; pass < kWarmPasses; ++pass) {
    PALPATE_TRY(passes.time_spans(stretches, times));
    double ns = 0.0;
    frames = 0.0;
    for (std::size_t i = 0; i < stretches.size(); ++i) {
      if (!stretches[i].contact) continue;
      ns += static_cast<double>(times[i].cpu_ns);
      frames += static_cast<double>(stretches[i].end - stretches[i].begin);
    }
    fastest_ns = std::min(fastest_ns, ns);
  }
  return SceneRun{frames > 0.0 ? fastest_ns / frames / kNsPerUs : 0.0, frames, whole.bytes,
                  whole.bytes_estimated};
}

Result<FrameCost> estimate_frame_cost(const CostQuery& expected, const render::Registry& registry,
                                      const Machine& machine) {
  const std::vector<render::ModelInput>& models = expected.scene.models;
  if (expected.decided.models.size() != models.size() || expected.spacing_mm.size() != models.size() ||
      models.empty())
    return Error{"the renderer decided for other models"};
  FrameCost slowest;
  std::vector<double> bytes_share;
  for (std::size_t i = 0; i < std::min(models.size(), kMaxModels); ++i) {
    PALPATE_ASSIGN(FrameCost cost, model_cost(expected, i, registry, machine));
    bytes_share.push_back(cost.bytes_share.front());
    if (cost.frame_us > slowest.frame_us) slowest = std::move(cost);
  }
  slowest.bytes_share = std::move(bytes_share);
  return slowest;
}

}  // namespace palpate::plan
