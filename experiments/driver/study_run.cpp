#include "experiments/driver/study_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <system_error>
#include <vector>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "experiments/data/scans.h"
#include "experiments/driver/suite.h"
#include "experiments/report/findings.h"
#include "experiments/run/arguments.h"
#include "experiments/run/work.h"
#include "experiments/session/session.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

Status check_outputs(const RunArguments& arguments, const StageRequest& stage) {
  const std::vector<std::string> read = files_read(stage);
  if (!arguments.save_mesh.empty())
    PALPATE_TRY(check_output({arguments.save_mesh, {"ply"}, arguments.force}, read));
  if (!arguments.save_edited.empty())
    if (Status good = check_output({arguments.save_edited, io::cloud_extensions(), arguments.force}, read);
        !good)
      return good;
  if (!arguments.save_mesh.empty() && arguments.save_mesh == arguments.save_edited)
    return Error{"is to be the mesh and the edited model", "give two names", arguments.save_mesh};
  return Done{};
}

bool is_there(const std::string& file) {
  std::error_code code;
  return file.empty() || std::filesystem::exists(file, code);
}

/// The renderers, one after the other. Finished results are kept at once, and result.json names the open ones
/// at every moment.
class OneByOne {
 public:
  OneByOne(StagedStudy& study, const std::vector<RendererRequest>& requests, const render::Registry& registry,
           const RunOptions& options, const Suite& suite)
      : study_(study),
        requests_(requests),
        registry_(registry),
        options_(options),
        suite_(suite),
        folder_(suite.folder()) {}

  /// Takes over what an interrupted run has finished.
  Status begin();
  /// Runs the others. Context::working is cleared where an Error is one of the input.
  Status run_the_rest();
  [[nodiscard]] bool saved_mesh() const { return saved_mesh_; }

 private:
  Status write_result();
  Status take(const RendererRequest& request, Run& run);

  StagedStudy& study_;
  const std::vector<RendererRequest>& requests_;
  const render::Registry& registry_;
  RunOptions options_;
  const Suite& suite_;
  const OutputFolder& folder_;
  std::map<std::string, Run> finished_;  ///< by label
  bool saved_mesh_ = false;
};

Status OneByOne::begin() {
  std::string taken;
  for (const RendererRequest& request : requests_) {
    Run run;
    if (!is_there(options_.save_edited) ||
        !take_run(folder_, request.label, key_of(request), study_.stage, run) ||
        (run.saved_mesh && !is_there(options_.save_mesh)))
      continue;
    saved_mesh_ = saved_mesh_ || run.saved_mesh;
    finished_.emplace(request.label, std::move(run));
    taken += (taken.empty() ? "" : ", ") + request.label;
  }
  if (!taken.empty())
    study_.stage.notes.push_back("Finished by an earlier run, which was interrupted: " + taken + ".");
  if (suite_.partial()) return Done{};
  PALPATE_TRY(write_stage(study_, folder_));
  return write_result();
}

Status OneByOne::run_the_rest() {
  Context& context = suite_.context();
  std::vector<RendererRequest> rest;
  std::size_t points = 0;
  for (const render::ModelInput& model : study_.stage.scene.input.models) points += model.cloud->size();
  // Passes without and with a clock in every frame, and the untimed one.
  const double frames = static_cast<double>((2 * options_.passes + 1) * study_.stage.path.size());
  for (const RendererRequest& request : requests_)
    if (!finished_.contains(request.label) &&
        suite_.measures(
            case_of(request, *registry_.find(request.name), study_.stage.scene_name, points, frames, 1.0)))
      rest.push_back(request);
  RunOptions options = options_;
  if (saved_mesh_) options.save_mesh.clear();  // the first mesh is the one that is kept
  context.working = false;
  const auto news = [&](const RendererRequest& request, Run& run) -> Status {
    context.working = true;
    PALPATE_TRY(take(request, run));
    context.working = false;
    return Done{};
  };
  metrics::MeasurementConditions conditions;
  PALPATE_TRY(run_renderers(study_.stage, rest, registry_, options, context.progress, conditions, news));
  if (suite_.partial()) return Done{};
  add_program(conditions);
  if (!rest.empty()) study_.document.conditions = std::move(conditions);
  for (const RendererRequest& request : requests_)
    study_.runs.push_back(std::move(finished_.at(request.label)));
  context.progress.set_prefix("");
  context.working = true;
  // Only now is it known who felt nothing where others did.
  finish_document(study_);
  study_.document.complete = true;
  return folder_.write(kResultFile, metrics::to_json(study_.document));
}

Status OneByOne::take(const RendererRequest& request, Run& run) {
  saved_mesh_ = saved_mesh_ || run.saved_mesh;
  folder_.start_part();
  PALPATE_TRY(write_run(study_.stage, run, requests_.size() == 1, folder_));
  const auto hold = block_stop();  // what is kept is what result.json says is finished
  PALPATE_TRY(folder_.keep(request.label, key_of(request), result_text(run)));
  finished_.insert_or_assign(request.label, run);
  return write_result();
}

Status OneByOne::write_result() {
  finish_document(study_);
  study_.document.complete = finished_.size() == requests_.size();
  for (const RendererRequest& request : requests_) {
    const auto run = finished_.find(request.label);
    study_.document.renderers.push_back(run != finished_.end()
                                            ? run->second.result
                                            : unfinished(study_.stage, request, registry_, options_.threads));
  }
  return folder_.write(kResultFile, metrics::to_json(study_.document));
}

/// The renderers, the path and the folder, where the user has left any of them open.
void report_runs(const RunArguments& arguments, const std::vector<RendererRequest>& renderers,
                 const StagedStudy& study, const OutputFolder& folder, ProgressBar& progress) {
  if (!arguments.renderers.empty() && !arguments.path.empty() && !arguments.out.empty()) return;
  std::string labels;
  for (const RendererRequest& request : renderers) labels += (labels.empty() ? "" : ", ") + request.label;
  progress.clear();
  tell("palpate: running {}\n         along {}\n         into {}\n", labels, study.stage.path.name,
       folder.path().string());
}

int report_failures(const StagedStudy& study) {
  int status = kExitOk;
  for (const Run& run : study.runs) {
    if (run.result.status == metrics::RunStatus::kOk) continue;
    tell("palpate: {} {}: {}\n", run.result.label,
         run.result.status == metrics::RunStatus::kFailed ? "failed" : "did not finish", run.result.reason);
    status = kExitFellShort;
  }
  return status;
}

}  // namespace

namespace {

constexpr const char* kStreamRenderer = "depth-image";
constexpr const char* kStreamRenderers = "depth-image,stream-proxy";

/// The stream that is named, replayed; a scene beside it, or neither, is an Error.
Result<StreamRequest> stream_of(const RunArguments& arguments) {
  if (arguments.stream.empty() && arguments.scene.empty())
    return Error{"neither a SCENE nor a --stream is given",
                 "name a model, or a stream such as --stream sim:wall"};
  if (arguments.stream.empty()) {
    if (arguments.stream_delay.empty()) return StreamRequest{};
    return Error{"--stream-delay does nothing without a stream", "add --stream, or leave it out"};
  }
  if (!arguments.scene.empty())
    return Error{"a SCENE and --stream exclude each other", "leave one of them out", arguments.scene};
  if (const std::string given = given_for_model_files(arguments.load); !given.empty())
    return Error{given + " does nothing: a stream's images say their own lengths", "leave it out",
                 arguments.stream};
  StreamRequest stream;
  stream.source = arguments.stream;
  PALPATE_ASSIGN(stream.delay, parse_stream_delay(arguments.stream_delay));
  return stream;
}

/// The images of a stream: a file, or all files of a folder in the order of their names.
void add_stream(const std::string& source, RunKey& key) {
  if (is_recorded_session(source)) key.add_file(source);
  if (const std::string file = simulated_file(source); !file.empty()) key.add_file(file);
  std::vector<std::string> files;
  std::error_code none;
  constexpr auto kSkip = std::filesystem::directory_options::skip_permission_denied;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(source, kSkip, none))
    if (entry.is_regular_file(none)) files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  for (const std::string& file : files) key.add(file).add_file(file);
}

/// A scene whose one model's surface the command line may set.
scene::SceneFile scene_of_stream(const std::string& source) {
  scene::SceneFile scene;
  scene.path = source;
  scene.models.emplace_back().name = source;
  return scene;
}

}  // namespace

// An argument that is added does not compile here until it is named.
RunKey key_of(const RunArguments& arguments, const StageRequest& stage) {
  [[maybe_unused]] const auto& [scene, stream, stream_delay, renderers, one, path, out, load, surface,
                                reference, paced, passes, budget_s, save_mesh, save_edited, force,
                                allow_missing, json] = arguments;
  const auto& [stiffness, friction, deformation] = surface;
  [[maybe_unused]] const auto& [unit, scale, post_mm, vertical_mm, no_data, within, non_finite,
                                memory_limit_gb, threads] = load;
  RunKey key;
  for (const std::string& text : {scene, stream, stream_delay, path, reference, unit, no_data, within,
                                  non_finite, save_mesh, save_edited, stiffness, friction, deformation})
    key.add(text);
  key.add(scale)
      .add(post_mm)
      .add(vertical_mm)
      .add(paced)
      .add(passes)
      .add(budget_s)
      .add(static_cast<std::uint64_t>(threads));
  for (const std::string& file : files_read(stage)) key.add_file(file);
  if (!stream.empty()) add_stream(stream, key);
  return key;
}

Result<CheckedRun> check_run(const RunArguments& arguments, const render::Registry& registry,
                             Progress& progress) {
  CheckedRun prepared;
  PALPATE_ASSIGN(const scene::LoadOptions load, load_options(arguments.load));
  std::string truth = arguments.reference;
  if (const Scan* scan = find_scan(truth)) {
    const std::optional<std::filesystem::path> file = locate_scan(*scan);
    if (!file)
      return Error{fmt::format("the scan '{}' is not here", truth),
                   fmt::format("`palpate fetch {}` brings it", truth)};
    truth = file->string();
  }
  PALPATE_ASSIGN(ReferenceChoice reference, parse_reference(truth));
  PALPATE_ASSIGN(const StreamRequest stream, stream_of(arguments));
  PALPATE_ASSIGN(scene::SceneFile scene, stream.source.empty()
                                             ? open_scene(arguments.scene, registry, progress)
                                             : Result<scene::SceneFile>(scene_of_stream(stream.source)));
  PALPATE_ASSIGN(SurfaceReport surfaces, set_surfaces(arguments.surface, scene));
  if (!arguments.renderers.empty()) {
    PALPATE_ASSIGN(prepared.renderers, parse_renderers(arguments.renderers, registry));
  } else if (scene.renderer) {
    PALPATE_ASSIGN(prepared.own, request_of(*scene.renderer, registry));
  }  // else the plan chooses, when the models are known
  prepared.stage = {scene_or_stream(arguments),
                    std::move(scene),
                    load,
                    arguments.path,
                    reference,
                    arguments.load.threads,
                    0,
                    truth,
                    std::move(surfaces)};
  prepared.stage.stream = stream;
  return prepared;
}

Status open_folder(const RunArguments& arguments, const char* command, const StageRequest& stage,
                   Suite& suite) {
  return suite.open(arguments.out.empty() ? usual_folder(command, scene_or_stream(arguments)) : arguments.out,
                    files_read(stage));
}

Status choose_renderers(bool one, const render::Registry& registry, const render::SceneInput& scene,
                        CheckedRun& checked, std::vector<std::string>& notes) {
  if (checked.renderers.empty() && one && checked.own) checked.renderers = {*checked.own};
  if (checked.renderers.empty() && scene.models.front().camera != nullptr) {
    PALPATE_ASSIGN(checked.renderers, parse_renderers(one ? kStreamRenderer : kStreamRenderers, registry));
  }
  if (checked.renderers.empty()) {
    Chosen chosen = usual_renderers(scene, checked.own, registry);
    if (one) chosen.renderers.resize(1);
    checked.renderers = std::move(chosen.renderers);
    for (std::string& note : chosen.notes) notes.push_back(std::move(note));
  }
  for (const RendererRequest& request : checked.renderers)
    PALPATE_TRY(registry.check_supports(*registry.find(request.name), scene));
  return Done{};
}

Result<int> run_study(const RunArguments& arguments, Context& context, const AfterStudy& after) {
  const render::Registry registry = all_renderers();
  PALPATE_ASSIGN(CheckedRun prepared, check_run(arguments, registry, context.progress));
  Suite suite(context);
  PALPATE_TRY(open_folder(arguments, arguments.one ? "compare-one" : "compare", prepared.stage, suite));
  PALPATE_TRY(check_outputs(arguments, prepared.stage));
  StagedStudy study;
  study.document = new_document(context.command_line);
  PALPATE_ASSIGN(study.stage, set_up(prepared.stage, all_readers(), context.progress));
  if (const Status able =
          choose_renderers(arguments.one, registry, study.stage.scene.input, prepared, study.stage.notes);
      !able && !arguments.allow_missing) {
    Error error = able.error();
    error.remedy += ", or --allow-missing to run it as it is";
    return error;
  }
  const std::string& path = study.stage.path.name;
  study.document.title = fmt::format("{}, along {}", study.stage.scene_name, path.substr(0, path.find(':')));
  RunOptions options;
  options.threads = arguments.load.threads;
  options.paced_frames = arguments.paced;
  options.passes = arguments.passes;
  options.budget_s = arguments.budget_s;
  options.save_mesh = arguments.save_mesh;
  options.save_edited = arguments.save_edited;
  PALPATE_TRY(suite.begin(key_of(arguments, prepared.stage)));
  report_runs(arguments, prepared.renderers, study, suite.folder(), context.progress);
  OneByOne run(study, prepared.renderers, registry, options, suite);
  PALPATE_TRY(run.begin());
  PALPATE_TRY(run.run_the_rest());
  if (suite.partial()) return suite.leave();
  PALPATE_ASSIGN(const std::string more, after(suite.folder()));
  PALPATE_TRY(suite.folder().complete());
  context.progress.clear();
  if (arguments.json)
    fmt::print("{}\n", metrics::to_json(study.document));
  else
    print_scores(study.document, context.verbose);
  std::fflush(stdout);
  tell("{}", findings_text(study.document));
  int status = report_failures(study);
  if (!arguments.save_mesh.empty() && !run.saved_mesh())
    status = fail({"no mesh was saved: none of the renderers works on a mesh", "run mesh-godobject", {}, 0},
                  kExitFellShort);
  if (!arguments.json) fmt::print("{}", more);  // last: where the results are
  return status;
}

}  // namespace palpate::experiments
