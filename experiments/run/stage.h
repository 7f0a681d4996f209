// A stage: a scene, a probe path and the truth along it, ready for renderers to be run on, one after the
// other.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/paths.h>
#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include <palpate/trace.h>
#include "experiments/run/arguments.h"
#include "experiments/streams/open_stream.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::experiments {

enum class ReferenceChoice { kAuto, kAnalytic, kOriginalMesh, kClosest, kMeshFile, kNone };
/// "auto", "analytic", "original-mesh", "closest-point", "none", or the name of a mesh file that exists.
[[nodiscard]] Result<ReferenceChoice> parse_reference(const std::string& text);

/// Why this scene has no ground truth, whatever is named as one; empty for one model at rest.
[[nodiscard]] std::optional<Error> why_no_truth(const render::SceneInput& scene);

/// A stream of depth images that stands for the scene.
struct StreamRequest {
  std::string source;  ///< empty: none
  StreamDelay delay{};
  bool replayed = true;  ///< its images are kept for passes; false: they come while a session runs
};

struct StageRequest {
  std::string scene_name;  ///< as the user wrote it
  scene::SceneFile scene;
  scene::LoadOptions load;
  std::string path;  ///< a file or a generator; empty: usual_path()
  ReferenceChoice reference = ReferenceChoice::kAuto;
  int threads = 0;
  std::uint64_t contact_frames = 0;  ///< the path ends after so many frames of true contact; 0 = whole
  std::string reference_file{};      ///< of kMeshFile: in the model's frame, its unit and scale
  SurfaceReport surfaces{};          ///< what set_surfaces() said of the scene
  int usual_frames = kUsualFrames;   ///< of usual_path(), where no path is named
  StreamRequest stream{};
};

/// Every file that is read for it: the scene, its models, views and images.
[[nodiscard]] std::vector<std::string> files_read(const scene::SceneFile& scene);
/// The same, and the path and the truth.
[[nodiscard]] std::vector<std::string> files_read(const StageRequest& request);

struct StagedStream {
  OpenStream open;
  StreamFrames images;  ///< empty where it is not replayed
  StreamDelay delay;
};

struct Stage {
  std::string scene_name;
  scene::LoadedScene scene;
  trace::ProbePath path;
  std::optional<trace::ReferenceTrace> reference;
  std::unique_ptr<metrics::TruthSurface> truth;  ///< null without a reference
  bool starts_free = false;                      ///< the path: by the truth, or by the generator that made it
  bool forces_comparable = true;                 ///< the reference knows all that the scene asks of a surface
  search::Spacing spacing;                       ///< of the first model
  std::shared_ptr<StagedStream> stream{};        ///< replaces the first model's points, or null
  std::vector<std::string> warnings;             ///< what makes the results doubtful, whole sentences
  std::vector<std::string> notes;                ///< what a reader should know, whole sentences
};

/// Loads, makes the path, computes the reference (slow, never timed). Every Error is bad input.
[[nodiscard]] Result<Stage> set_up(const StageRequest& request, const io::Readers& readers,
                                   Progress& progress);
/// The same for a stream, called by set_up(): one model of the first image's points. Without a path a hand
/// presses and slides on the formulas of a still scene, or else on what `depth-image` makes of the stream:
/// one that followed a wall without the delay of images would be in front of what is felt, or deep in it.
[[nodiscard]] Result<Stage> set_up_stream(const StageRequest& request, const io::Readers& readers,
                                          Progress& progress);
/// The same of a scene that is loaded already, and along `path` where one is given.
[[nodiscard]] Result<Stage> set_up(scene::LoadedScene loaded, std::optional<trace::ProbePath> path,
                                   const StageRequest& request, const io::Readers& readers,
                                   Progress& progress);

// The cleaning steps of this program, and what they do to a scene for one renderer.

/// Every step that the program was built with; none without the baselines. Lives as long as the program.
[[nodiscard]] const scene::Cleaning& all_cleaning();

/// "outliers/distance=4/..+smooth/..": what parse() reads, every option in it.
[[nodiscard]] std::string cleaning_text(std::span<const NamedOptions> steps);

struct CleanedScene {
  render::SceneInput input;
  std::vector<render::PreparePhase> phases;
  std::vector<std::string> notes;
};

/// `input` with every model's points cleaned by `steps`, and without the faces that belonged to the points
/// before. Checked steps; an Error names the model.
[[nodiscard]] Result<CleanedScene> clean_scene(const render::SceneInput& input,
                                               std::span<const NamedOptions> steps, int threads,
                                               Progress& progress);

// Ground truth: the reference that follows the path, compared with one that has no history.

/// The truth along a path, and the surface that it is of.
struct GroundTruth {
  trace::ReferenceTrace reference;
  std::unique_ptr<metrics::TruthSurface> surface;
};

/// Choice among the two references for the scores; the other one shows where history decides.
enum class TruthKind {
  kFollowed,  ///< the god object that came along the path
  kClosest,   ///< the closest point of the whole surface
};

/// On model.original_mesh: the converged god object, and the closest point by a library that shares nothing
/// with the mesh renderers.
[[nodiscard]] Result<GroundTruth> ground_truth_on_mesh(const render::ModelInput& model,
                                                       const trace::ProbePath& path, double force_limit_n,
                                                       TruthKind kind, Progress& progress);

/// On model.analytic, which must outlive it.
[[nodiscard]] Result<GroundTruth> ground_truth_on_formula(const render::ModelInput& model,
                                                          const trace::ProbePath& path, double force_limit_n,
                                                          TruthKind kind, Progress& progress);

// Surface that a simulated hand feels while its path is made.

enum class FeltKind { kFormula, kFaces, kPoints };

/// The scene at rest, rigid and without friction: the formula or the faces of `truth`, its first model with
/// what is true of it, or else what the plan takes for the points. Prepares it; errors are that one's.
[[nodiscard]] Result<paths::ForceFunction> felt_of(FeltKind kind, const render::ModelInput& truth,
                                                   const render::SceneInput& scene, int threads,
                                                   Progress& progress);

}  // namespace palpate::experiments
