#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>

#include "experiments/behaviours/matrix.h"
#include "experiments/data/locate.h"
#include "experiments/data/scene_scans.h"
#include "experiments/session/run_key.h"
#include "experiments/session/terminal.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

std::filesystem::path whole_path(const std::filesystem::path& path) {
  return std::filesystem::absolute(path).lexically_normal();
}

void finish(Reproduction& r) {
  r.context.progress.set_prefix("");
  r.context.progress.report("writing the report", -1.0);
  finish_page(r.page, r.missing);
  Status written = r.folder.write(kReproductionFile, reproduction_json(r.page.title, r.page.about, r.steps));
  if (written) written = write_page(r.page, r.folder);
  if (written) written = r.folder.complete();
  if (!written) {
    fail(written.error(), kExitFellShort, &r.context.progress);
    r.fell_short = true;
  }
  r.context.progress.clear();
  for (const Table& table : r.tables) fmt::print("{}\n", to_text(table, terminal_columns(STDOUT_FILENO)));
  for (const Known& known : r.page.known)
    for (const std::string& warning : known.warnings)
      tell("palpate: warning: {}: {}\n", known.about, warning);
  for (const std::string& what : r.missing) fmt::print("not done: {}\n", what);
  fmt::print("took {}\nreport: {}\n", duration_text(r.watch.ms()),
             whole_path(r.folder.file("report.html")).string());
}

}  // namespace

namespace {

constexpr const char* kMeshLimit = "mesh_time_limit_s";

/// Whether anything is reconstructed for the table.
bool reconstructs(const Manifest& manifest, const render::Registry& registry) {
  if (manifest.kind == Manifest::Kind::kMeshes || manifest.kind == Manifest::Kind::kMethods) return true;
  return std::any_of(manifest.runs.begin(), manifest.runs.end(), [&](const ManifestRun& run) {
    const Result<NamedOptions> named = parse_named_options(run.renderer);
    const render::RendererInfo* info = named ? registry.find(named->name) : nullptr;
    return info != nullptr && option_acts(kMeshLimit, named->options, info->options);
  });
}

/// What is said about reconstructions does nothing where none is made.
Status check_mesh_arguments(const ReproduceArguments& arguments, const std::vector<Manifest>& manifests,
                            const render::Registry& registry) {
  const bool given = arguments.mesh_limit_s >= 0.0 || arguments.no_cache;
  if (!given || std::any_of(manifests.begin(), manifests.end(),
                            [&](const Manifest& m) { return reconstructs(m, registry); }))
    return Done{};
  return Error{"--mesh-limit and --no-cache do nothing: no table that was chosen makes a mesh",
               "leave them out",
               {},
               0};
}

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

void limit_reconstruction(RendererRequest& request, const Reproduction& r) {
  if (option_acts(kMeshLimit, request.options, r.registry.find(request.name)->options))
    request.options.set(kMeshLimit, fmt::format("{}", mesh_limit_s(r)));
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
    PALPATE_TRY(make_quick(*scene, model.quick));
    return scene;
  }
  FetchOptions fetch;
  fetch.cache = cache_folder();
  fetch.readers = &r.readers;
  std::vector<std::string> notes;
  const Status found = find_scans(*scene, &fetch, r.context.progress, notes);
  for (const std::string& note : notes) tell("palpate: note: {}\n", note);
  if (found) return scene;
  if (model.stand_in.empty()) return found.error();
  r.stand_ins.push_back(fmt::format("{}: {}", model.name, found.error().message()));
  return embedded_scene(model.stand_in);
}

namespace {

/// The renderers of the manifest, or every method, on the behaviour suite.
void reproduce_behaviours(const Manifest& manifest, Reproduction& r) {
  std::vector<RendererRequest> renderers = methods_of(r.registry);
  if (!manifest.runs.empty()) renderers.clear();
  for (const ManifestRun& run : manifest.runs) {
    Result<std::vector<RendererRequest>> named = parse_renderers(run.renderer, r.registry);
    if (!named) return give_up(r, "the behaviour suite", named.error());
    renderers.push_back(std::move(named->front()));
  }
  Result<std::vector<Behaviour>> suite = behaviour_suite(r.context.progress);
  if (!suite) return give_up(r, "the behaviour suite", suite.error());
  const Result<BehaviourMatrix> matrix = run_behaviours(*std::move(suite), std::move(renderers), r.registry,
                                                        r.arguments.threads, r.context.progress);
  if (!matrix) return give_up(r, "the behaviour suite", matrix.error());
  r.context.progress.report("drawing the figures", -1.0);
  add_behaviours(r.page, *matrix, r.folder);
  r.page.sections.back().title = manifest.title;
  r.tables.push_back(matrix_table(*matrix));
  if (const Status written = r.folder.write("behaviours.json", matrix_json(*matrix)); !written)
    give_up(r, "behaviours.json", written.error());
}

/// Everything that the results of every step depend on; the scans by their names, sizes and times.
std::string key_of(const ReproduceArguments& arguments) {
  [[maybe_unused]] const auto& [tables, out, threads, full, no_cache, mesh_limit_s, quick] = arguments;
  RunKey key;
  key.add(static_cast<std::uint64_t>(threads)).add(mesh_limit_s);
  for (const bool flag : {full, no_cache, quick}) key.add(flag ? "yes" : "no");
  for (const Scan& scan : known_scans()) {
    const std::optional<std::filesystem::path> file = locate_scan(scan);
    std::error_code code;
    key.add(file ? file->string() : "");
    if (!file) continue;
    key.add(std::uint64_t{std::filesystem::file_size(*file, code)})
        .add(static_cast<double>(std::filesystem::last_write_time(*file, code).time_since_epoch().count()));
  }
  return key.word();
}

void reproduce_part(const Manifest& manifest, Reproduction& r) {
  switch (manifest.kind) {
    case Manifest::Kind::kNeighbours:
      return reproduce_neighbours(manifest, r);
    case Manifest::Kind::kMethods:
      return reproduce_methods(manifest, r);
    case Manifest::Kind::kMeshes:
      return reproduce_meshes(manifest, r);
    case Manifest::Kind::kGrowth:
      return reproduce_growth(manifest, r);
    case Manifest::Kind::kBehaviours:
      return reproduce_behaviours(manifest, r);
    case Manifest::Kind::kLadder:
    case Manifest::Kind::kOffVertex:
    case Manifest::Kind::kScanner:
      return reproduce_protocol(manifest, r);
    case Manifest::Kind::kFrames:
      return reproduce_frames(manifest, r);
  }
}

}  // namespace

int reproduce(const ReproduceArguments& arguments, Context& context) {
  Result<std::vector<Manifest>> manifests = manifests_for(arguments.tables);
  if (!manifests) return fail(manifests.error(), kExitBadInput);
  // What is no table of the thesis is part of the whole alone, or asked for by name.
  if (arguments.tables.empty() && arguments.quick)
    std::erase_if(*manifests, [](const Manifest& m) { return m.table == 0; });
  if (const Status acts = check_mesh_arguments(arguments, *manifests, all_renderers()); !acts)
    return fail(acts.error(), kExitBadInput);
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput);
  if (const Status begun = begin_run(*folder, key_of(arguments), context); !begun)
    return fail(begun.error(), kExitFellShort);
  if (arguments.no_cache) ::setenv("PALPATE_MESH_CACHE", "off", 1);  // for the renderers too
  Reproduction r{arguments,
                 context,
                 *folder,
                 all_renderers(),
                 all_readers(),
                 begin_page("The thesis's tables, measured again", new_head(context.command_line)),
                 {},
                 {},
                 {},
                 false,
                 {}};
  std::size_t step = 0;
  for (const Manifest& manifest : *manifests) {
    context.progress.set_prefix(
        fmt::format("[{}/{}] {}: ", ++step, manifests->size(),
                    manifest.table > 0 ? fmt::format("table {}", manifest.table) : manifest.id()));
    do_step(r, manifest, [&] { reproduce_part(manifest, r); });
  }
  finish(r);
  return r.fell_short ? kExitFellShort : kExitOk;
}

}  // namespace palpate::experiments
