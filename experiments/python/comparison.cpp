// Truths, scores and comparisons.
#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>

#include "experiments/python/renderer_object.h"
#include "experiments/run/arguments.h"
#include "experiments/run/run.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::python {
namespace {

namespace ex = palpate::experiments;

Result<ex::Stage> stage_of(const Scene& scene, const trace::ProbePath* path, const std::string& made,
                           const std::string& reference, Progress& progress) {
  ex::StageRequest request;
  request.scene_name = scene.name;
  request.path = made;
  PALPATE_ASSIGN(request.reference, ex::parse_reference(reference));
  if (request.reference == ex::ReferenceChoice::kMeshFile) request.reference_file = reference;
  std::optional<trace::ProbePath> given;
  if (path != nullptr) given = *path;
  return ex::set_up(scene.loaded, std::move(given), request, ex::all_readers(), progress);
}

/// Truths are known along places that are finite.
const trace::ProbePath& finite(const Path& path) {
  const auto& hips = path.path->hip_mm;
  const auto bad = std::find_if_not(hips.begin(), hips.end(), is_finite);
  if (bad != hips.end())
    raise({fmt::format("sample {} of the path is not finite", bad - hips.begin()), "remove it"});
  return *path.path;
}

/// The truth along a path.
struct Truth {
  std::shared_ptr<const ex::Stage> stage;
};

ScenePtr scene_for(const py::object& scene, const Path& path) {
  if (!scene.is_none()) return scene_of(scene);
  if (path.scene == nullptr) raise({"it is not said which scene the path is for", "give scene="});
  return path.scene;
}

Truth make_truth(const py::object& path, const py::object& scene, const std::string& reference,
                 double rate_hz) {
  const Path along = path_of(path, rate_hz, nullptr);
  const ScenePtr of = scene_for(scene, along);
  check_unchanged(*of);
  const trace::ProbePath& samples = finite(along);
  ex::Stage stage =
      without_lock([&](Progress& progress) { return stage_of(*of, &samples, "", reference, progress); });
  if (!stage.reference)
    raise({"there is no truth of this scene: the model has neither a formula nor a mesh of its own",
           "give the name of a mesh file: reference=\"mesh.ply\""});
  return {std::make_shared<const ex::Stage>(std::move(stage))};
}

/// A document with this one run, as text.
std::string scores_of(const Truth& truth, const Trace& trace) {
  if (trace.trace->frames.size() != truth.stage->path.size())
    raise({fmt::format("the trace has {} frames, the path {} samples", trace.trace->frames.size(),
                       truth.stage->path.size()),
           "replay the truth's own path"});
  metrics::ResultDocument document;
  without_lock([&](Progress&) -> Status {
    ex::Run run;
    run.trace = *trace.trace;
    PALPATE_TRY(ex::score_run(*truth.stage, run));
    document.renderers.push_back(std::move(run.result));
    return Done{};
  });
  return metrics::to_json(document);
}

/// Renderers to compare: names with options, prepared renderers by their options, classes of Python.
struct PALPATE_HIDDEN Entries {
  std::vector<ex::RendererRequest> requests;
  render::Registry registry = our_renderers();
  std::vector<PythonClassPtr> python;
};

void add_entry(py::handle given, const ScenePtr& scene, Entries& entries) {
  ex::RendererRequest request;
  PythonClassPtr python;
  if (py::isinstance<py::str>(given)) {
    std::vector<ex::RendererRequest> parsed =
        value_of(ex::parse_renderers(given.cast<std::string>(), entries.registry));
    std::move(parsed.begin(), parsed.end(), std::back_inserter(entries.requests));
    return;
  }
  if (py::isinstance<Renderer>(given)) {
    const auto& prepared = given.cast<const Renderer&>();
    python = prepared.python();
    request.name = prepared.name();
    request.options = prepared.options();
  } else {
    python = std::make_shared<PythonClass>(py::reinterpret_borrow<py::object>(given));
    request.name = python->name();
  }
  if (python != nullptr) {
    add_python_renderer(entries.registry, python, scene);
    entries.python.push_back(python);
  }
  request.label = request.name;
  entries.requests.push_back(std::move(request));
}

/// Labels name rows: the second `cloud` is cloud-2.
void make_labels_unique(std::vector<ex::RendererRequest>& requests) {
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const std::string wanted = requests[i].label;
    const auto taken = [&](const std::string& label) {
      return std::any_of(requests.begin(), requests.begin() + static_cast<std::ptrdiff_t>(i),
                         [&](const ex::RendererRequest& other) { return other.label == label; });
    };
    for (int count = 2; taken(requests[i].label); ++count)
      requests[i].label = fmt::format("{}-{}", wanted, count);
  }
}

/// The document as text, and every trace by its label. An exception of a Python renderer fails its row.
py::tuple compare(const py::list& renderers, const py::object& path, const py::object& scene,
                  const std::string& reference, std::uint64_t passes, double budget_s, double rate_hz,
                  int threads) {
  if (renderers.empty()) raise({"nothing is compared", "give names, renderers or classes"});
  if (!(budget_s >= 0.0) || passes < 1) raise({"nothing would be timed", "give passes of at least 1"});
  Path along;
  std::string made;
  ScenePtr of = scene.is_none() ? nullptr : scene_of(scene);
  for (const py::handle one : renderers)
    if (of == nullptr && py::isinstance<Renderer>(one)) of = one.cast<const Renderer&>().scene();
  if (py::isinstance<py::str>(path))
    made = path.cast<std::string>();
  else
    along = path_of(path, rate_hz, nullptr);
  if (of == nullptr) of = along.scene;
  if (of == nullptr) raise({"it is not said which scene is felt", "give scene="});
  Entries entries;
  for (const py::handle one : renderers) add_entry(one, of, entries);
  make_labels_unique(entries.requests);
  check_unchanged(*of);
  const trace::ProbePath* const samples = along.path == nullptr ? nullptr : &finite(along);
  if (*of->moving) raise({"a replay in another thread moves the scene's models", "load the scene once more"});
  const MovesModels moves(*of);
  for (const PythonClassPtr& python : entries.python) python->forget_failure();

  ex::StagedStudy study = without_lock([&](Progress& progress) -> Result<ex::StagedStudy> {
    PALPATE_ASSIGN(ex::Stage stage, stage_of(*of, samples, made, reference, progress));
    ex::StagedStudy staged{std::move(stage), ex::new_document("palpate.compare"), {}};
    ex::RunOptions options;
    options.threads = threads;
    options.passes = passes;
    options.budget_s = budget_s;
    options.own_process = false;  // an interpreter cannot be forked while it works
    metrics::MeasurementConditions conditions;
    PALPATE_ASSIGN(staged.runs, ex::run_renderers(staged.stage, entries.requests, entries.registry, options,
                                                  progress, conditions, {}));
    ex::add_program(conditions);
    staged.document.conditions = std::move(conditions);
    return staged;
  });
  for (const PythonClassPtr& python : entries.python)
    for (ex::Run& run : study.runs) {
      if (run.result.name != python->name() || !python->failure()) continue;
      metrics::RendererResult failed =
          ex::unfinished(study.stage, {run.result.label, run.result.name, {}}, entries.registry, threads);
      failed.status = metrics::RunStatus::kFailed;
      failed.reason = python->failure()->message();
      run = {};
      run.result = std::move(failed);
    }
  ex::finish_document(study);
  py::dict traces;
  for (ex::Run& run : study.runs)
    if (!run.trace.frames.empty())
      traces[py::str(run.result.label)] =
          Trace{std::make_shared<const trace::ForceTrace>(std::move(run.trace))};
  const Path walked{std::make_shared<const trace::ProbePath>(std::move(study.stage.path)), of};
  return py::make_tuple(metrics::to_json(study.document), walked, traces);
}

}  // namespace

Path made_path(const std::string& text, const ScenePtr& scene) {
  trace::ProbePath path = without_lock([&](Progress& progress) -> Result<trace::ProbePath> {
    if (scene == nullptr) {
      if (ex::is_generated_path(text))
        return Error{fmt::format("'{}' is made for a scene, and none is given", text), "give scene="};
      return ex::open_path(text, {});
    }
    PALPATE_ASSIGN(ex::Stage stage, stage_of(*scene, nullptr, text, "none", progress));
    return std::move(stage.path);
  });
  return {std::make_shared<const trace::ProbePath>(std::move(path)), scene};
}

void add_comparison(py::module_& module) {
  py::class_<Truth> truth(
      module, "Truth",
      "The constrained god object of the true surface along a path.\n\n"
      "force_n, god_object_mm, normal: (n, 3), N and mm. contact. distance_mm: of the HIP, negative\n"
      "inside. reference, exactness: in words.");
  const auto member = [&]<class T>(const char* name, T, py::ssize_t width, auto get) {
    truth.def_property_readonly(name, [width, get](const py::object& self) {
      const auto& frames = self.cast<const Truth&>().stage->reference->frames;
      return member_view<T>(frames, get(frames.front()), width, self);
    });
  };
  using trace::TruthFrame;
  member("force_n", double{}, 3, [](const TruthFrame& f) -> const void* { return f.frame.force_n.data(); });
  member("god_object_mm", double{}, 3,
         [](const TruthFrame& f) -> const void* { return f.frame.god_object_mm.data(); });
  member("contact", bool{}, 1, [](const TruthFrame& f) -> const void* { return &f.frame.contact; });
  member("normal", double{}, 3, [](const TruthFrame& f) -> const void* { return f.normal.data(); });
  member("distance_mm", double{}, 1,
         [](const TruthFrame& f) -> const void* { return &f.signed_distance_mm; });
  truth.def_property_readonly("reference", [](const Truth& self) { return self.stage->reference->name; })
      .def_property_readonly("exactness", [](const Truth& self) { return self.stage->reference->exactness; })
      .def("__len__", [](const Truth& self) { return self.stage->reference->frames.size(); })
      .def("_scores", &scores_of);
  module.def("truth", &make_truth, py::arg("path"), py::arg("scene") = py::none(), py::kw_only(),
             py::arg("reference") = "auto", py::arg("rate_hz") = kPathHz);
  module.def("_compare", &compare);
}

}  // namespace palpate::python
