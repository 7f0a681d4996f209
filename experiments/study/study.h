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

}  // namespace palpate::experiments
