// A stage whose surface is a stream of depth images.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <palpate/registry.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include "experiments/run/stage.h"
#include "experiments/streams/stream_feed.h"
#include "toolkit/core/hash.h"
#include "toolkit/search/knn.h"

namespace palpate::experiments {
namespace {

constexpr double kStreamFramesPerS = 1e3;
constexpr double kStreamStepS = 1e-3;
constexpr const char* kFeltOfStream = "depth-image";

/// One model: the first image's points.
Result<scene::LoadedScene> scene_of(const OpenStream& open, const surface::Surface& surface) {
  Result<cloud::Cloud> cloud = cloud_of(open.first, open.source->camera());
  if (!cloud) return std::move(cloud).error().in_file(open.name);
  scene::LoadedScene scene;
  render::ModelInput model;
  model.name = open.name;
  model.cloud = std::make_shared<const cloud::Cloud>(*std::move(cloud));
  model.camera = std::make_shared<const stream::DepthCamera>(open.source->camera());
  model.surface = surface;
  scene::Provenance from;
  from.source = open.source->describe();
  from.format = "depth images";
  from.file_points = model.cloud->size();
  Hash64 hash;
  for (std::size_t i = 0; i < model.cloud->size(); ++i)
    for (int axis = 0; axis < 3; ++axis) hash.real(model.cloud->point_mm(i)[axis]);
  from.content_hash = hash.hex();
  scene.provenance = {std::move(from)};
  scene.sampled_mesh = {nullptr};
  scene.input.models = {std::move(model)};
  return scene;
}

/// A prepared renderer that a hand feels while its path is made.
Result<std::unique_ptr<render::HapticRenderer>> prepared(const char* name, const render::SceneInput& scene,
                                                         int threads, Progress& progress) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> made, registry.make(name, {}));
  PALPATE_TRY(made->prepare(scene, {threads, &progress}));
  return made;
}

/// Scene of a simulated camera, as stiff as the stage's model.
render::SceneInput true_scene(const Stage& stage) {
  render::SceneInput scene = stage.stream->open.known->scene;
  const double stiffness = stage.scene.input.models.front().surface.stiffness_n_per_mm;
  for (render::ModelInput& model : scene.models) {
    model.surface = {};
    model.surface.stiffness_n_per_mm = stiffness;
  }
  return scene;
}

bool all_have_formulas(const render::SceneInput& scene) {
  return std::all_of(scene.models.begin(), scene.models.end(),
                     [](const render::ModelInput& model) { return model.analytic != nullptr; });
}

/// The hand's own path.
Status let_hand_work(Stage& stage, const NamedOptions& hand, int threads, Progress& progress) {
  progress.report("a hand feels the stream", -1.0);
  const OpenStream& open = stage.stream->open;
  PALPATE_ASSIGN(const HandView view, view_of(open.first, open.source->camera()));
  const bool still =
      open.known && open.known->scene.simulation == nullptr && all_have_formulas(open.known->scene);
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> felt,
                 still ? prepared("analytic", true_scene(stage), threads, progress)
                       : prepared(kFeltOfStream, stage.scene.input, threads, progress));
  std::unique_ptr<StreamFeed> feed;
  if (!still)
    feed = std::make_unique<StreamFeed>(stage.stream->images, *felt->depth_receiver(), stage.path,
                                        stage.stream->delay);
  bool begun = false;
  press_and_slide(
      view, stage.scene.input.models.front().surface.stiffness_n_per_mm, hand,
      [&](const Vec3& hip_mm, double t_s) {
        if (!std::exchange(begun, true)) {
          if (feed) feed->reset();
          felt->restart(hip_mm, t_s - kStreamStepS);
        }
        if (feed) feed->advance(t_s);
        return felt->step(hip_mm, t_s).force_n;
      },
      stage.path);
  return Done{};
}

/// The truth at one time, the models where they are then: the nearest surface.
trace::TruthFrame truth_at(const render::SceneInput& scene, const render::Frame& frame, const Vec3& hip_mm,
                           double t_s) {
  trace::TruthFrame truth;
  truth.frame = frame;
  double nearest_mm = HUGE_VAL;
  for (const render::ModelInput& model : scene.models) {
    const geometry::RigidTransform world_from_model =
        model.motion ? model.motion->newest().at(t_s) : model.world_from_model;
    const Vec3 local = world_from_model.inverse() * hip_mm;
    const double distance_mm = model.analytic->signed_distance_mm(local);
    if (!(distance_mm < nearest_mm)) continue;
    nearest_mm = distance_mm;
    truth.normal = world_from_model.rotate(model.analytic->closest(local).normal);
  }
  truth.signed_distance_mm = nearest_mm;
  if (!frame.contact) return truth;
  const Vec3 out = frame.god_object_mm - hip_mm;
  truth.signed_distance_mm = -out.norm();
  if (out.norm() > 0.0) truth.normal = out.normalized();
  return truth;
}

/// The mean age of the image that a tick feels: from light to arrival, until it is felt, and half a period.
double mean_age_s(const StagedStream& stream) {
  double sum_s = 0.0;
  for (const stream::DepthFrame& frame : stream.images.frames) sum_s += frame.arrived_s - frame.captured_s;
  const double delay_s = stream.delay.measured ? 0.0 : stream.delay.ms * kStreamStepS;
  return sum_s / static_cast<double>(stream.images.frames.size()) + delay_s +
         0.5 * stream.images.camera.period_s;
}

/// The formulas' own god object along the path, everything moving as the camera sees it: as it stood when
/// the image was taken that is felt. Of light's delay no renderer can make anything good.
Status add_stream_truth(Stage& stage, int threads, Progress& progress) {
  progress.report("computing the ground truth", -1.0);
  const render::SceneInput scene = true_scene(stage);
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> analytic,
                 prepared("analytic", scene, threads, progress));
  render::Simulation* const moves = scene.simulation.get();
  const double age_s = moves != nullptr ? mean_age_s(*stage.stream) : 0.0;
  trace::ProbePath seen = stage.path;
  for (double& t_s : seen.t_s) t_s -= age_s;
  PALPATE_ASSIGN(const trace::ForceTrace felt, trace::replay(*analytic, seen, moves));
  const OpenStream& open = stage.stream->open;
  const stream::DepthCamera& camera = open.source->camera();
  const geometry::RigidTransform camera_from_world = open.first.world_from_camera.inverse();
  trace::ReferenceTrace& reference = stage.reference.emplace();
  reference.name = "analytic";
  reference.exactness = "the god object on the formulas that the simulated camera sees; no second reference";
  if (moves != nullptr)
    reference.exactness +=
        fmt::format("; as they stood {:.3g} ms ago, the mean age of a felt image", age_s / kStreamStepS);
  if (moves != nullptr) moves->reset();
  for (std::size_t i = 0; i < stage.path.size(); ++i) {
    if (moves != nullptr) moves->advance(seen.t_s[i]);
    trace::TruthFrame frame = truth_at(scene, felt.frames[i], seen.hip_mm[i], seen.t_s[i]);
    // The diagonal of the square that a pixel sees there.
    frame.local_resolution_mm =
        std::sqrt(2.0) * std::abs((camera_from_world * felt.frames[i].god_object_mm).z()) / camera.fx_px;
    reference.frames.push_back(frame);
  }
  return Done{};
}

Status check_stream_reference(const StageRequest& request, const OpenStream& open) {
  const ReferenceChoice choice = request.reference;
  if (choice == ReferenceChoice::kAuto || choice == ReferenceChoice::kNone) return Done{};
  if (choice == ReferenceChoice::kAnalytic && open.known && all_have_formulas(open.known->scene))
    return Done{};
  return Error{"of a stream the truth is known where a simulated camera looks at formulas, and only there",
               "use --reference auto", open.name};
}

/// A path that was named: the first image's points stand for the model.
Status open_stream_path(const StageRequest& request, Stage& stage) {
  const render::ModelInput& model = stage.scene.input.models.front();
  paths::PathTarget target;
  target.cloud = model.cloud.get();
  target.box_mm = model.cloud->box_mm();
  target.spacing_mm = stage.spacing.nearest_mm.p50;
  target.world_from_model = model.world_from_model;
  target.stiffness_n_per_mm = model.surface.stiffness_n_per_mm;
  const std::string named = !request.path.empty() ? request.path : usual_path(target, request.usual_frames);
  PALPATE_ASSIGN(stage.path, open_path(named, target, request.load.max_bytes, &stage.warnings));
  return Done{};
}

}  // namespace

Result<Stage> set_up_stream(const StageRequest& request, const io::Readers& readers, Progress& progress) {
  Stage stage;
  stage.scene_name = request.stream.source;
  progress.report("opening the stream", -1.0);
  PALPATE_ASSIGN(OpenStream open, open_stream(request.stream.source, readers));
  PALPATE_TRY(check_stream_reference(request, open));
  PALPATE_ASSIGN(stage.scene, scene_of(open, request.scene.models.front().surface));
  stage.stream = std::make_shared<StagedStream>(StagedStream{std::move(open), {}, request.stream.delay});
  stage.notes.insert(stage.notes.end(), request.surfaces.notes.begin(), request.surfaces.notes.end());
  StagedStream& stream = *stage.stream;
  const cloud::Cloud& cloud = *stage.scene.input.models.front().cloud;
  stage.spacing = search::describe_spacing(cloud, search::exact_knn(cloud, request.threads));
  const bool own_hand =
      request.stream.replayed && (request.path.empty() || request.path.starts_with(kPressAndSlide));
  NamedOptions hand;
  if (own_hand) {
    PALPATE_ASSIGN(hand, parse_press_and_slide(request.path));
  } else {
    PALPATE_TRY(open_stream_path(request, stage));
  }
  if (!request.stream.replayed) return stage;
  double until_s = own_hand ? static_cast<double>(hand.options.integer("frames")) / kStreamFramesPerS
                            : stage.path.t_s.back();
  PALPATE_ASSIGN(stream.images, load_frames(stream.open, until_s, progress));
  if (own_hand) {
    // A hand stops with a recorded stream, a few periods behind its last image.
    constexpr double kPeriodsBehind = 3.0;
    const double end_s =
        stream.images.frames.back().arrived_s + kPeriodsBehind * stream.images.camera.period_s;
    const double frames = std::floor(std::min(until_s, end_s) * kStreamFramesPerS);
    hand.options.set("frames", fmt::format("{}", std::max(2.0, frames)));
    PALPATE_TRY(let_hand_work(stage, hand, request.threads, progress));
  }
  for (const std::string& message : stream.images.unreadable)
    stage.warnings.push_back("An image could not be read and is left out: " + message);
  stage.starts_free = true;
  const surface::Surface& surface = stage.scene.input.models.front().surface;
  stage.forces_comparable = !surface.friction.any() && surface.deformation == 0.0;
  stage.notes.push_back(
      stream.delay.measured
          ? std::string("Images are felt as late as each renderer's own receiver made them.")
          : fmt::format("Every renderer feels an image {:g} ms after it arrived, however "
                        "long its receiver takes; --stream-delay measured changes that.",
                        stream.delay.ms));
  if (request.reference == ReferenceChoice::kNone) return stage;
  if (stream.open.known && all_have_formulas(stream.open.known->scene)) {
    PALPATE_TRY(add_stream_truth(stage, request.threads, progress));
  } else {
    stage.notes.emplace_back("There is no ground truth: what the camera saw is known by its images alone.");
  }
  return stage;
}

}  // namespace palpate::experiments
