#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <palpate/generate.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include "toolkit/cloud/sampling.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/io/decoding.h"
#include "toolkit/metrics/machine_info.h"
#include "toolkit/prepared/cell_file.h"
#include "toolkit/spline_sdf/surface_file.h"

namespace palpate::scene {
namespace {

using surface::PointProperties;

constexpr double kDeepest = 65535.0;  // of 16 bits

Status fill_column(const cloud::Cloud& cloud, const std::string& name, std::vector<float>& values) {
  if (name.empty()) return Done{};
  const auto at = std::find_if(cloud.properties.begin(), cloud.properties.end(),
                               [&](const cloud::Property& p) { return p.name == name; });
  if (at != cloud.properties.end()) {
    values = at->values;
    return Done{};
  }
  const std::vector<std::string> known = names_of(cloud.properties);
  return Error{
      fmt::format("the model has no column '{}'", name),
      did_you_mean(name, known,
                   known.empty() ? "its file has none beside the coordinates" : "it has " + joined(known))};
}

/// Reads a height image of any model format: its posts, lowest 0, highest 65535.
Result<surface::TextureImage> read_image(const std::string& path, const io::Readers& readers,
                                         std::uint64_t max_bytes, Progress& progress) {
  io::ReadOptions options;
  options.max_bytes = max_bytes;
  options.unit = io::Unit::kMillimetre;
  options.non_finite = cloud::NonFinite::kRefuse;
  PALPATE_ASSIGN(const io::ReadModel read, readers.read(path, options, progress));
  const cloud::Cloud& cloud = read.cloud;
  if (!cloud.raster)
    return Error{"is no full grid of heights", "give a PFM, or a 16-bit PNG or TIFF without holes", path};
  surface::TextureImage image;
  image.columns = cloud.raster->columns;
  image.rows = cloud.raster->rows;
  const auto [low, high] = std::minmax_element(cloud.z_mm.begin(), cloud.z_mm.end());
  const double range = static_cast<double>(*high) - static_cast<double>(*low);
  image.height.reserve(cloud.size());
  for (const float z : cloud.z_mm) {
    const double share = range > 0.0 ? (static_cast<double>(z) - static_cast<double>(*low)) / range : 1.0;
    image.height.push_back(static_cast<std::uint16_t>(std::lround(share * kDeepest)));
  }
  return image;
}

/// The map seen along z, tiled, nearest pixel.
Status fill_map(const FrictionMap& map, const cloud::Cloud& cloud, const Result<surface::TextureImage>& image,
                std::vector<float>& values) {
  if (!image) return image.error();
  const double per_mm = image->columns / map.tile_mm;
  const auto tile = [](double x, double n) { return std::min(x - n * std::floor(x / n), n - 1.0); };
  values.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    const auto column = static_cast<std::size_t>(tile(p.x() * per_mm, image->columns));
    const auto row = static_cast<std::size_t>(tile(p.y() * per_mm, image->rows));
    const double share = image->height[row * image->columns + column] / kDeepest;
    values[i] = static_cast<float>(map.low + share * (map.high - map.low));
  }
  return Done{};
}

/// Fills missing values with `value`.
void widen(std::vector<float>& values, std::size_t n, double value) {
  if (values.empty()) values.assign(n, static_cast<float>(value));
}

/// Returns the number of points in the region.
std::size_t fill_region(const SceneRegion& region, const surface::Surface& base, const cloud::Cloud& cloud,
                        PointProperties& p) {
  const std::size_t n = cloud.size();
  if (region.stiffness_n_per_mm) widen(p.stiffness_n_per_mm, n, base.stiffness_n_per_mm);
  if (region.deformation) widen(p.deformation, n, base.deformation);
  if (region.friction) {
    // A single coefficient's column or map serves as both.
    if (p.dynamic_friction.empty() && !p.static_friction.empty()) p.dynamic_friction = p.static_friction;
    widen(p.static_friction, n, base.friction.static_coefficient);
    widen(p.dynamic_friction, n, base.friction.dynamic_coefficient);
  }
  std::size_t inside = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!region.box_mm.contains(cloud.point_mm(i))) continue;
    ++inside;
    if (region.stiffness_n_per_mm) p.stiffness_n_per_mm[i] = static_cast<float>(*region.stiffness_n_per_mm);
    if (region.deformation) p.deformation[i] = static_cast<float>(*region.deformation);
    if (region.friction) {
      p.static_friction[i] = static_cast<float>(region.friction->static_coefficient);
      p.dynamic_friction[i] = static_cast<float>(region.friction->dynamic_coefficient);
    }
  }
  return inside;
}

/// Fills the surface of a loaded model from columns, images and regions. Errors: a missing column, an image
/// that is unreadable or no full grid. An empty region gives a warning. Each image takes at most `max_bytes`.
/// O(points x regions).
Status resolve_surface(const SceneModel& model, const io::Readers& readers, std::uint64_t max_bytes,
                       Progress& progress, render::ModelInput& input, std::vector<std::string>& warnings) {
  input.surface = model.surface;
  const SurfaceSources& sources = model.sources;
  if (!sources.texture_image.empty()) {
    PALPATE_ASSIGN(surface::TextureImage image,
                   read_image(sources.texture_image, readers, max_bytes, progress));
    input.surface.texture.image = std::make_shared<const surface::TextureImage>(std::move(image));
  }
  auto p = std::make_shared<PointProperties>();
  const cloud::Cloud& cloud = *input.cloud;
  for (const auto& [name, values] : {std::pair{&sources.stiffness_column, &p->stiffness_n_per_mm},
                                     std::pair{&sources.static_friction_column, &p->static_friction},
                                     std::pair{&sources.dynamic_friction_column, &p->dynamic_friction},
                                     std::pair{&sources.deformation_column, &p->deformation}})
    PALPATE_TRY(fill_column(cloud, *name, *values));
  if (sources.friction_map)
    PALPATE_TRY(fill_map(*sources.friction_map, cloud,
                         read_image(sources.friction_map->image, readers, max_bytes, progress),
                         p->static_friction));
  for (const SceneRegion& region : model.regions)
    if (fill_region(region, model.surface, cloud, *p) == 0)
      warnings.push_back(fmt::format("The region in line {} holds no point of {}: it changes nothing.",
                                     region.line, model.name));
  if (p->varies_stiffness() || p->varies_friction()) input.surface.per_point = std::move(p);
  return Done{};
}

std::string hash_of(const cloud::Cloud& cloud) {
  Hash64 hash;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    for (int axis = 0; axis < 3; ++axis) hash.real(p[axis]);
  }
  return hash.hex();
}

std::string hex(std::uint64_t value) {
  return fmt::format("{:016x}", value);
}

Status load_generated(const SceneModel& model, double scale, render::ModelInput& input,
                      Provenance& provenance) {
  NamedOptions spec = *model.generate;
  if (scale != 1.0) {
    if (spec.options.has("scale"))
      return Error{fmt::format("{} is scaled twice: by its own option and by the scene or the command line",
                               model.name),
                   "keep one"};
    spec.options.set("scale", fmt::format("{}", scale));
  }
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(spec));
  provenance.source = made.spec;
  provenance.format = "generated";
  provenance.file_points = made.cloud.size();
  provenance.content_hash = hash_of(made.cloud);
  input.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  input.original_mesh = std::move(made.original_mesh);
  input.analytic = std::move(made.surface);
  return Done{};
}

/// Keeps what is in the box.
Status keep_within(const geometry::Aabb& box, std::vector<Vec3>& points,
                   std::vector<cloud::Property>& properties, io::ReadModel& got) {
  geometry::Aabb all;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    all.add(points[i]);
    if (!box.contains(points[i])) continue;
    for (cloud::Property& p : properties) p.values[kept] = p.values[i];
    points[kept++] = points[i];
  }
  if (kept == 0) return io::nothing_within(box, all);
  got.outside = points.size() - kept;
  points.resize(kept);
  for (cloud::Property& p : properties) p.values.resize(kept);
  return Done{};
}

/// Appends the points of all views to the first, with the columns common to all.
Status add_views(const SceneModel& model, const io::Readers& readers, const io::ReadOptions& read,
                 const std::optional<geometry::Aabb>& within, Progress& progress, io::ReadModel& got) {
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < got.cloud.size(); ++i) points.push_back(got.cloud.point_mm(i));
  std::vector<cloud::Property> properties = std::move(got.cloud.properties);
  for (const SceneView& view : model.views) {
    progress.report("loading " + view.cloud, -1.0);
    if (progress.cancelled()) return Error{"stopped while loading the scene"};
    PALPATE_ASSIGN(io::ReadModel more, readers.read(view.cloud, read, progress));
    if (more.unit != got.unit)
      return Error{fmt::format("is in {}, the model's first file in {}", io::unit_name(more.unit),
                               io::unit_name(got.unit)),
                   "say the unit of all files: unit = \"mm\" in the scene, or --unit", view.cloud};
    const geometry::RigidTransform pose{view.model_from_view.rotation,
                                        view.model_from_view.translation_mm * read.scale};
    for (std::size_t i = 0; i < more.cloud.size(); ++i) points.push_back(pose * more.cloud.point_mm(i));
    std::erase_if(properties, [&](cloud::Property& p) {
      const auto at = std::find_if(more.cloud.properties.begin(), more.cloud.properties.end(),
                                   [&](const cloud::Property& q) { return q.name == p.name; });
      if (at == more.cloud.properties.end()) return true;
      p.values.insert(p.values.end(), at->values.begin(), at->values.end());
      return false;
    });
    got.file_points += more.file_points;
    got.non_finite += more.non_finite;
    got.warnings.insert(got.warnings.end(), more.warnings.begin(), more.warnings.end());
  }
  if (within) PALPATE_TRY(keep_within(*within, points, properties, got));
  PALPATE_ASSIGN(cloud::Cloud merged, cloud::build_cloud(points, cloud::NonFinite::kRefuse));
  merged.properties = std::move(properties);
  got.cloud = std::move(merged);
  got.mesh = nullptr;  // of a single view
  got.format += fmt::format(", {} views merged", model.views.size() + 1);
  return Done{};
}

/// A prepared file is in mm and has its points: nothing of it is converted.
Status refuse_changes(const SceneModel& model, const io::ReadOptions& read, const LoadOptions& options,
                      bool surfaces) {
  const auto refuse = [&](std::string_view what) {
    return Error{fmt::format("is a prepared file, which {}", what),
                 "say it when the scan is prepared: palpate prepare SCAN --out FILE", model.cloud};
  };
  if (surfaces && read.within_mm)
    return Error{"is a prepared surface, which is felt whole",
                 "take a part of the scan, or of its cells: palpate prepare SCAN --out FILE.palcells",
                 model.cloud};
  if (read.scale != 1.0) return refuse("has its scale already");
  if (options.unit || (model.unit && *model.unit != io::Unit::kMillimetre))
    return refuse("has its unit already");
  if (!model.views.empty() || (surfaces && (!model.clean.empty() || model.sample)))
    return refuse("has its surface already");
  return Done{};
}

Status load_prepared(const SceneModel& model, render::ModelInput& input, Provenance& provenance) {
  PALPATE_ASSIGN(const std::shared_ptr<const spline_sdf::SurfaceFile> file,
                 spline_sdf::SurfaceFile::open(model.cloud));
  provenance.source = model.cloud;
  provenance.format = fmt::format("prepared, {} surfaces; other renderers get {} of its points",
                                  file->surfaces().size(), file->sample()->size());
  provenance.content_hash = hex(file->content_hash());
  provenance.file_points = file->points();
  input.cloud = file->sample();
  input.prepared = file;
  return Done{};
}

Status load_cells(const SceneModel& model, const io::ReadOptions& read, Progress& progress,
                  render::ModelInput& input, Provenance& provenance) {
  PALPATE_ASSIGN(const prepared::CellFile file, prepared::CellFile::open(model.cloud));
  const std::uint64_t machine = metrics::machine_info().memory_bytes;  // 0: not known
  const std::uint64_t most = machine > 0 ? std::min(read.max_bytes, machine) : read.max_bytes;
  PALPATE_ASSIGN(cloud::Cloud cloud, prepared::read_cloud(file, read.within_mm, most, progress));
  provenance.source = model.cloud;
  provenance.format = fmt::format("cells of points, {} of them, each point within {:.3g} mm", file.size(),
                                  0.5 * file.info().quantum_mm);
  provenance.content_hash = hash_of(cloud);
  provenance.file_points = static_cast<std::size_t>(file.info().points);
  provenance.outside = provenance.file_points - cloud.size();
  input.cloud = std::make_shared<const cloud::Cloud>(std::move(cloud));
  return Done{};
}

Status load_points(const SceneModel& model, const io::Readers& readers, io::ReadOptions read,
                   Progress& progress, render::ModelInput& input, Provenance& provenance) {
  const std::optional<geometry::Aabb> within = read.within_mm;
  if (!model.views.empty()) read.within_mm.reset();  // the box is of the merged points
  PALPATE_ASSIGN(io::ReadModel got, readers.read(model.cloud, read, progress));
  if (!model.views.empty()) PALPATE_TRY(add_views(model, readers, read, within, progress, got));
  provenance.source = model.cloud;
  provenance.format = got.format;
  provenance.content_hash = model.views.empty() ? hex(got.content_hash) : hash_of(got.cloud);
  provenance.unit = got.unit;
  provenance.unit_guessed = got.unit_guessed;
  provenance.file_points = got.file_points;
  provenance.non_finite = got.non_finite;
  provenance.outside = got.outside;
  provenance.warnings = got.warnings;
  if (!got.compression.empty()) provenance.format += ", " + got.compression;
  input.cloud = std::make_shared<const cloud::Cloud>(std::move(got.cloud));
  if (got.mesh != nullptr && !got.mesh->empty()) input.original_mesh = std::move(got.mesh);
  return Done{};
}

Status load_file(const SceneModel& model, double scale, const io::Readers& readers,
                 const LoadOptions& options, Progress& progress, render::ModelInput& input,
                 Provenance& provenance) {
  if (model.cloud.empty())
    return Error{fmt::format("the scan '{}' is not here", model.scan),
                 fmt::format("`palpate fetch {}` brings it", model.scan)};
  io::ReadOptions read;
  read.unit = model.unit ? model.unit : options.unit;
  read.scale = scale;
  read.non_finite = options.non_finite.value_or(read.non_finite);
  read.post_mm = options.post_mm != 0.0 ? options.post_mm : model.post_mm;
  read.vertical_mm = options.vertical_mm != 0.0 ? options.vertical_mm : model.vertical_mm;
  read.no_data = options.no_data ? options.no_data : model.no_data;
  read.within_mm = options.within_mm ? options.within_mm : model.within_mm;
  read.max_bytes = options.max_bytes;
  if (const Status right = io::check(read); !right) return Error(right.error()).in_file(model.cloud);
  const std::vector<std::byte> first = first_bytes(model.cloud);
  const bool surfaces = spline_sdf::SurfaceFile::begins_as_one(first);
  const bool cells = prepared::CellFile::begins_as_one(first);
  if (surfaces || cells) PALPATE_TRY(refuse_changes(model, read, options, surfaces));
  PALPATE_TRY(surfaces ? load_prepared(model, input, provenance)
              : cells  ? load_cells(model, read, progress, input, provenance)
                       : load_points(model, readers, read, progress, input, provenance));
  if (read.within_mm)
    provenance.source += fmt::format(" ({} of {} points, within {})", input.cloud->size(),
                                     provenance.file_points, io::box_text(*read.within_mm));
  return Done{};
}

/// Replaces the file's points by samples of its faces, which are the hidden truth.
Status take_samples(const SceneModel& model, Progress& progress, render::ModelInput& input,
                    Provenance& provenance, std::shared_ptr<const geometry::TriangleMesh>& truth) {
  if (input.original_mesh == nullptr)
    return Error{"has no faces to take points from, as 'sample' asks", "give a mesh, or leave out 'sample'",
                 model.cloud};
  progress.report("taking points of " + model.name, -1.0);
  PALPATE_ASSIGN(cloud::MeshSamples made, cloud::sample_mesh(input.original_mesh, *model.sample));
  truth = std::move(made.truth);
  provenance.source += fmt::format(" ({})", made.spec);
  provenance.content_hash = hash_of(made.cloud);
  provenance.format += fmt::format(", {} points in its faces, {:.4g} mm apart, {:.3g} of its median edge",
                                   made.cloud.size(), made.spacing_mm, made.spacing_mm / made.edge_mm);
  input.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  input.original_mesh = nullptr;
  input.analytic = nullptr;  // the faces are felt, not the formula behind them
  return Done{};
}

/// An Error for command-line options that apply to no file.
Status check_wishes(const SceneFile& scene, const LoadOptions& options) {
  const bool files = std::any_of(scene.models.begin(), scene.models.end(),
                                 [](const SceneModel& model) { return !model.generate; });
  const bool unit_open = std::any_of(scene.models.begin(), scene.models.end(),
                                     [](const SceneModel& model) { return !model.generate && !model.unit; });
  for (const auto& [given, name] :
       {std::pair(options.unit.has_value(), "--unit"), std::pair(options.post_mm != 0.0, "--post-mm"),
        std::pair(options.vertical_mm != 0.0, "--vertical-mm"),
        std::pair(options.no_data.has_value(), "--no-data"),
        std::pair(options.within_mm.has_value(), "--within"),
        std::pair(options.non_finite.has_value(), "--non-finite")})
    if (given && !files)
      return Error{fmt::format("{} is of model files, and here every model is generated", name),
                   "leave it out"};
  if (options.unit && !unit_open)
    return Error{
        "--unit does nothing: the unit of every file is said already, by the scene or the list of scans",
        "leave it out, or change it there"};
  return Done{};
}

/// Checks and completes the steps of all models before reading.
Result<std::vector<std::vector<NamedOptions>>> checked_steps(const SceneFile& scene,
                                                             const Cleaning& cleaning) {
  std::vector<std::vector<NamedOptions>> steps;
  for (const SceneModel& model : scene.models) {
    std::vector<NamedOptions>& own = steps.emplace_back();
    for (const SceneCleaningStep& clean : model.clean) {
      Result<NamedOptions> step = cleaning.check(clean.step);
      if (!step) return std::move(step).error().in_file(scene.path, clean.line);
      own.push_back(*std::move(step));
    }
  }
  return steps;
}

/// Drops the file's faces, which belong to the uncleaned points.
Status clean_model(const std::vector<NamedOptions>& steps, const Cleaning& cleaning, int threads,
                   Progress& progress, render::ModelInput& input, Provenance& provenance) {
  PALPATE_ASSIGN(CleanedCloud cleaned, cleaning.run(*input.cloud, steps, threads, progress));
  input.cloud = std::make_shared<const cloud::Cloud>(std::move(cleaned.cloud));
  input.original_mesh = nullptr;
  provenance.cleaning = std::move(cleaned.phases);
  provenance.cleaned = std::move(cleaned.notes);
  return Done{};
}

/// Adds warnings about the file or its unit.
void add_input_warnings(const cloud::Cloud& cloud, Provenance& provenance) {
  // Smaller models can hardly be explored by a hand (a coin is 20 mm).
  constexpr double kTinyMm = 1.0;
  if (const std::optional<std::string> why = cloud::degeneracy_of(cloud))
    provenance.warnings.push_back(fmt::format("The model is no surface: {}.", *why));
  const double size = cloud.box_mm().extent_mm().maxCoeff();
  const bool file_in_mm = provenance.format != "generated" && provenance.unit == io::Unit::kMillimetre;
  if (file_in_mm && size > 0.0 && size < kTinyMm)
    provenance.warnings.push_back(
        fmt::format("The model is {:.3g} mm across: is its file in metres (--unit m, or unit = \"m\" in "
                    "scene or Python)?",
                    size));
}

render::ScriptedMotion motion_of(const SceneModel& model) {
  render::ScriptedMotion motion;
  motion.start = model.world_from_model;
  motion.velocity_mm_s = model.motion->velocity_mm_s;
  motion.angular_velocity_rad_s = model.motion->turn_rad_s;
  motion.about_mm = model.motion->about_mm.value_or(model.world_from_model.translation_mm);
  motion.start_s = model.motion->start_s;
  motion.stop_s = model.motion->stop_s.value_or(HUGE_VAL);
  return motion;
}

}  // namespace

Result<LoadedScene> load(const SceneFile& scene, const io::Readers& readers, const LoadOptions& options,
                         Progress& progress) {
  LoadedScene loaded;
  loaded.input.force_limit_n = scene.force_limit_n;
  loaded.control = scene.control;
  loaded.view_up = scene.view_up;
  if (const Status fit = check_wishes(scene, options); !fit) return Error(fit.error()).in_file(scene.path);
  const Cleaning none;
  const Cleaning& cleaning = options.cleaning != nullptr ? *options.cleaning : none;
  PALPATE_ASSIGN(const std::vector<std::vector<NamedOptions>> steps, checked_steps(scene, cleaning));
  std::shared_ptr<render::ScriptedSimulation> simulation;
  for (const SceneModel& model : scene.models) {
    progress.report("loading " + model.name, -1.0);
    if (progress.cancelled()) return Error{"stopped while loading the scene"};
    render::ModelInput input;
    Provenance provenance;
    const double scale = options.scale.value_or(model.scale);
    Status status = model.generate ? load_generated(model, scale, input, provenance)
                                   : load_file(model, scale, readers, options, progress, input, provenance);
    std::shared_ptr<const geometry::TriangleMesh>& truth = loaded.sampled_mesh.emplace_back();
    if (status && model.sample) status = take_samples(model, progress, input, provenance, truth);
    if (const auto& own = steps[loaded.input.models.size()]; status && !own.empty())
      status = clean_model(own, cleaning, options.threads, progress, input, provenance);
    if (!status)
      return model.line > 0 ? Error(status.error()).in_file(scene.path, model.line) : status.error();
    add_input_warnings(*input.cloud, provenance);
    input.name = model.name;
    input.world_from_model = model.world_from_model;
    if (const Status resolved =
            resolve_surface(model, readers, options.max_bytes, progress, input, provenance.warnings);
        !resolved)
      return model.line > 0 && resolved.error().file.empty()
                 ? Error(resolved.error()).in_file(scene.path, model.sources.line)
                 : resolved.error();
    if (model.motion) {
      if (simulation == nullptr)
        simulation = std::make_shared<render::ScriptedSimulation>(scene.simulation_hz);
      input.motion = simulation->add(motion_of(model));
    }
    loaded.input.models.push_back(std::move(input));
    loaded.provenance.push_back(std::move(provenance));
  }
  loaded.input.simulation = std::move(simulation);
  return loaded;
}

}  // namespace palpate::scene
