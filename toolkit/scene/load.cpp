#include <fmt/format.h>

#include <cmath>

#include "toolkit/cloud/generate.h"
#include "toolkit/core/hash.h"
#include "toolkit/scene/scene.h"
#include "toolkit/scene/surface_sources.h"

namespace palpate::scene {
namespace {

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
                   "keep one",
                   {},
                   0};
    spec.options.set("scale", fmt::format("{}", scale));
  }
  Result<cloud::GeneratedModel> made = cloud::generate(spec);
  if (!made) return std::move(made).error();
  provenance.source = made->spec;
  provenance.format = "generated";
  provenance.file_points = made->cloud.size();
  provenance.content_hash = hash_of(made->cloud);
  input.cloud = std::make_shared<const cloud::Cloud>(std::move(made->cloud));
  input.original_mesh = std::move(made->original_mesh);
  input.analytic = std::move(made->surface);
  return Done{};
}

Status load_file(const SceneModel& model, double scale, const io::Readers& readers,
                 const LoadOptions& options, Progress& progress, render::ModelInput& input,
                 Provenance& provenance) {
  if (model.cloud.empty())
    return Error{fmt::format("the scan '{}' is not here", model.scan),
                 fmt::format("`palpate fetch {}` brings it", model.scan),
                 {},
                 0};
  io::ReadOptions read;
  read.unit = model.unit ? model.unit : options.unit;
  read.scale = scale;
  read.non_finite = options.non_finite;
  read.post_mm = options.post_mm > 0.0 ? options.post_mm : model.post_mm;
  read.vertical_mm = options.vertical_mm > 0.0 ? options.vertical_mm : model.vertical_mm;
  Result<io::ReadModel> got = readers.read(model.cloud, read, progress);
  if (!got) return std::move(got).error();
  provenance = {model.cloud,       got->format,      hex(got->content_hash), got->unit,
                got->unit_guessed, got->file_points, got->non_finite,        got->warnings};
  if (!got->compression.empty()) provenance.format += ", " + got->compression;
  input.cloud = std::make_shared<const cloud::Cloud>(std::move(got->cloud));
  if (got->mesh != nullptr && !got->mesh->empty()) input.original_mesh = std::move(got->mesh);
  return Done{};
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
  std::shared_ptr<render::ScriptedSimulation> simulation;
  for (const SceneModel& model : scene.models) {
    progress.report("loading " + model.name, -1.0);
    if (progress.cancelled()) return Error{"stopped while loading the scene", {}, {}, 0};
    render::ModelInput input;
    Provenance provenance;
    const double scale = options.scale.value_or(model.scale);
    const Status status = model.generate
                              ? load_generated(model, scale, input, provenance)
                              : load_file(model, scale, readers, options, progress, input, provenance);
    if (!status)
      return model.line > 0 ? Error(status.error()).in_file(scene.path, model.line) : status.error();
    input.name = model.name;
    input.world_from_model = model.world_from_model;
    if (const Status resolved = resolve_surface(model, readers, progress, input); !resolved)
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
