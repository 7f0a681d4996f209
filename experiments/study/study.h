// A study: renderers on one scene along one path. result.json names the folder's other files; reports and
// scores need nothing else. Format: docs/reference/documents.md.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/study/output_folder.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

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
