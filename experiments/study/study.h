// A study: renderers on one scene along one path. Its folder suffices: result.json names every other file,
// and report and scores are made of nothing else. docs/studies.md describes it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "experiments/study/output_folder.h"
#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/metrics/accuracy.h"
#include "toolkit/metrics/result_json.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

inline constexpr const char* kResultFile = "result.json";
inline constexpr const char* kReferenceFile = "reference.csv";
inline constexpr const char* kReportFile = "report.html";
/// Points of a model that a picture shows: more would lie on each other.
inline constexpr std::size_t kSamplePoints = 20000;

/// Some points of a model in the world frame, where it stands at the start.
struct ModelSample {
  std::string name;
  cloud::Cloud points;  ///< empty where the study has none
};

/// What the folder holds of one renderer.
struct StudyRun {
  trace::ForceTrace trace;            ///< empty where it has not run to its end
  metrics::AccuracyFrames per_frame;  ///< empty without a truth
};

struct Study {
  metrics::ResultDocument document;
  trace::ProbePath path;  ///< empty where there is neither a truth nor a trace
  std::optional<trace::ReferenceTrace> reference;
  std::vector<ModelSample> models;  ///< one for each of document.models
  std::vector<StudyRun> runs;       ///< one for each of document.renderers
};

/// Reads a folder that replay, compare or reproduce has written. Errors name the file that is missing, half
/// written or of another study, and what to do.
[[nodiscard]] Result<Study> read_study(const std::filesystem::path& folder);

/// trace-LABEL.csv, or trace.csv of one that is alone; scores-LABEL.csv in the same way.
[[nodiscard]] std::string trace_name(const std::string& label, bool alone);
[[nodiscard]] std::string scores_name(const std::string& label, bool alone);

/// model-NUMBER.csv, counted from 1: at most kSamplePoints of `points`, moved by `world_from_model`.
[[nodiscard]] Result<std::string> write_sample(const cloud::Cloud& points,
                                               const geometry::RigidTransform& world_from_model,
                                               std::size_t number, const OutputFolder& folder);

}  // namespace palpate::experiments
