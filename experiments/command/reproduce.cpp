#include <fmt/format.h>

#include <algorithm>

#include "experiments/command/reproduction.h"
#include "experiments/data/fetch.h"

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

Result<scene::SceneFile> scene_of(const ManifestModel& model, Reproduction& r) {
  if (!model.generate.empty())
    return scene::open_scene(r.arguments.quick && !model.quick.empty() ? model.quick : model.generate);
  const Scan* scan = find_scan(model.scan);
  if (scan == nullptr) return Error{fmt::format("no scan is called '{}'", model.scan), {}, {}, 0};
  std::optional<std::filesystem::path> file = locate_scan(*scan);
  if (!file) {
    FetchOptions options;
    options.cache = cache_folder();
    Result<std::filesystem::path> fetched = fetch_scan(*scan, options, r.context.progress);
    if (!fetched) return std::move(fetched).error();
    file = *fetched;
  }
  Result<scene::SceneFile> scene = scene::open_scene(file->string());
  if (!scene) return scene;
  scene::SceneModel& loaded = scene->models.front();
  loaded.scale = model.scale;
  if (!model.unit.empty()) {
    const Result<io::Unit> unit = io::parse_unit(model.unit);
    if (!unit) return unit.error();
    loaded.unit = *unit;
  }
  return scene;
}

int run_reproduce(const ReproduceArguments& arguments, Context& context) {
  const Result<std::vector<Manifest>> manifests = manifests_for(arguments.tables);
  if (!manifests) return fail(manifests.error(), kExitBadInput);
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput);
  Reproduction r{arguments,
                 context,
                 *folder,
                 all_renderers(),
                 all_readers(),
                 begin_page("The thesis's tables, measured again", new_document(context.command_line)),
                 {},
                 {},
                 false,
                 {}};
  const bool growth = arguments.tables.empty() && !arguments.quick;
  std::size_t step = 0;
  const std::size_t steps = manifests->size() + (growth ? 1 : 0);
  for (const Manifest& manifest : *manifests) {
    context.progress.set_prefix(fmt::format("[{}/{}] table {}: ", ++step, steps, manifest.table));
    if (manifest.kind == Manifest::Kind::kNeighbours)
      reproduce_neighbours(manifest, r);
    else
      reproduce_frames(manifest, r);
    if (context.progress.cancelled())
      return fail({"stopped", "the results so far are in " + arguments.out, {}, 0}, kExitFellShort,
                  &context.progress);
  }
  if (growth) {
    context.progress.set_prefix(fmt::format("[{}/{}] growth: ", steps, steps));
    measure_growth(r);
  }
  finish(r);
  return r.fell_short ? kExitFellShort : kExitOk;
}

}  // namespace palpate::experiments
