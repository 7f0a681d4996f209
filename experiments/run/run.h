// One renderer on a stage: prepared, replayed, timed, scored.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/geometry.h>
#include <palpate/scene.h>
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "experiments/study/study.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

/// Passes of each kind, where frames are cheap enough: fewer tell little of how much a median is worth.
inline constexpr std::uint64_t kUsualPasses = 30;
/// Of all passes of one renderer: a frame of 1 us along 50,000 frames just gets its 30.
inline constexpr double kUsualBudgetS = 6.0;

struct RunOptions {
  int threads = 0;
  std::uint64_t paced_frames = 0;
  std::string save_mesh;         ///< a PLY file for the mesh of a mesh renderer; empty: none
  std::string save_edited;       ///< a PLY file for the first model as the path left it; empty: none
  double prepare_limit_s = 0.0;  ///< preparation that takes longer is stopped and says so; 0 = none
  std::uint64_t passes = kUsualPasses;
  double budget_s = kUsualBudgetS;
  bool own_process = true;  ///< each renderer in a process of its own, where that can be had
};

/// Cold paced frames need some 10 ms each, warm ones 1 ms: a tenth as many of them.
inline constexpr std::uint64_t kWarmFramesPerEvictedFrame = 10;

struct Run {
  metrics::RendererResult result;
  trace::ForceTrace trace;            ///< empty where it failed
  metrics::AccuracyFrames per_frame;  ///< empty without a reference
  bool saved_mesh = false;
  bool own_faces = false;  ///< it feels the file's own faces, as they are
};

/// A run has news that are worth keeping: it has everything, from one pass alone, or the times of all passes.
using RunNews = std::function<Status(const RendererRequest& request, Run& run)>;

/// Runs the renderers on the stage. One after the other is prepared and replayed, paced and timed once, so
/// that what an interruption leaves is whole; then those that found room beside each other take turns in
/// random order for RunOptions::passes rounds, each warmed up before its turn. A slow one stops when its
/// budget is used up. The conditions are those of the whole. `news` may be empty. A renderer that fails to
/// prepare or does not finish is no Error: its result says so. Errors are bad input (a path whose times do
/// not increase), a mesh file that cannot be written, or those of `news`.
[[nodiscard]] Result<std::vector<Run>> run_renderers(const Stage& stage,
                                                     const std::vector<RendererRequest>& requests,
                                                     const render::Registry& registry,
                                                     const RunOptions& options, Progress& progress,
                                                     metrics::MeasurementConditions& conditions,
                                                     const RunNews& news);

/// Energy and, where there is a truth, accuracy of a run with its trace. An Error where it cannot be scored:
/// its contact flag and its force disagree.
[[nodiscard]] Status score_run(const Stage& stage, Run& run);

/// One renderer alone.
[[nodiscard]] Result<Run> run_renderer(const Stage& stage, const RendererRequest& request,
                                       const render::Registry& registry, const RunOptions& options,
                                       Progress& progress);

/// A stage with the renderers that were run on it, before it is a study: see write_study().
struct StagedStudy {
  Stage stage;
  metrics::ResultDocument document;
  std::vector<Run> runs;
};

/// Entry in a document of a renderer that has not run to its end yet.
[[nodiscard]] metrics::RendererResult unfinished(const Stage& stage, const RendererRequest& request,
                                                 const render::Registry& registry, int threads);

/// The run that an interrupted one has kept in the folder (OutputFolder::keep of result_text), with its
/// trace; false where there is none, or its trace is another one or of another stage.
[[nodiscard]] bool take_run(const OutputFolder& folder, const std::string& name, const std::string& key,
                            const Stage& stage, Run& run);

/// Fills scene and path of the document and takes over the runs' results.
void finish_document(StagedStudy& study);

/// The truth and a sample of every model; says in the document which they are, and what scores need.
[[nodiscard]] Status write_stage(StagedStudy& study, const OutputFolder& folder);
/// The run's trace and its scores frame by frame, as far as there are any; says in its result which they are.
[[nodiscard]] Status write_run(const Stage& stage, Run& run, bool alone, const OutputFolder& folder);
/// All of it, and last of all result.json.
[[nodiscard]] Status write_study(StagedStudy& study, const OutputFolder& folder);

// Warnings about models, references and paths together. Each may be fine alone; combinations are refused
// where nothing sensible can come of them, else warned of in whole sentences.

/// An Error for a model whose points are no surface.
[[nodiscard]] Status check_surfaces(const scene::LoadedScene& scene);

/// Warnings about a prepared file: damaged tiles, and frames that the finest surface did not answer.
[[nodiscard]] std::vector<std::string> warnings_about_tiles(const render::FrameCounters& counted);

/// Models far apart, or of sizes that no scene has.
[[nodiscard]] std::vector<std::string> warnings_about_models(const scene::LoadedScene& scene);

/// An Error where the truth, a mesh in the model's frame, stands elsewhere than the model; what is doubtful
/// about its size or distance.
[[nodiscard]] Result<std::vector<std::string>> warnings_about_reference(const geometry::TriangleMesh& truth,
                                                                        const render::ModelInput& model,
                                                                        const std::string& file);

/// A truth from another file that the points do not lie on.
[[nodiscard]] std::vector<std::string> warnings_about_alignment(const Stage& stage);

/// Remarks on renderers that stand on the same faces as the truth; no warning.
[[nodiscard]] std::vector<std::string> remarks_on_reference(const StagedStudy& study);

/// A path that never touches, with its nearest approach; renderers that feel nothing where others do.
[[nodiscard]] std::vector<std::string> warnings_about_contact(const StagedStudy& study);

// Where renderers answer otherwise than each other along a path: what can be said where there is no truth.

/// Stretches of 20 ms and more in which a god object is farther from the others than 1 mm and two spacings, a
/// free one standing where the HIP is: the longest few, where, for how long, and who stands alone, in whole
/// sentences. Empty where there is a truth, or fewer than two traces.
[[nodiscard]] std::vector<std::string> disagreements(const StagedStudy& study);

}  // namespace palpate::experiments
