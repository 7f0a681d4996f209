// `palpate reproduce`: which tables run, and what their runs have in common.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include <palpate/result.h>
#include "experiments/behaviours/behaviour.h"
#include "experiments/data/scans.h"
#include "experiments/driver/suite.h"
#include "experiments/session/session.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr const char* kMeshLimit = "mesh_time_limit_s";

std::vector<Part> parts_of(const std::vector<Step>& steps) {
  std::vector<Part> parts;
  for (const Step& step : steps) parts.push_back(step.part);
  return parts;
}

/// Tables of every step, of a study the one beside the thesis, and the first page's.
std::vector<Table> tables_of(const std::vector<Step>& steps, const Page& page) {
  std::vector<Table> tables;
  for (const Step& step : steps)
    for (const Section& section : step.part.sections)
      for (const Table& table : section.tables) {
        tables.push_back(table);
        if (step.manifest.kind == Manifest::Kind::kFrames) break;
      }
  tables.insert(tables.end(), page.tables.begin(), page.tables.end());
  return tables;
}

/// Prints fifteen lines at most: the answers, or the first table where there are none, and what was not done.
/// Context::verbose: every table too.
void print_results(const Reproduction& r, const Page& page) {
  constexpr std::size_t kMissingLines = 2;
  const bool verbose = r.context.verbose;
  if (verbose || page.answers.empty()) print_tables(tables_of(r.steps, page), verbose);
  for (const Headline& answer : page.answers) print_answer(answer);
  std::vector<std::string> missing;
  for (const Step& step : r.steps)
    missing.insert(missing.end(), step.part.missing.begin(), step.part.missing.end());
  const std::size_t shown = verbose || missing.size() <= kMissingLines ? missing.size() : kMissingLines - 1;
  for (std::size_t i = 0; i < shown; ++i) fmt::print("not done: {}\n", missing[i]);
  if (shown < missing.size())
    fmt::print("not done: {} more: --verbose, or the report\n", missing.size() - shown);
  fmt::print("took {}\nreport: {}\n", format_duration(r.watch.ms()),
             std::filesystem::absolute(r.folder.file(kReportFile)).lexically_normal().string());
  std::fflush(stdout);
  std::vector<std::string> warnings;
  for (const Known& known : page.known)
    for (const std::string& warning : known.warnings)
      warnings.push_back(fmt::format("warning: {}: {}", known.about, warning));
  tell_lines(warnings, verbose);
}

/// Writes the report, and prints what it answers.
int finish(Reproduction& r) {
  r.context.progress.set_prefix("");
  r.context.progress.report("writing the report", -1.0);
  const Page page = page_of(r.head, parts_of(r.steps));
  Status written = r.folder.write(kReproductionFile, reproduction_json(r.head, r.steps));
  if (written) written = write_page(page, r.folder);
  if (written) written = r.folder.complete();
  if (!written) fail(written.error(), kExitFellShort, &r.context.progress);
  r.context.progress.clear();
  print_results(r, page);
  const bool fell_short =
      std::any_of(r.steps.begin(), r.steps.end(), [](const Step& step) { return step.part.fell_short; });
  return fell_short || !written ? kExitFellShort : kExitOk;
}

/// True if the table needs reconstructions.
bool reconstructs(const Manifest& manifest, const render::Registry& registry) {
  if (manifest.kind == Manifest::Kind::kMeshes || manifest.kind == Manifest::Kind::kMethods) return true;
  return std::any_of(manifest.runs.begin(), manifest.runs.end(), [&](const ManifestRun& run) {
    const Result<NamedOptions> named = parse_named_options(run.renderer);
    const render::RendererInfo* info = named ? registry.find(named->name) : nullptr;
    return info != nullptr && option_applies(kMeshLimit, named->options, info->options);
  });
}

/// Rejects reconstruction options that no table uses.
Status check_mesh_arguments(const ReproduceArguments& arguments, const std::vector<Manifest>& manifests,
                            const render::Registry& registry) {
  const bool given = arguments.mesh_limit_s >= 0.0 || arguments.no_cache;
  if (!given || std::any_of(manifests.begin(), manifests.end(),
                            [&](const Manifest& m) { return reconstructs(m, registry); }))
    return Done{};
  return Error{"--mesh-limit and --no-cache do nothing: no table that was chosen makes a mesh",
               "leave them out"};
}

Result<scene::SceneFile> embedded_scene(const std::string& name) {
  for (const EmbeddedManifest& scene : embedded_scenes())
    if (name == scene.name) return scene::parse_scene(scene.text, name);
  return Error{fmt::format("there is no scene '{}'", name)};
}

Status make_quick(scene::SceneFile& scene, const std::string& generator) {
  scene::SceneModel& model = scene.models.front();
  PALPATE_ASSIGN(model.generate, parse_named_options(generator));
  model.name = model.generate->name;
  model.cloud.clear();
  model.scan.clear();
  model.unit.reset();
  model.scale = 1.0;
  return Done{};
}

/// Runs the manifest's renderers, or every method, on the behaviour suite.
void reproduce_behaviours(const Manifest& manifest, Reproduction& r) {
  const std::string what = "the behaviour suite";
  std::vector<RendererRequest> renderers = methods_of(r.registry);
  if (!manifest.runs.empty()) {
    Result<std::vector<RendererRequest>> named = requests_of(manifest, r);
    if (!named) return give_up(r, what, named.error());
    renderers = *std::move(named);
  }
  Result<std::vector<Behaviour>> suite = behaviour_suite(r.context.progress);
  if (!suite) return give_up(r, what, suite.error());
  const Result<BehaviourMatrix> matrix = run_behaviours(*std::move(suite), std::move(renderers), r.registry,
                                                        r.arguments.threads, r.context.progress);
  if (!matrix) return give_up(r, what, matrix.error());
  r.context.progress.report("drawing the figures", -1.0);
  Page page;
  add_behaviours(page, *matrix, r.folder);
  Section& section = page.sections.back();
  section.title = manifest.title;
  section.found = page.headlines.back().lines;
  r.part.sections = std::move(page.sections);
  if (const Status written = r.folder.write("behaviours.json", matrix_json(*matrix, r.head)); !written)
    give_up(r, "behaviours.json", written.error());
}

/// Everything that affects any step's results; scans by name, size and time.
RunKey key_of(const ReproduceArguments& arguments) {
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
  return key;
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

/// Whether a manifest answers the first page's questions; the others wait for --full or their names.
bool on_first_page(const Manifest& manifest, bool quick) {
  return manifest.table > 0 || (manifest.kind == Manifest::Kind::kGrowth && !quick);
}

}  // namespace

void give_up(Reproduction& r, const std::string& what, const Error& error) {
  leave_out(r, what, error);
  check_done(r, false);
}

void leave_out(Reproduction& r, const std::string& what_and_why) {
  r.part.missing.push_back(what_and_why);
}

void leave_out(Reproduction& r, const std::string& what, const Error& error) {
  leave_out(r, what + ": " + error.message());
}

void check_done(Reproduction& r, bool anything) {
  if (!anything && !r.arguments.tables.empty()) r.part.fell_short = true;
}

bool waits_for_full(const Reproduction& r) {
  return !r.arguments.full && !r.arguments.quick && r.arguments.tables.empty();
}

void add_known(Part& part, Known known) {
  if (!known.warnings.empty() || !known.notes.empty()) part.known.push_back(std::move(known));
}

void add_warnings(std::vector<std::string>& warnings, const std::string& model,
                  const scene::LoadedScene& loaded) {
  for (const scene::Provenance& p : loaded.provenance)
    for (const std::string& warning : p.warnings) warnings.push_back(model + ": " + warning);
}

double mesh_limit_s(const Reproduction& r) {
  constexpr double kInTimeS = 120.0;  // a run of minutes
  if (r.arguments.mesh_limit_s >= 0.0) return r.arguments.mesh_limit_s;
  return r.arguments.full ? 0.0 : kInTimeS;
}

Result<RendererRequest> request_of(const std::string& renderer, const Reproduction& r) {
  PALPATE_ASSIGN(std::vector<RendererRequest> requests, parse_renderers(renderer, r.registry));
  RendererRequest& request = requests.front();
  if (option_applies(kMeshLimit, request.options, r.registry.find(request.name)->options))
    request.options.set(kMeshLimit, fmt::format("{}", mesh_limit_s(r)));
  return std::move(request);
}

Result<std::vector<RendererRequest>> requests_of(const Manifest& manifest, const Reproduction& r) {
  std::vector<RendererRequest> requests;
  for (const ManifestRun& run : manifest.runs) {
    PALPATE_ASSIGN(RendererRequest request, request_of(run.renderer, r));
    requests.push_back(std::move(request));
  }
  return requests;
}

RunOptions run_options(const Reproduction& r, double prepare_limit_s) {
  constexpr double kFullBudgetS = 60.0, kFullPrepareLimitS = 3600.0;
  constexpr std::uint64_t kQuickPasses = 3;
  RunOptions options;
  options.threads = r.arguments.threads;
  options.prepare_limit_s =
      r.arguments.full ? std::max(kFullPrepareLimitS, prepare_limit_s) : prepare_limit_s;
  if (r.arguments.quick) options.passes = kQuickPasses;
  if (r.arguments.full) options.budget_s = kFullBudgetS;
  return options;
}

Result<std::vector<Run>> run_on(const Stage& stage, const std::vector<RendererRequest>& requests,
                                const RunOptions& options, Reproduction& r,
                                metrics::ResultDocument& document) {
  metrics::MeasurementConditions conditions;
  PALPATE_ASSIGN(std::vector<Run> runs,
                 run_renderers(stage, requests, r.registry, options, r.context.progress, conditions, {}));
  add_program(conditions);
  document.conditions = std::move(conditions);
  return runs;
}

void write_beside(Reproduction& r, const Manifest& manifest, const std::string& file,
                  const std::string& text) {
  const Result<OutputFolder> folder = r.folder.inside(manifest.id());
  const Status written = folder ? folder->write(file, text) : Status(folder.error());
  if (!written) give_up(r, manifest.id() + "/" + file, written.error());
}

Result<ModelScene> scene_of(const ManifestModel& model, Reproduction& r) {
  Result<scene::SceneFile> scene = scene::SceneFile{};
  if (!model.scene.empty()) {
    scene = embedded_scene(model.scene);
  } else if (!model.generate.empty()) {
    scene = scene::open_scene(model.in_time.empty() || r.arguments.full ? model.generate : model.in_time);
  } else {
    scene->path = model.scan;
    scene->models.emplace_back();
    scene->models.front().name = scene->models.front().scan = model.scan;
    scene->models.front().scale = model.scale;
  }
  if (!scene) return std::move(scene).error();
  if (r.arguments.quick && !model.quick.empty()) {
    PALPATE_TRY(make_quick(*scene, model.quick));
    return ModelScene{*std::move(scene), {}};
  }
  FetchOptions fetch;
  fetch.cache = cache_folder();
  fetch.readers = &r.readers;
  std::vector<std::string> notes;
  const Status found = find_scans(*scene, &fetch, r.context.progress, notes);
  for (const std::string& note : notes) tell("palpate: note: {}\n", note);
  if (found) return ModelScene{*std::move(scene), {}};
  if (model.stand_in.empty()) return found.error();
  PALPATE_ASSIGN(scene::SceneFile stand_in, embedded_scene(model.stand_in));
  return ModelScene{std::move(stand_in), model.name + ": " + found.error().message()};
}

Result<int> reproduce(const ReproduceArguments& arguments, Context& context) {
  PALPATE_ASSIGN(std::vector<Manifest> manifests, manifests_for(arguments.tables));
  std::vector<Step> waiting;
  if (arguments.tables.empty() && !arguments.full)
    std::erase_if(manifests, [&](const Manifest& m) {
      if (on_first_page(m, arguments.quick)) return false;
      if (!arguments.quick)
        waiting.push_back(
            {m,
             {{},
              {},
              {},
              {fmt::format("{}: no table of the thesis; run with --full, or --tables {}", m.id(), m.id())},
              false}});
      return true;
    });
  PALPATE_TRY(check_mesh_arguments(arguments, manifests, all_renderers()));
  Suite suite(context);
  PALPATE_TRY(suite.open(arguments.out));
  PALPATE_TRY(suite.begin(key_of(arguments)));
  if (arguments.no_cache) ::setenv("PALPATE_MESH_CACHE", "off", 1);  // also for the renderers
  Reproduction r{arguments,
                 context,
                 suite,
                 suite.folder(),
                 all_renderers(),
                 all_readers(),
                 new_head(context.command_line),
                 {}};
  std::size_t step = 0;
  for (const Manifest& manifest : manifests) {
    context.progress.set_prefix(
        fmt::format("[{}/{}] {}: ", ++step, manifests.size(),
                    manifest.table > 0 ? fmt::format("table {}", manifest.table) : manifest.id()));
    do_step(r, manifest, [&] { reproduce_part(manifest, r); });
  }
  if (suite.partial()) return suite.leave();
  r.steps.insert(r.steps.end(), waiting.begin(), waiting.end());
  return finish(r);
}

// Steps of `palpate reproduce`. Each is stored when complete, with its part of the report, and the report is
// drawn again from storage.

namespace {

/// Fails to compile when a member is added: describe it below, then count it here.
[[maybe_unused]] void name_all_members(Answer& w, Part& p) {
  [[maybe_unused]] const auto& [w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12, w13, w14, w15] = w;
  [[maybe_unused]] const auto& [p1, p2, p3, p4, p5] = p;
}

}  // namespace

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Answer, table, page, says, printed, literal, ours, ratio, error,
                                   mesh_error, status, reproduced, as_fast, literal_right, ours_right, take)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Part, known, sections, answers, missing, fell_short)

namespace {

constexpr const char* kSchema = "palpate-reproduction/1";

/// True if the step's part is drawn from its study.
bool has_study(const Step& step) {
  return step.manifest.kind == Manifest::Kind::kFrames && !step.part.sections.empty();
}

/// A step's part again: from its study, or from storage and the figures' scripts.
Result<Part> part_again(const nlohmann::json& step, const OutputFolder& folder) {
  Part part = step.at("page").get<Part>();
  if (!step.at("study").get<bool>()) {
    PALPATE_TRY(draw_scripts(part.sections, folder));
    return part;
  }
  PALPATE_ASSIGN(const Manifest manifest, parse_manifest(step.at("manifest").get<std::string>(),
                                                         folder.file(kReproductionFile).string()));
  PALPATE_ASSIGN(const Study study, read_study(folder.file(manifest.id())));
  Part drawn = frames_part(manifest, study, folder);
  drawn.missing = std::move(part.missing);
  return drawn;
}

}  // namespace

std::string reproduction_json(const metrics::DocumentHead& head, const std::vector<Step>& steps) {
  DocumentJson document = begin_json(kSchema, head);
  document["title"] = kReproductionTitle;
  document["steps"] = DocumentJson::array();
  for (const Step& step : steps) {
    Part part = step.part;
    // Files in the folder provide these parts.
    if (has_study(step)) part = {{}, {}, {}, part.missing, part.fell_short};
    put_scripts(part.sections);
    document["steps"].push_back({{"id", step.manifest.id()},
                                 {"manifest", step.manifest.source},
                                 {"study", has_study(step)},
                                 {"page", DocumentJson(nlohmann::json(part))}});
  }
  return document_text(document);
}

Status draw_reproduction(const OutputFolder& folder) {
  return draw_again(folder, kReproductionFile, kSchema, [&](const nlohmann::json& document) -> Result<Page> {
    std::vector<Part> parts;
    for (const nlohmann::json& step : document.at("steps")) {
      PALPATE_ASSIGN(Part part, part_again(step, folder));
      parts.push_back(std::move(part));
    }
    return page_of(head_from(document), parts);
  });
}

void do_step(Reproduction& r, const Manifest& manifest, const std::function<void()>& work) {
  const std::string name = manifest.id(), key = RunKey().add(manifest.source).word();
  r.part = {};
  if (r.suite.take(name, key, r.part)) {
    r.steps.push_back({manifest, std::move(r.part)});
    return;
  }
  Case one;
  one.name = name;
  one.setting = manifest.table > 0 ? "table " + std::to_string(manifest.table) : name;
  if (!r.suite.measures(one)) return;
  r.folder.start_part();
  work();
  const bool came = !r.part.sections.empty();  // else the next run retries
  if (came)
    if (const Status kept = r.suite.keep(name, key, r.part); !kept) give_up(r, name, kept.error());
  r.steps.push_back({manifest, std::move(r.part)});
}

}  // namespace palpate::experiments
