#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "experiments/behaviours/matrix.h"
#include "experiments/command/reproduction.h"
#include "experiments/data/scene_scans.h"

namespace palpate::experiments {
namespace {

std::filesystem::path whole_path(const std::filesystem::path& path) {
  return std::filesystem::absolute(path).lexically_normal();
}

void finish(Reproduction& r) {
  r.context.progress.set_prefix("");
  r.context.progress.report("writing the report", -1.0);
  HeadlineGroup missing{"Not done", {}};
  for (const std::string& what : r.missing) missing.lines.push_back({"", what});
  if (!missing.lines.empty()) r.page.headlines.push_back(std::move(missing));
  r.page.commands.push_back("palpate reproduce --help    # shorter and longer runs");
  if (const Status written = write_page(r.page, r.folder); !written) {
    fail(written.error(), kExitFellShort, &r.context.progress);
    r.fell_short = true;
  }
  r.context.progress.clear();
  for (const Table& table : r.tables) fmt::print("{}\n", to_text(table));
  for (const std::string& what : r.missing) fmt::print("not done: {}\n", what);
  fmt::print("took {}\nreport: {}\n", duration_text(r.watch.ms()),
             whole_path(r.folder.file("report.html")).string());
}

}  // namespace

namespace {

Result<scene::SceneFile> embedded_scene(const std::string& name) {
  for (const EmbeddedManifest& scene : embedded_scenes())
    if (name == scene.name) return scene::parse_scene(scene.text, name);
  return Error{fmt::format("there is no scene '{}'", name), {}, {}, 0};
}

/// A quick trial keeps the scene and takes a small model.
Status make_quick(scene::SceneFile& scene, const std::string& generator) {
  Result<NamedOptions> named = parse_named_options(generator);
  if (!named) return std::move(named).error();
  scene::SceneModel& model = scene.models.front();
  model.generate = *std::move(named);
  model.name = model.generate->name;
  model.cloud.clear();
  model.scan.clear();
  model.unit.reset();
  model.scale = 1.0;
  return Done{};
}

}  // namespace

double mesh_limit_s(const Reproduction& r) {
  constexpr double kInTimeS = 120.0;  // a run of minutes
  if (r.arguments.mesh_limit_s >= 0.0) return r.arguments.mesh_limit_s;
  return r.arguments.full ? 0.0 : kInTimeS;
}

Result<scene::SceneFile> scene_of(const ManifestModel& model, Reproduction& r) {
  Result<scene::SceneFile> scene = Error{};
  if (!model.scene.empty()) {
    scene = embedded_scene(model.scene);
  } else if (!model.generate.empty()) {
    scene = scene::open_scene(model.in_time.empty() || r.arguments.full ? model.generate : model.in_time);
  } else {
    scene = scene::SceneFile{};
    scene->path = model.scan;
    scene->models.emplace_back();
    scene->models.front().name = scene->models.front().scan = model.scan;
    scene->models.front().scale = model.scale;
  }
  if (!scene) return scene;
  if (r.arguments.quick && !model.quick.empty()) {
    if (const Status quick = make_quick(*scene, model.quick); !quick) return quick.error();
    return scene;
  }
  const Status found = find_scans(*scene, true, r.context.progress);
  if (found) return scene;
  if (model.stand_in.empty()) return found.error();
  r.stand_ins.push_back(fmt::format("{}: {}", model.name, found.error().message()));
  return embedded_scene(model.stand_in);
}

namespace {

/// Every method on the behaviour suite.
void watch_behaviours(Reproduction& r) {
  Result<std::vector<Behaviour>> suite = behaviour_suite(r.context.progress);
  if (!suite) return give_up(r, "the behaviour suite", suite.error());
  const BehaviourMatrix matrix = run_behaviours(*std::move(suite), methods_of(r.registry), r.registry,
                                                r.arguments.threads, r.context.progress);
  r.context.progress.report("drawing the figures", -1.0);
  add_behaviours(r.page, matrix, r.folder);
  r.tables.push_back(matrix_table(matrix));
  if (const Status written = r.folder.write("behaviours.json", matrix_json(matrix)); !written)
    give_up(r, "behaviours.json", written.error());
}

}  // namespace

int run_reproduce(const ReproduceArguments& arguments, Context& context) {
  const Result<std::vector<Manifest>> manifests = manifests_for(arguments.tables);
  if (!manifests) return fail(manifests.error(), kExitBadInput);
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput);
  if (arguments.no_cache) ::setenv("PALPATE_MESH_CACHE", "off", 1);  // for the renderers too
  Reproduction r{arguments,
                 context,
                 *folder,
                 all_renderers(),
                 all_readers(),
                 begin_page("The thesis's tables, measured again", new_document(context.command_line)),
                 {},
                 {},
                 {},
                 false,
                 {}};
  const bool all = arguments.tables.empty() && !arguments.quick;
  std::size_t step = 0;
  const std::size_t steps = manifests->size() + (all ? 2 : 0);
  for (const Manifest& manifest : *manifests) {
    context.progress.set_prefix(fmt::format("[{}/{}] table {}: ", ++step, steps, manifest.table));
    if (manifest.kind == Manifest::Kind::kNeighbours)
      reproduce_neighbours(manifest, r);
    else if (manifest.kind == Manifest::Kind::kMethods)
      reproduce_methods(manifest, r);
    else if (manifest.kind == Manifest::Kind::kMeshes)
      reproduce_meshes(manifest, r);
    else
      reproduce_frames(manifest, r);
    if (context.progress.cancelled())
      return fail({"stopped", "the results so far are in " + arguments.out, {}, 0}, kExitFellShort,
                  &context.progress);
  }
  if (all) {
    context.progress.set_prefix(fmt::format("[{}/{}] behaviours: ", steps - 1, steps));
    watch_behaviours(r);
    context.progress.set_prefix(fmt::format("[{}/{}] growth: ", steps, steps));
    measure_growth(r);
  }
  finish(r);
  return r.fell_short ? kExitFellShort : kExitOk;
}

}  // namespace palpate::experiments
