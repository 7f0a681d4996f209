#include "experiments/command/study_run.h"

#include <fmt/format.h>

#include "experiments/command/session.h"
#include "experiments/data/locate.h"
#include "experiments/data/scene_scans.h"
#include "experiments/report/tables.h"
#include "toolkit/plan/plan.h"

namespace palpate::experiments {
namespace {

struct Prepared {
  StageRequest stage;
  std::vector<RendererRequest> renderers;
};

/// Everything that can be wrong with the arguments is found here, before anything is made or loaded.
Result<Prepared> check(const RunArguments& arguments, const render::Registry& registry, Progress& progress) {
  Prepared prepared;
  const Result<scene::LoadOptions> load = load_options(arguments.load);
  if (!load) return load.error();
  std::string truth = arguments.reference;
  if (const Scan* scan = find_scan(truth)) {
    const std::optional<std::filesystem::path> file = locate_scan(*scan);
    if (!file)
      return Error{fmt::format("the scan '{}' is not here", truth),
                   fmt::format("`palpate fetch {}` brings it", truth),
                   {},
                   0};
    truth = file->string();
  }
  Result<ReferenceChoice> reference = parse_reference(truth);
  if (!reference) return std::move(reference).error();
  Result<scene::SceneFile> scene = open_scene(arguments.scene, progress);
  if (!scene) return std::move(scene).error();
  if (!arguments.renderers.empty()) {
    Result<std::vector<RendererRequest>> renderers = parse_renderers(arguments.renderers, registry);
    if (!renderers) return std::move(renderers).error();
    prepared.renderers = *std::move(renderers);
  } else if (scene->renderer) {
    Result<RendererRequest> renderer = request_of(*scene->renderer, registry);
    if (!renderer) return Error(std::move(renderer).error()).in_file(scene->path);
    prepared.renderers = {*std::move(renderer)};
  }  // else the plan chooses, when the models are known
  prepared.stage = {arguments.scene, *std::move(scene),      *load, arguments.path,
                    *reference,      arguments.load.threads, 0,     truth};
  return prepared;
}

int report_failures(const Study& study) {
  int status = kExitOk;
  for (const Run& run : study.runs) {
    if (run.result.status == metrics::RunStatus::kOk) continue;
    fmt::print(stderr, "palpate: {} {}: {}\n", run.result.label,
               run.result.status == metrics::RunStatus::kFailed ? "failed" : "did not finish",
               run.result.reason);
    status = kExitFellShort;
  }
  return status;
}

}  // namespace

int run_study(const RunArguments& arguments, Context& context, const AfterStudy& after) {
  const render::Registry registry = all_renderers();
  Result<Prepared> prepared = check(arguments, registry, context.progress);
  if (!prepared) return fail(prepared.error(), kExitBadInput);
  Study study;
  study.document = new_document(context.command_line);
  Result<Stage> stage = set_up(prepared->stage, all_readers(), context.progress);
  if (!stage) return fail(stage.error(), kExitBadInput, &context.progress);
  study.stage = *std::move(stage);
  if (prepared->renderers.empty()) {
    const plan::Decision chosen = plan::choose_renderer(study.stage.scene.input);
    prepared->renderers.push_back({chosen.choice, chosen.choice, {}});
    study.stage.notes.push_back(fmt::format("Renderer by plan: {} ({}).", chosen.choice, chosen.reason));
  }
  const std::string& path = study.stage.path.name;
  study.title = fmt::format("{}, along {}", study.stage.scene_name, path.substr(0, path.find(':')));
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  RunOptions options;
  options.threads = arguments.load.threads;
  options.paced_frames = arguments.paced;
  options.save_mesh = arguments.save_mesh;
  options.save_edited = arguments.save_edited;
  bool saved = false;
  for (const RendererRequest& request : prepared->renderers) {
    Result<Run> run = run_renderer(study.stage, request, registry, options, context.progress);
    if (!run) return fail(run.error(), kExitBadInput, &context.progress);
    if (run->saved_mesh) options.save_mesh.clear();  // the first mesh is the one that is kept
    saved = saved || run->saved_mesh;
    study.runs.push_back(*std::move(run));
    if (context.progress.cancelled()) break;
  }
  finish_document(study);
  if (const Status written = write_study(study, *folder); !written)
    return fail(written.error(), kExitFellShort, &context.progress);
  const Result<std::string> more = after(study, *folder);
  context.progress.clear();
  if (!more) return fail(more.error(), kExitFellShort);
  if (arguments.json)
    fmt::print("{}\n", metrics::to_json(study.document));
  else
    fmt::print("{}\n{}", to_text(comparison_table(study.document)), *more);
  for (const std::string& note : study.stage.notes) fmt::print(stderr, "palpate: note: {}\n", note);
  const int status = report_failures(study);
  if (!arguments.save_mesh.empty() && !saved)
    return fail({"no mesh was saved: none of the renderers works on a mesh", "run mesh-godobject", {}, 0},
                kExitFellShort);
  return status;
}

}  // namespace palpate::experiments
