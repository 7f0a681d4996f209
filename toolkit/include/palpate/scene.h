// Scenes, their files, and the cleaning of raw scans.
// A scene is models with poses and surfaces, and the renderer; its schema is docs/reference/scene-keys.md.
// Cleaning is named steps, one after the other before preparation: libraries supply the steps
// (baselines/cleaning has CGAL's); scenes handle options, order, times and point correspondence.
//
// First:
//   auto file = palpate::scene::open_scene("dragon.toml");
//   if (!file) return failed(file.error());  // file, line, remedy
//   auto loaded = palpate::scene::load(*file, readers, {}, palpate::no_progress());
//   if (!loaded) return failed(loaded.error());
//   const palpate::render::SceneInput& scene = loaded->input;
//
// Cleaning:
//   palpate::scene::Cleaning cleaning;
//   palpate::baselines::register_cleaning(cleaning);
//   auto steps = cleaning.parse("outliers/distance=3+smooth");
//   auto clean = cleaning.run(cloud, *steps, 0, palpate::no_progress());
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/control.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/surface.h>
#include <palpate/vec.h>

namespace palpate::scene {

struct CleaningStepInput {
  const cloud::Cloud& cloud;  ///< not empty
  const Options& options;     ///< complete and validated
  double spacing_mm;          ///< square root of the occupied area per point, above 0; the unit of all
                              ///< lengths
  int threads;                ///< 0 = all
  Progress& progress;
};

/// "The nearest point of the input", in CleaningStepOutput::from.
inline constexpr std::uint32_t kNearestInputPoint = 0xFFFFFFFFu;

/// A step's output: first the points that stayed in place, then the moved or new points.
struct CleaningStepOutput {
  /// Per point: the index of the input point that it is, or takes its properties from.
  std::vector<std::uint32_t> from;
  /// Positions of the last new_points_mm.size() points, relative to the input's origin.
  std::vector<Vec3> new_points_mm;
  std::string note;  ///< a further finding for the user, or empty
};

struct CleaningStep {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< paper and library
  std::vector<OptionSpec> options;
  /// The step's function: it may fail and must not throw. The result does not depend on the number of
  /// threads.
  std::function<Result<CleaningStepOutput>(const CleaningStepInput& input)> run;
};

struct CleanedCloud {
  cloud::Cloud cloud;
  std::vector<std::uint32_t> from;           ///< index in the given cloud, as in CleaningStepOutput
  std::vector<render::PreparePhase> phases;  ///< one per step: "cleaning: outliers"
  std::vector<std::string> notes;            ///< "outliers: 12 of 4,000 points removed"
};

/// The available steps. Add them before use; the const members are thread-safe.
class Cleaning {
 public:
  /// A repeated name is a programming error (asserted).
  void add(CleaningStep step);
  [[nodiscard]] const std::vector<CleaningStep>& all() const noexcept { return steps_; }
  [[nodiscard]] const CleaningStep* find(std::string_view name) const noexcept;

  /// `step` with its options complete. An Error lists the known names or options.
  [[nodiscard]] Result<NamedOptions> check(const NamedOptions& step) const;
  /// Parses and checks "outliers/distance=3+smooth": steps joined by +, options after slashes.
  [[nodiscard]] Result<std::vector<NamedOptions>> parse(std::string_view text) const;

  /// Runs checked steps in order. Points keep their properties; moved and new points take those of their
  /// source point. The raster is kept if every point keeps its place in it. Errors: those of a step, and an
  /// empty result.
  [[nodiscard]] Result<CleanedCloud> run(const cloud::Cloud& cloud, std::span<const NamedOptions> steps,
                                         int threads, Progress& progress) const;

 private:
  std::vector<CleaningStep> steps_;
};

/// A coefficient spread over a model by a tiled image seen along z: the lowest value gives `low`, the highest
/// `high`.
struct FrictionMap {
  std::string image;  ///< path of a height image or grid
  double tile_mm = 0.0;
  double low = 0.0, high = 0.0;
};

/// Columns or images that give properties of [model.surface]; empty names: none.
struct SurfaceSources {
  std::string stiffness_column, static_friction_column, dynamic_friction_column, deformation_column;
  std::optional<FrictionMap> friction_map;
  std::string texture_image;
  std::int64_t line = 0;
};

/// One [[model.region]]: a box in the model frame, mm, with its own properties. Later regions win.
struct SceneRegion {
  geometry::Aabb box_mm;
  std::optional<double> stiffness_n_per_mm;
  std::optional<surface::Friction> friction;
  std::optional<double> deformation;
  std::int64_t line = 0;
};

/// [model.motion]; it starts at the model's pose.
struct SceneMotion {
  Vec3 velocity_mm_s = Vec3::Zero();
  Vec3 turn_rad_s = Vec3::Zero();
  std::optional<Vec3> about_mm;  ///< world; empty: the model's position
  double start_s = 0.0;
  std::optional<double> stop_s;
};

/// One [[model.view]]: a further scan of the same object from another place.
struct SceneView {
  std::string cloud;                         ///< path, resolved against the scene file
  geometry::RigidTransform model_from_view;  ///< mm; applied after the unit, before the scale
};

/// One [[model.clean]]: a cleaning step, checked when the scene is loaded.
struct SceneCleaningStep {
  NamedOptions step;
  std::int64_t line = 0;
};

/// One [[model]] of a scene: exactly one of a file, a scan known by name, or a generator.
struct SceneModel {
  std::string name;              ///< file name without folders and extensions, or the generator's name
  std::string cloud;             ///< file path, resolved against the scene file; or empty
  std::string scan;              ///< a scan known by name; the application resolves it to `cloud` before
                                 ///< load()
  std::vector<SceneView> views;  ///< further files, merged by their poses, in order
  std::optional<NamedOptions> generate;  ///< the generator with its options
  std::optional<NamedOptions> sample;    ///< for models with faces: samples points on them
  std::vector<SceneCleaningStep> clean;  ///< in order
  std::optional<io::Unit> unit;          ///< unit of the file; empty: the file's statement, else a guess
  double scale = 1.0;                    ///< multiplies all lengths after the unit
  double post_mm = 0.0;                  ///< height grids: post distance; 0: the file's
  double vertical_mm = 0.0;              ///< height grids: mm per unit of height; 0: the file's
  std::optional<double> no_data;         ///< height grids: see io::ReadOptions
  /// Of a file: keeps the points in this box alone, mm, in the model's frame (after unit, scale and views,
  /// before cleaning and pose). Of a file of cells only those that the box overlaps are read.
  std::optional<geometry::Aabb> within_mm;
  geometry::RigidTransform world_from_model;
  surface::Surface surface;
  SurfaceSources sources;
  std::vector<SceneRegion> regions;
  std::optional<SceneMotion> motion;
  std::int64_t line = 0;  ///< in the scene file; 0 if none
};

/// A parsed scene; nothing is loaded.
struct SceneFile {
  std::string path;                ///< the file, or the model or generator that stands for it
  std::vector<SceneModel> models;  ///< at least one
  std::optional<NamedOptions> renderer;
  std::int64_t renderer_line = 0;                ///< line of [renderer]
  double simulation_hz = render::kSimulationHz;  ///< rate at which poses are published
  double force_limit_n = 0.0;                    ///< 0 = none
  control::ControlOptions control;               ///< the rest of [control]: stages around any renderer
  std::string view_up;  ///< [view]: up direction for pictures, such as "-y"; empty: not given. Never felt
};

/// Largest scene file that is read; a thousand models take some 300 kB.
inline constexpr std::size_t kMaxSceneBytes = std::size_t{1} << 20;

/// Parses a TOML scene. Unknown keys are Errors with line, column and the nearest known key; keys of later
/// versions say so. Relative paths are resolved against the folder of `path`.
[[nodiscard]] Result<SceneFile> parse_scene(std::string_view text, const std::string& path);
[[nodiscard]] Result<SceneFile> read_scene(const std::string& path);

/// The keys of one table of a scene file.
struct TableKeys {
  std::string table;  ///< "model.surface.dent"; inline tables belong to their table
  std::vector<std::string> keys;
};
/// Every key that parse_scene reads, except the options of generators, renderers and cleaning steps.
[[nodiscard]] std::vector<TableKeys> scene_keys();

/// Opens a SCENE argument: a .toml file, a generator with options ("sinusoid:points=10201:seed=1"), or a
/// model file. A file wins over a generator of the same name.
[[nodiscard]] Result<SceneFile> open_scene(const std::string& argument);

/// Command-line options for model files.
struct LoadOptions {
  std::optional<io::Unit> unit;  ///< for files whose scene gives none
  std::optional<double> scale;   ///< replaces the scene's scale of every model
  double post_mm = 0.0;          ///< height grids: see io::ReadOptions
  double vertical_mm = 0.0;
  std::optional<double> no_data;
  std::optional<geometry::Aabb> within_mm;      ///< replaces the scene's of every model with a file
  std::optional<cloud::NonFinite> non_finite;   ///< default: dropped
  std::uint64_t max_bytes = kMemoryLimitBytes;  ///< see io::ReadOptions; for every file
  const Cleaning* cleaning = nullptr;           ///< the steps that [[model.clean]] may name; null: none
  int threads = 0;                              ///< for cleaning; 0 = all
};

/// The origin of a loaded model, for reports.
struct Provenance {
  std::string source;        ///< file, with the box that was taken of it, or the generator with every option
  std::string format;        ///< "PLY, ASCII", "generated", ..
  std::string content_hash;  ///< of the coordinates in mm; sixteen hexadecimal digits
  io::Unit unit = io::Unit::kMillimetre;
  bool unit_guessed = false;
  std::size_t file_points = 0;  ///< before dropping
  std::size_t non_finite = 0;   ///< dropped
  std::size_t outside = 0;      ///< left out by within_mm
  std::vector<std::string> warnings;
  std::vector<render::PreparePhase> cleaning;  ///< steps of [[model.clean]] with times
  std::vector<std::string> cleaned;            ///< what each step did
};

struct LoadedScene {
  render::SceneInput input;
  control::ControlOptions control;     ///< as in the file
  std::string view_up;                 ///< as in the file
  std::vector<Provenance> provenance;  ///< one per model
  /// Per model: the mesh that `sample` took points from. It is the truth and hidden from renderers. Null for
  /// a file's own points.
  std::vector<std::shared_ptr<const geometry::TriangleMesh>> sampled_mesh;
};

/// Reads or generates every model, with progress. An Error names the file that failed.
[[nodiscard]] Result<LoadedScene> load(const SceneFile& scene, const io::Readers& readers,
                                       const LoadOptions& options, Progress& progress);

}  // namespace palpate::scene
