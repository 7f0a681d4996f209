#include "experiments/study/study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <span>

#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/files.h"
#include "toolkit/metrics/scores.h"
#include "toolkit/trace/csv_rows.h"

namespace palpate::experiments {

namespace fs = std::filesystem;

namespace {

constexpr const char* kSampleHeader = "x_mm,y_mm,z_mm";
constexpr std::uint64_t kSampleSeed = 1;

/// True if a document's name is of a file directly in the folder.
bool is_plain(const std::string& name) {
  return !name.empty() && name != "." && name != ".." && name.find('/') == std::string::npos;
}

class Reading {
 public:
  Reading(const fs::path& folder, Study& study) : folder_(folder), study_(study) {}

  Status truth() {
    if (!study_.document.truth) return Done{};
    PALPATE_ASSIGN(const std::string file, named(study_.document.truth->file));
    PALPATE_ASSIGN(trace::PathAndReference read, trace::read_reference_csv(file));
    study_.reference = std::move(read.reference);
    study_.reference->name = study_.document.truth->name;
    study_.reference->exactness = study_.document.truth->exactness;
    return take_path(std::move(read.path), file);
  }

  Status run(const metrics::RendererResult& result) {
    StudyRun& run = study_.runs.emplace_back();
    if (result.trace_file.empty()) return Done{};
    PALPATE_ASSIGN(const std::string file, named(result.trace_file));
    PALPATE_ASSIGN(trace::PathAndTrace read, trace::read_trace_csv(file));
    run.trace = std::move(read.trace);
    run.trace.label = result.label;
    if (trace::trace_hash(run.trace) != result.trace_hash)
      return Error{fmt::format("is not the trace of {}, whose hash stands in {}", result.label, kResultFile),
                   again(), file};
    PALPATE_TRY(take_path(std::move(read.path), file));
    return scores(result, run);
  }

  Status model(const metrics::StudyModel& model) {
    ModelSample& sample = study_.models.emplace_back();
    sample.name = model.name;
    if (model.sample.empty()) return Done{};
    PALPATE_ASSIGN(const std::string file, named(model.sample));
    PALPATE_ASSIGN(trace::LineReader reader, trace::LineReader::open(file, kMemoryLimitBytes));
    std::vector<Vec3> points;
    const Status read = trace::read_rows(reader, kSampleHeader, "", [&](std::span<const double> v) -> Status {
      if (points.size() == kSamplePoints)
        return reader.error(fmt::format("there are more than {} points", kSamplePoints), again());
      points.emplace_back(v[0], v[1], v[2]);
      return Done{};
    });
    if (!read) return read.error();
    Result<cloud::Cloud> cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse);
    if (!cloud) return std::move(cloud).error().in_file(file);
    sample.points = *std::move(cloud);
    return Done{};
  }

 private:
  /// Remedy for missing files: the way to make them again.
  [[nodiscard]] std::string again() const {
    const std::string& command = study_.document.command;
    return "copy the whole folder" +
           (command.empty() ? std::string(", or run it again") : ", or run it again: " + command);
  }

  [[nodiscard]] Result<std::string> named(const std::string& name) const {
    const fs::path result = folder_ / kResultFile;
    if (!is_plain(name))
      return Error{fmt::format("names a file outside of the study: '{}'", name), again(), result.string()};
    const fs::path file = folder_ / name;
    std::error_code code;
    if (!fs::exists(file, code))
      return Error{fmt::format("is missing, and {} names it", kResultFile), again(), file.string()};
    return file.string();
  }

  Status scores(const metrics::RendererResult& result, StudyRun& run) {
    if (result.scores_file.empty()) return Done{};
    PALPATE_ASSIGN(const std::string file, named(result.scores_file));
    PALPATE_ASSIGN(metrics::AccuracyFrames read, metrics::read_scores_csv(study_.path, file));
    run.per_frame = std::move(read);
    return Done{};
  }

  /// The first path is the study's; all must be equal.
  Status take_path(trace::ProbePath path, const std::string& file) {
    if (study_.path.size() == 0) {
      study_.path = std::move(path);
      study_.path.name = study_.document.path;
      return Done{};
    }
    if (path.t_s == study_.path.t_s && path.hip_mm == study_.path.hip_mm) return Done{};
    return Error{"is along another path than the other files of the study", again(), file};
  }

  const fs::path& folder_;
  Study& study_;
};

/// Reason why a folder without result.json is no study.
Error no_study(const fs::path& folder) {
  std::string inside;
  std::error_code code;
  for (const auto& entry : fs::directory_iterator(folder, code))
    if (fs::exists(entry.path() / kResultFile, code)) inside = std::max(inside, entry.path().string());
  return Error{fmt::format("is no study: there is no {} in it", kResultFile),
               inside.empty() ? std::string("give the folder that compare wrote with --out")
                              : fmt::format("its tables are studies: give one of them, such as {}", inside),
               folder.string()};
}

Result<metrics::ResultDocument> read_document(const fs::path& folder) {
  std::error_code code;
  if (!fs::exists(folder, code))
    return Error{"there is no such folder", "give the folder that compare wrote with --out", folder.string()};
  if (!fs::is_directory(folder, code))
    return Error{"is a file, not the folder of a study", "give the folder that compare wrote with --out",
                 folder.string()};
  const std::string file = (folder / kResultFile).string();
  if (!fs::exists(file, code)) return no_study(folder);
  PALPATE_ASSIGN(const std::string text, read_file(file, kMemoryLimitBytes));
  Result<metrics::ResultDocument> document = metrics::parse_result(text, file);
  if (!document) return document;
  if (!document->complete)
    return Error{"is half written: the run goes on, or was interrupted",
                 "wait for it, or let the same command go on from there" +
                     (document->command.empty() ? std::string() : ": " + document->command),
                 file};
  if (!document->scoring)
    return Error{"holds results, and no study: traces and truth do not stand beside it",
                 "give the folder that compare or replay of this version wrote", file};
  return document;
}

/// Digits that resolve a hundred-thousandth of the model's size.
int digits_for(const geometry::Aabb& box) {
  constexpr double kShare = 1e-5;
  constexpr int kMost = 17;  // the most of a double
  const double largest = std::max(box.low_mm.cwiseAbs().maxCoeff(), box.high_mm.cwiseAbs().maxCoeff());
  const double extent = box.extent_mm().maxCoeff();
  if (!(extent > 0.0)) return kMost;
  return std::clamp(
      static_cast<int>(std::ceil(std::log10(std::max(largest, extent) / (kShare * extent)))) + 1, 1, kMost);
}

}  // namespace

std::string trace_name(const std::string& label, bool alone) {
  return alone ? "trace.csv" : fmt::format("trace-{}.csv", label);
}

std::string scores_name(const std::string& label, bool alone) {
  return alone ? "scores.csv" : fmt::format("scores-{}.csv", label);
}

Result<std::string> write_sample(const cloud::Cloud& points, const geometry::RigidTransform& world_from_model,
                                 std::size_t number, const OutputFolder& folder) {
  const cloud::Cloud some = cloud::random_subset(points, kSamplePoints, kSampleSeed);
  geometry::Aabb box;
  std::vector<Vec3> world;
  for (std::size_t i = 0; i < some.size(); ++i) {
    world.push_back(world_from_model * some.point_mm(i));
    box.add(world.back());
  }
  const int digits = digits_for(box);
  fmt::memory_buffer text;
  fmt::format_to(std::back_inserter(text), "{}\n", kSampleHeader);
  for (const Vec3& p : world)
    fmt::format_to(std::back_inserter(text), "{:.{}g},{:.{}g},{:.{}g}\n", p.x(), digits, p.y(), digits, p.z(),
                   digits);
  std::string name = fmt::format("model-{}.csv", number);
  PALPATE_TRY(folder.write(name, {text.data(), text.size()}));
  return name;
}

Result<Study> read_study(const fs::path& folder) {
  PALPATE_ASSIGN(metrics::ResultDocument document, read_document(folder));
  Study study;
  study.document = std::move(document);
  Reading reading(folder, study);
  PALPATE_TRY(reading.truth());
  for (const metrics::StudyModel& model : study.document.models) PALPATE_TRY(reading.model(model));
  for (const metrics::RendererResult& result : study.document.renderers) PALPATE_TRY(reading.run(result));
  return study;
}

namespace {

bool all_alike(const std::vector<double>& values) {
  return std::adjacent_find(values.begin(), values.end(), std::not_equal_to<>()) == values.end();
}

Status score_run(Study& study, std::size_t i) {
  StudyRun& run = study.runs[i];
  if (run.trace.frames.empty()) return Done{};
  metrics::RendererResult& result = study.document.renderers[i];
  const std::optional<metrics::Energy> measured = result.energy;
  const std::optional<metrics::TruthSamples> answers = run.per_frame.surface;
  const metrics::ScoreBasis& basis = *study.document.scoring;
  PALPATE_TRY(score_trace(study.path, run.trace,
                          {study.reference ? &*study.reference : nullptr, nullptr, &answers}, basis, result,
                          run.per_frame));
  // A trace does not tell which of several models was touched.
  if (!all_alike(basis.felt_stiffness_n_per_mm)) result.energy = measured;
  return Done{};
}

/// Energy, also by episodes if forces have a truth; empty if impossible.
std::optional<metrics::Energy> energy_of(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                         const trace::ReferenceTrace* reference,
                                         const metrics::ScoreBasis& basis) {
  Result<metrics::Energy> energy = metrics::observe_energy(path, trace, basis.felt_stiffness_n_per_mm);
  if (!energy) return std::nullopt;
  if (reference != nullptr && basis.forces_comparable &&
      !metrics::observe_episodes(path, trace, *reference, basis.felt_stiffness_n_per_mm, *energy))
    return std::nullopt;
  return *energy;
}

}  // namespace

metrics::AccuracyOptions options_of(const metrics::ScoreBasis& basis) {
  metrics::AccuracyOptions options;
  options.stiffness_n_per_mm = basis.stiffness_n_per_mm;
  options.device_resolution_mm = basis.device_resolution_mm;
  options.stored_rounding_mm = basis.stored_rounding_mm;
  options.static_friction = basis.static_friction;
  options.dynamic_friction = basis.dynamic_friction;
  return options;
}

Status score_trace(const trace::ProbePath& path, const trace::ForceTrace& trace, const ScoreAgainst& truth,
                   const metrics::ScoreBasis& basis, metrics::RendererResult& result,
                   metrics::AccuracyFrames& per_frame) {
  const std::optional<metrics::Energy> energy = energy_of(path, trace, truth.reference, basis);
  if (truth.reference == nullptr) {
    result.energy = energy;
    return Done{};
  }
  const metrics::AccuracyOptions options = options_of(basis);
  const std::optional<metrics::TruthSamples> none;
  PALPATE_ASSIGN(
      metrics::Accuracy accuracy,
      truth.surface != nullptr
          ? metrics::score(path, trace, *truth.reference, truth.surface, options, &per_frame)
          : metrics::rescore(path, trace, *truth.reference, truth.answers != nullptr ? *truth.answers : none,
                             options, &per_frame));
  if (!basis.forces_comparable) metrics::keep_contact_scores(accuracy, per_frame);
  result.energy = energy;
  result.accuracy = std::move(accuracy);
  return Done{};
}

Status score_study(Study& study) {
  for (std::size_t i = 0; i < study.runs.size(); ++i)
    if (Status scored = score_run(study, i); !scored) {
      Error error = std::move(scored).error();
      error.what = study.document.renderers[i].label + ": " + error.what;
      return error;
    }
  return Done{};
}

}  // namespace palpate::experiments
