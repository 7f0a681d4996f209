// One renderer on a stage: prepared, replayed, timed, scored.
#pragma once

#include <string>
#include <vector>

#include "experiments/run/arguments.h"
#include "experiments/run/output_folder.h"
#include "experiments/run/stage.h"
#include "toolkit/metrics/accuracy.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

struct RunOptions {
  int threads = 0;
  std::uint64_t paced_frames = 0;
  std::string save_mesh;         ///< a PLY file for the mesh of a mesh renderer; empty: none
  std::string save_edited;       ///< a PLY file for the first model as the path left it; empty: none
  double prepare_limit_s = 0.0;  ///< preparation that takes longer is stopped and says so; 0 = none
};

/// Cold paced frames need some 10 ms each, warm ones 1 ms: a tenth as many of them.
inline constexpr std::uint64_t kWarmFramesPerEvictedFrame = 10;

struct Run {
  metrics::RendererResult result;
  trace::ForceTrace trace;            ///< empty where it failed
  metrics::AccuracyFrames per_frame;  ///< empty without a reference
  bool saved_mesh = false;
};

/// A renderer that fails to prepare or does not finish is no Error: its result says so. Errors are bad input
/// (a path that starts inside the model) or a mesh file that cannot be written.
[[nodiscard]] Result<Run> run_renderer(const Stage& stage, const RendererRequest& request,
                                       const render::Registry& registry, const RunOptions& options,
                                       Progress& progress);

/// A stage with the renderers that were run on it.
struct Study {
  std::string name;  ///< short, begins its headlines; may be empty
  std::string title;
  std::string text;  ///< what it is about, a sentence or two
  Stage stage;
  metrics::ResultDocument document;
  std::vector<Run> runs;
};

/// Fills scene and path of the document and takes over the runs' results.
void finish_document(Study& study);

/// trace-LABEL.csv for every run (trace.csv where there is only one), reference.csv, and last of all
/// result.json.
[[nodiscard]] Status write_study(const Study& study, const OutputFolder& folder);

}  // namespace palpate::experiments
