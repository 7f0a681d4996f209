// A study: renderers on one scene along one path. result.json names the folder's other files; reports and
// scores need nothing else. Format: docs/reference/documents.md.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

// A run's result folder: locked during the run, with a list of our files and of completed parts, so that the
// next run can resume.

/// The mark and lock file of a Palpate folder. Holds the process, an incomplete run's key, and our files'
/// names: only these are ever replaced or removed.
inline constexpr const char* kFolderMark = ".palpate-output";

/// A handle; copies and those of inside() share one folder. The last releases the lock and, if no part is
/// complete, removes what was created. Not thread-safe.
class OutputFolder {
 public:
  /// Creates the folder and its parents if missing, and locks it; contents stay until begin(). Errors:
  /// another process (named) holds it; it has contents without a mark, so they are not ours; it cannot be
  /// created, written or locked.
  [[nodiscard]] static Result<OutputFolder> open(const std::string& folder);

  /// Opens a completed run's folder, or one inside it, to add or replace files; all others stay. Errors: it
  /// does not exist or is not Palpate's; another process holds it.
  [[nodiscard]] static Result<OutputFolder> reopen(const std::string& folder);

  /// Error: one of `files`, which the run reads, is one of our files here and would be replaced.
  [[nodiscard]] Status check_not_read(std::span<const std::string> files) const;

  /// Begins a run with this key (one word: what its results depend on), or goes on from an incomplete one
  /// with the same key: its parts are there for take_over(). `record`: a file that grows case by case; the
  /// run goes on from whatever run left it, complete or not, and every file there becomes this run's. Other
  /// files of earlier runs are removed. Errors, and nothing changes: parts or record are of an incomplete run
  /// with another key; a complete run left no such record.
  enum class Begun { kAnew, kGoesOn, kGoesOnFromComplete };
  [[nodiscard]] Result<Begun> begin(const std::string& key, const std::string& record = {}) const;

  /// Starts a part: files claimed from here on belong to the next part kept.
  void start_part() const;
  /// Stores a completed part with its files and `text` to rebuild the rest. `part` is a file name shown to
  /// the user.
  [[nodiscard]] Status keep(const std::string& part, const std::string& key, const std::string& text) const;
  /// Takes over an interrupted run's part with this key if all its files are unchanged and `use` accepts its
  /// text. Its files then belong to this run.
  [[nodiscard]] bool take_over(const std::string& part, const std::string& key,
                               const std::function<bool(const std::string& text)>& use) const;

  /// Whether a part is complete, kept or taken from an incomplete run.
  [[nodiscard]] bool has_parts() const;
  /// Copies the parts that another folder's incomplete run has kept, with their files. Error: its key is not
  /// that of begin().
  [[nodiscard]] Status adopt(const std::string& folder) const;

  /// Completes the run: removes its parts and earlier runs' remains.
  [[nodiscard]] Status complete() const;

  /// A file's path, for reading and display.
  [[nodiscard]] std::filesystem::path file(const std::string& name) const { return path() / name; }
  [[nodiscard]] std::filesystem::path path() const;
  /// A file's path for writing by the caller; the file becomes ours, and a record outlasts the run from here
  /// on. Error: the name is of a file that is not ours.
  [[nodiscard]] Result<std::string> claim(const std::string& name) const;
  /// Writes a claimed file completely or not at all.
  [[nodiscard]] Status write(const std::string& name, std::string_view text) const;
  /// A folder inside, created if missing.
  [[nodiscard]] Result<OutputFolder> inside(const std::string& name) const;

 private:
  struct State;
  OutputFolder(std::shared_ptr<State> state, std::string below)
      : state_(std::move(state)), below_(std::move(below)) {}
  std::shared_ptr<State> state_;
  std::string below_;  ///< "figures/"; empty for the folder itself
};

inline constexpr const char* kResultFile = "result.json";
inline constexpr const char* kReferenceFile = "reference.csv";
inline constexpr const char* kReportFile = "report.html";
/// Points of a model in a picture; more would overlap.
inline constexpr std::size_t kSamplePoints = 20000;

/// Sample of a model's points, world frame, at the start.
struct ModelSample {
  std::string name;
  cloud::Cloud points;  ///< empty: none in the study
};

/// One renderer's files.
struct StudyRun {
  trace::ForceTrace trace;            ///< empty if it did not finish
  metrics::AccuracyFrames per_frame;  ///< empty without a truth
};

struct Study {
  metrics::ResultDocument document;
  trace::ProbePath path;  ///< empty without truth or trace
  std::optional<trace::ReferenceTrace> reference;
  std::vector<ModelSample> models;  ///< one per document.models
  std::vector<StudyRun> runs;       ///< one per document.renderers
};

/// Reads a folder of replay, compare or reproduce. Errors name a missing, incomplete or foreign file, with a
/// remedy.
[[nodiscard]] Result<Study> read_study(const std::filesystem::path& folder);

/// trace-LABEL.csv, or trace.csv if alone; likewise scores-LABEL.csv.
[[nodiscard]] std::string trace_name(const std::string& label, bool alone);
[[nodiscard]] std::string scores_name(const std::string& label, bool alone);

/// Writes model-NUMBER.csv, counted from 1: at most kSamplePoints of `points`, moved by `world_from_model`.
[[nodiscard]] Result<std::string> write_sample(const cloud::Cloud& points,
                                               const geometry::RigidTransform& world_from_model,
                                               std::size_t number, const OutputFolder& folder);

// Scores a study from traces and truth, without renderers.

[[nodiscard]] metrics::AccuracyOptions options_of(const metrics::ScoreBasis& basis);

/// A truth, and its surface's answers about the trace or the surface itself; null: none.
struct ScoreAgainst {
  const trace::ReferenceTrace* reference = nullptr;
  const metrics::TruthSurface* surface = nullptr;
  const std::optional<metrics::TruthSamples>* answers = nullptr;  ///< used without a surface
};

/// Computes energy and accuracy of a trace into `result`, with scores per frame in `per_frame`. The only such
/// place. An Error changes neither.
[[nodiscard]] Status score_trace(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                 const ScoreAgainst& truth, const metrics::ScoreBasis& basis,
                                 metrics::RendererResult& result, metrics::AccuracyFrames& per_frame);

/// Rescores every run: accuracy and per-frame scores with a truth, energy if the models feel alike (a trace
/// does not tell which was touched). Error: names the run.
[[nodiscard]] Status score_study(Study& study);

}  // namespace palpate::experiments
