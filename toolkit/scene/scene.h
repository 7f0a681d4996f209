// Scenes: which models stand where, what their surfaces do, and with which renderer. The schema is
// docs/scene.md.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/core/options.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/core/words.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/io/read_model.h"
#include "toolkit/render/renderer.h"
#include "toolkit/scene/cleaning.h"
#include "toolkit/surface/surface.h"

namespace palpate::scene {

/// A coefficient that an image spreads over a model, seen along z and tiled: its lowest value gives `low`,
/// its highest `high`.
struct FrictionMap {
  std::string image;  ///< path of a height image or grid
  double tile_mm = 0.0;
  double low = 0.0, high = 0.0;
};

/// What [model.surface] takes from columns of the file or from images; empty names: nothing.
struct SurfaceSources {
  std::string stiffness_column, static_friction_column, dynamic_friction_column, deformation_column;
  std::optional<FrictionMap> friction_map;
  std::string texture_image;
  std::int64_t line = 0;
};

/// One [[model.region]]: a box in the model frame, mm, in which properties differ. Later regions win.
struct SceneRegion {
  geometry::Aabb box_mm;
  std::optional<double> stiffness_n_per_mm;
  std::optional<surface::Friction> friction;
  std::optional<double> deformation;
  std::int64_t line = 0;
};

/// [model.motion]; the pose it starts from is the model's.
struct SceneMotion {
  Vec3 velocity_mm_s = Vec3::Zero();
  Vec3 turn_rad_s = Vec3::Zero();
  std::optional<Vec3> about_mm;  ///< world; empty: the model's position
  double start_s = 0.0;
  std::optional<double> stop_s;
};

/// One [[model.view]]: a further file of the same object, as its scanner stood elsewhere.
struct SceneView {
  std::string cloud;                         ///< path, resolved against the scene file
  geometry::RigidTransform model_from_view;  ///< in mm after the unit, before the scale
};

/// One [[model.clean]]: a step of cleaning, checked when the scene is loaded.
struct SceneClean {
  NamedOptions step;
  std::int64_t line = 0;
};

/// One [[model]] of a scene: a file, a scan known by name or a generator, only one of them.
struct SceneModel {
  std::string name;              ///< file name without folders and endings, or the generator's name
  std::string cloud;             ///< path of the file, resolved against the scene file; or empty
  std::string scan;              ///< a scan known by name; who knows where it lies sets `cloud` before load()
  std::vector<SceneView> views;  ///< of files: merged with the first by their poses, in order
  std::optional<NamedOptions> generate;  ///< the generator with its options
  std::optional<NamedOptions> sample;    ///< of what has faces: points in these instead of its own
  std::vector<SceneClean> clean;         ///< steps, in order
  std::optional<io::Unit> unit;          ///< of the file; empty: what the file says, else a guess
  double scale = 1.0;                    ///< multiplies all lengths after the unit
  double post_mm = 0.0;                  ///< of height grids: distance of posts; 0: as the file says
  double vertical_mm = 0.0;              ///< of height grids: mm a unit of height; 0: as the file says
  std::optional<double> no_data;         ///< of height grids: io::ReadOptions
  geometry::RigidTransform world_from_model;
  surface::Surface surface;
  SurfaceSources sources;
  std::vector<SceneRegion> regions;
  std::optional<SceneMotion> motion;
  std::int64_t line = 0;  ///< in the scene file; 0 where there is none
};

/// A scene as written, nothing loaded.
struct SceneFile {
  std::string path;                ///< the file, or the model or generator it was made from
  std::vector<SceneModel> models;  ///< at least one
  std::optional<NamedOptions> renderer;
  std::int64_t renderer_line = 0;                ///< of [renderer]
  double simulation_hz = render::kSimulationHz;  ///< how often poses are published
  double force_limit_n = 0.0;                    ///< 0 = none
  control::ControlOptions control;  ///< the rest of [control]; stages around whatever renderer runs
  std::string
      view_up;  ///< [view]: what is up in pictures, "-y" or the like; empty: not said. Nobody feels it
};

/// Largest scene file that is read: a thousand models take some 300 kB.
inline constexpr std::size_t kMaxSceneBytes = std::size_t{1} << 20;

/// Parses a TOML scene. Unknown keys are errors with line, column and the nearest known key; keys that belong
/// to later versions say so. Relative paths are resolved against the folder of `path`.
[[nodiscard]] Result<SceneFile> parse_scene(std::string_view text, const std::string& path);
[[nodiscard]] Result<SceneFile> read_scene(const std::string& path);

/// The keys of one table of a scene file, of all its kinds.
struct TableKeys {
  std::string table;  ///< "model.surface.dent"; inline tables count to the one that they stand in
  std::vector<std::string> keys;
};
/// Every key that parse_scene reads, but for the options of generators, renderers and cleaning steps, which
/// have tables of their own.
[[nodiscard]] std::vector<TableKeys> scene_keys();

/// What the commands call SCENE: a .toml file, a generator with options ("sinusoid:points=10201:seed=1"), or
/// a model file. A file wins over a generator of the same name.
[[nodiscard]] Result<SceneFile> open_scene(const std::string& argument);

/// The command line's wishes for model files.
struct LoadOptions {
  std::optional<io::Unit> unit;  ///< for files whose scene does not say it
  std::optional<double> scale;   ///< replaces the scene's scale of every model
  double post_mm = 0.0;          ///< height grids: io::ReadOptions
  double vertical_mm = 0.0;
  std::optional<double> no_data;
  std::optional<cloud::NonFinite> non_finite;   ///< else dropped
  std::uint64_t max_bytes = kMemoryLimitBytes;  ///< io::ReadOptions, of every file that is read
  const Cleaning* cleaning = nullptr;           ///< the steps that [[model.clean]] may name; null: none
  int threads = 0;                              ///< of cleaning; 0 = all
};

/// Where a loaded model came from, for reports.
struct Provenance {
  std::string source;        ///< file, or the generator with every option
  std::string format;        ///< "PLY, ASCII", "generated", ..
  std::string content_hash;  ///< of the coordinates in mm: sixteen hexadecimal digits
  io::Unit unit = io::Unit::kMillimetre;
  bool unit_guessed = false;
  std::size_t file_points = 0;  ///< before dropping
  std::size_t non_finite = 0;   ///< dropped
  std::vector<std::string> warnings;
  std::vector<render::PreparePhase> cleaning;  ///< the steps of [[model.clean]], timed
  std::vector<std::string> cleaned;            ///< what each of them did
};

struct LoadedScene {
  render::SceneInput input;
  control::ControlOptions control;     ///< as in the file
  std::string view_up;                 ///< as in the file
  std::vector<Provenance> provenance;  ///< one per model
  /// One per model: the mesh that the points were taken from by `sample`, which is their truth and which no
  /// renderer sees; null where they are the file's own.
  std::vector<std::shared_ptr<const geometry::TriangleMesh>> sampled_mesh;
};

/// Reads or generates every model. Reports progress; an Error names the file that failed.
[[nodiscard]] Result<LoadedScene> load(const SceneFile& scene, const io::Readers& readers,
                                       const LoadOptions& options, Progress& progress);

using palpate::nearest_name;

}  // namespace palpate::scene
