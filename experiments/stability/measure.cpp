#include <algorithm>
#include <cmath>

#include <palpate/accuracy.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include "device/simulated/closed_loop.h"
#include "device/simulated/simulated_arm.h"
#include "experiments/stability/stability.h"
#include "toolkit/metrics/closest_point.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments {
namespace {

// Stiffnesses tried: from barely felt by a hand of 0.4 N/mm to ten times any device's limit.
constexpr double kLeastNPerMm = 0.05, kMostNPerMm = 100.0;
constexpr double kTriedStep = 1.5;
constexpr double kToWithin = 1.03;
// Push on a released device beyond its friction. It meets the wall at some 150 mm/s, like a tap, and rests
// less than twice a goal's depth below it at the least stiffness.
constexpr double kPushN = 0.3;
constexpr double kLeastReleasedNPerMm = 0.1;
constexpr double kUmPerMm = 1e3;
// Largest time difference between truth and renderer at the same place.
constexpr double kApartS = 0.1;
constexpr double kPressS = 4.3;  // duration of device::press
// Time at rest that ends a press: the longest allowed delay is 20 ms, and renderers' time effects such as
// dents take some tens of ms.
constexpr double kStillS = 0.25;

struct PressTrial {
  bool stable = false;
  bool lost = false;  ///< at rest but not held: fell through or was pushed off
  device::Swing swing;
  double generated_mj = 0.0;
};

/// True for a run that ends in a lasting, noticeable swing; `most` is the largest one.
bool swings(const device::LoopRun& run, const device::TaskPlace& place, device::Swing& most) {
  if (run.fault != device::Fault::kNone) return true;
  bool any = false;
  for (const Vec3& axis : {place.normal, place.along, Vec3(place.normal.cross(place.along))}) {
    const device::Swing swing = device::swing_of(run.hip, axis, 0.0);
    if (swing.amplitude_mm > most.amplitude_mm) most = swing;
    any = any || (swing.sustained && swing.frequency_hz > 0.0 &&
                  swing.amplitude_mm * kUmPerMm > metrics::detection_threshold_um(swing.frequency_hz));
  }
  return any;
}

Result<PressTrial> press_with(render::HapticRenderer& unit, double gain,
                              const control::ControlOptions& control, const StabilityPoint& point,
                              const Bench& bench, const Places& places) {
  std::unique_ptr<render::HapticRenderer> felt = std::make_unique<GainRenderer>(unit, gain);
  if (point.damping_n_s_per_mm > 0.0) {
    // A coupling with a practically rigid spring leaves only its damper.
    constexpr double kRigidNPerMm = 1e12;
    control::ControlOptions damper;
    damper.coupling = control::Coupling{kRigidNPerMm, point.damping_n_s_per_mm};
    felt = control::wrap(std::move(felt), damper);
  }
  felt = control::wrap(std::move(felt), control);
  const bool released = point.hand == "released";
  device::TaskPlace place = places.flat;
  place.point_mm.setZero();
  device::HandScript script =
      released ? device::HandScript::create("push", {0.0}, {places.sizes.above_mm * place.normal},
                                            device::HandScript::Between::kStraight)
                     .value()
               : device::press(place, places.sizes);
  PALPATE_ASSIGN(const device::LoopRun run,
                 run_on(bench, script, *felt, places.flat.point_mm, {kPressS, kStillS}));
  PressTrial trial;
  const bool swinging = swings(run, place, trial.swing);
  trial.lost = !swinging && !run.felt.frames.back().contact;
  trial.stable = !swinging && !trial.lost;
  trial.generated_mj = -run.least_environment_mj;
  return trial;
}

/// Adds the linear loop's limit on a plane, and the bound for any hand.
void add_theory(const Bench& bench, StabilityPoint& point) {
  if (point.control != "none") return;
  if (!bench.arm) {
    if (point.hand != "released") return;
    const device::AdmittanceOptions a = device::admittance_model();
    const double t = bench.period_s(), mass = a.mass_kg * device::kNS2PerMmPerKg;
    // The virtual mass's poles leave the unit circle at -1.
    point.theory_n_per_mm =
        (4.0 * mass - 2.0 * (a.damping_n_s_per_mm + 2.0 * point.damping_n_s_per_mm) * t) / (t * t);
    return;
  }
  const device::ArmOptions& arm = *bench.arm;
  const device::Plant plant{arm.mass_kg + bench.hand.mass_kg,
                            arm.damping_n_s_per_mm + bench.hand.damping_n_s_per_mm,
                            bench.hand.stiffness_n_per_mm, arm.lag_s};
  const double exact =
      device::linear_stiffness_n_per_mm({plant, bench.period_s(), bench.delay_s, point.damping_n_s_per_mm});
  if (std::isfinite(exact)) point.theory_n_per_mm = exact;
  if (bench.delay_s == 0.0)
    point.passive_n_per_mm = device::passive_stiffness_n_per_mm(
        arm.damping_n_s_per_mm, point.damping_n_s_per_mm, arm.friction_n, arm.encoder_mm, bench.period_s());
}

/// Distance of each place of `way` from the polyline of `truth` at about the same time.
void contour(const trace::ProbePath& way, const trace::ProbePath& truth, TaskResult& result) {
  double sum = 0.0;
  std::size_t from = 0, to = 0;
  for (std::size_t i = 0; i < way.size(); ++i) {
    while (from + 1 < truth.size() && truth.t_s[from] < way.t_s[i] - kApartS) ++from;
    while (to + 1 < truth.size() && truth.t_s[to] < way.t_s[i] + kApartS) ++to;
    double least = (way.hip_mm[i] - truth.hip_mm[from]).squaredNorm();
    for (std::size_t k = from; k < to; ++k) {
      const Vec3 leg = truth.hip_mm[k + 1] - truth.hip_mm[k], off = way.hip_mm[i] - truth.hip_mm[k];
      const double square = leg.squaredNorm();
      const double share = square > 0.0 ? std::clamp(off.dot(leg) / square, 0.0, 1.0) : 0.0;
      least = std::min(least, (off - share * leg).squaredNorm());
    }
    sum += least;
    result.contour_max_mm = std::max(result.contour_max_mm, std::sqrt(least));
  }
  if (way.size() > 0) result.contour_rms_mm = std::sqrt(sum / static_cast<double>(way.size()));
}

/// Output of a first-order motor for forces commanded at the samples; each sample shows the earlier ones.
void lag(const trace::ProbePath& path, double lag_s, std::vector<render::Frame>& frames) {
  if (!(lag_s > 0.0)) return;
  Vec3 shown = Vec3::Zero(), commanded = Vec3::Zero();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (i > 0) shown += (1.0 - std::exp((path.t_s[i - 1] - path.t_s[i]) / lag_s)) * (commanded - shown);
    commanded = frames[i].force_n;
    frames[i].force_n = shown;
  }
}

/// Scores a trace against the truth's closest points along its own path.
Result<LoopScores::Side> side_of(const trace::ProbePath& path, trace::ForceTrace felt, const Stage& stage,
                                 const Bench& bench, Progress& progress) {
  metrics::AccuracyOptions options;
  options.stiffness_n_per_mm = scene_stiffness(stage);
  PALPATE_ASSIGN(
      trace::ReferenceTrace reference,
      metrics::closest_point_reference(*stage.truth, path, options.stiffness_n_per_mm, 0.0, progress));
  LoopScores::Side side;
  PALPATE_ASSIGN(const metrics::Accuracy scores, metrics::score(path, felt, reference, nullptr, options));
  side.frames = scores.frames;
  side.contact_frames = scores.contact_frames;
  if (!stage.forces_comparable) return side;
  side.force_rms_percent = scores.force_rms_percent;
  side.direction_p99_deg = scores.direction_p99_deg;
  side.indistinguishable_percent = scores.indistinguishable_percent;
  side.ripple_ratio = scores.ripple_ratio;
  lag(path, bench.arm ? bench.arm->lag_s : 0.0, felt.frames);
  std::vector<render::Frame> wanted;
  for (const trace::TruthFrame& frame : reference.frames) wanted.push_back(frame.frame);
  lag(path, bench.arm ? bench.arm->lag_s : 0.0, wanted);
  for (std::size_t i = 0; i < wanted.size(); ++i) reference.frames[i].frame.force_n = wanted[i].force_n;
  PALPATE_ASSIGN(const metrics::Accuracy shown, metrics::score(path, felt, reference, nullptr, options));
  side.ripple_shown_ratio = shown.ripple_ratio;
  return side;
}

metrics::ForceSteps steps_of(const device::LoopRun& run, double stiffness_n_per_mm) {
  metrics::ForceSteps steps(stiffness_n_per_mm);
  for (std::size_t i = 0; i < run.measured.size(); ++i)
    steps.observe(run.measured.t_s[i], run.measured.hip_mm[i], run.felt.frames[i].force_n);
  return steps;
}

struct HandTask {
  device::HandScript script;
  device::TaskPlace place;  ///< about its own origin
  Vec3 origin_mm;
};

Result<std::vector<HandTask>> tasks_on(const Stage& stage, const Places& places) {
  std::vector<HandTask> tasks;
  device::TaskPlace flat = places.flat;
  flat.point_mm.setZero();
  const Vec3& at = places.flat.point_mm;
  tasks.push_back({device::press(flat, places.sizes), flat, at});
  tasks.push_back({device::slide(flat, places.sizes), flat, at});
  tasks.push_back({device::tap(flat, places.sizes), flat, at});
  tasks.push_back({device::release_contact(flat, places.sizes), flat, at});
  if (places.has_edge) {
    device::TaskPlace edge = places.edge;
    edge.point_mm.setZero();
    tasks.push_back({device::slide(edge, places.sizes), edge, places.edge.point_mm});
  }
  trace::ProbePath goal = stage.path;
  for (Vec3& hip_mm : goal.hip_mm) hip_mm -= at;
  PALPATE_ASSIGN(device::HandScript along, device::HandScript::along(goal));
  tasks.push_back({std::move(along), flat, at});
  return tasks;
}

const char* task_name(std::size_t index, bool edge) {
  constexpr const char* kNames[] = {"press", "slide", "tap", "let-go", "edge", "path"};
  return kNames[!edge && index == 4 ? 5 : index];
}

}  // namespace

double scene_stiffness(const Stage& stage) {
  const surface::Surface& surface = stage.scene.input.models.front().surface;
  return surface.stiffness_n_per_mm * (1.0 - surface.deformation);
}

Status find_largest_stable(render::HapticRenderer& unit, double unit_n_per_mm,
                           const control::ControlOptions& control, Bench bench, const Places& places,
                           StabilityPoint& point, const RunDone& done) {
  bench.rate_hz = point.rate_hz;
  bench.delay_s = point.delay_ms / kMillisecondsPerS;
  if (point.hand == "released") {
    bench.hand = device::Hand{};
    const double friction = bench.arm ? bench.arm->friction_n : 0.0;
    bench.hand.push_n = -(friction + kPushN) * places.flat.normal;
  }
  add_theory(bench, point);
  const auto tried = [&](double stiffness) -> Result<PressTrial> {
    Result<PressTrial> trial = press_with(unit, stiffness / unit_n_per_mm, control, point, bench, places);
    done();
    return trial;
  };
  double low = 0.0, high = point.hand == "released" ? kLeastReleasedNPerMm : kLeastNPerMm;
  PressTrial last;
  for (; high < kMostNPerMm; high *= kTriedStep) {
    PALPATE_ASSIGN(last, tried(high));
    if (!last.stable) break;
    low = high;
  }
  point.unlimited = last.stable;
  while (!last.stable && low > 0.0 && high > kToWithin * low) {
    const double middle = std::sqrt(low * high);
    PALPATE_ASSIGN(const PressTrial trial, tried(middle));
    if (trial.stable) {
      low = middle;
    } else {
      high = middle;
      last = trial;
    }
  }
  point.largest_stable_n_per_mm = low;
  if (point.unlimited) return Done{};
  point.lost = last.lost;
  point.limit_cycle_mm = last.swing.amplitude_mm;
  point.limit_cycle_hz = last.swing.frequency_hz;
  point.generated_mj = last.generated_mj;
  return Done{};
}

Result<std::vector<TaskResult>> do_tasks(render::HapticRenderer& renderer, const Stage& stage,
                                         const Bench& bench, const Places& places, const RunDone& done) {
  PALPATE_ASSIGN(const std::vector<HandTask> tasks, tasks_on(stage, places));
  TruthRenderer truth(*stage.truth, scene_stiffness(stage));
  std::vector<TaskResult> results;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const HandTask& task = tasks[i];
    const double duration_s = task.script.duration_s();
    PALPATE_ASSIGN(const device::LoopRun run,
                   run_on(bench, task.script, renderer, task.origin_mm, {duration_s}));
    PALPATE_ASSIGN(const device::LoopRun right,
                   run_on(bench, task.script, truth, task.origin_mm, {duration_s}));
    TaskResult result;
    result.task = task_name(i, places.has_edge);
    device::Swing most;
    // Only a press ends at rest: in other tasks the hand moves, so swings are its own.
    result.stable = run.fault == device::Fault::kNone && (i > 0 || !swings(run, task.place, most));
    contour(run.hip, right.hip, result);
    const metrics::ForceSteps steps = steps_of(run, scene_stiffness(stage));
    result.largest_step_n = steps.step().n;
    result.largest_excess_n = steps.excess().n;
    result.truth_largest_excess_n = steps_of(right, scene_stiffness(stage)).excess().n;
    result.generated_mj = -run.least_environment_mj;
    results.push_back(std::move(result));
    done();
  }
  return results;
}

Result<LoopScores> score_loop(render::HapticRenderer& renderer, const Stage& stage, const Bench& bench,
                              const Places& places, Progress& progress, const RunDone& done) {
  LoopScores scores;
  PALPATE_ASSIGN(trace::ForceTrace open,
                 trace::replay(renderer, stage.path, stage.scene.input.simulation.get()));
  PALPATE_ASSIGN(scores.open, side_of(stage.path, std::move(open), stage, bench, progress));
  done();
  PALPATE_ASSIGN(const std::vector<HandTask> tasks, tasks_on(stage, places));
  const HandTask& path = tasks.back();
  PALPATE_ASSIGN(device::LoopRun closed,
                 run_on(bench, path.script, renderer, path.origin_mm, {path.script.duration_s()}));
  PALPATE_ASSIGN(scores.closed, side_of(closed.measured, std::move(closed.felt), stage, bench, progress));
  done();
  return scores;
}

namespace {

// Travel of a task as a share of the model: limits a hand's 2 mm goals on small models.
constexpr double kShareOfModel = 0.05;
// An edge turns the normal by at least this within a task's travel; less is felt as a curve.
constexpr double kEdgeCosine = 0.94;  // 20 degrees
// Contact frames examined.
constexpr std::size_t kLookedAt = 500;

/// A unit vector across `normal`, deterministic.
Vec3 tangent_of(const Vec3& normal) {
  const Vec3 axis = std::abs(normal.x()) < 0.6 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::UnitY());
  return (axis - axis.dot(normal) * normal).normalized();
}

}  // namespace

render::Frame TruthRenderer::step(const Vec3& hip_mm, double /*t_s*/) noexcept {
  if (hip_mm == last_hip_mm_) return last_;
  last_ = answer(hip_mm);
  last_hip_mm_ = hip_mm;
  return last_;
}

render::Frame TruthRenderer::answer(const Vec3& hip_mm) const noexcept {
  render::Frame frame;
  frame.god_object_mm = hip_mm;
  if (!is_finite(hip_mm)) {
    frame.status = render::FrameStatus::kNonFinite;
    return frame;
  }
  if (!(truth_.signed_distance_mm(hip_mm) < 0.0)) return frame;
  frame.contact = true;
  frame.model = 0;
  frame.god_object_mm = truth_.closest(hip_mm).point_mm;
  frame.force_n = stiffness_n_per_mm_ * (frame.god_object_mm - hip_mm);
  return frame;
}

Result<Bench> bench_of(const std::string& device, const std::string& hand) {
  PALPATE_ASSIGN(device::SimulatedRig rig, device::simulated_rig(device, hand));
  Bench bench;
  bench.arm = std::move(rig.arm);
  bench.hand = std::move(rig.hand);
  return bench;
}

Result<device::LoopRun> run_on(const Bench& bench, const device::HandScript& script,
                               render::HapticRenderer& renderer, const Vec3& origin_mm,
                               const RunLength& length) {
  VirtualClock clock;
  device::LoopOptions options;
  options.period_s = bench.period_s();
  options.jitter_s = bench.jitter_s;
  options.duration_s = length.duration_s;
  options.still_s = length.still_s;
  options.slew_n_per_s = bench.slew_n_per_s;
  options.world_from_device.translation_mm = origin_mm;
  if (bench.arm) {
    device::ArmOptions arm = *bench.arm;
    arm.period_s = bench.period_s();
    arm.delay_s = bench.delay_s;
    device::SimulatedArm device(arm, bench.hand, script, clock);
    return device::run_loop(renderer, device, clock, options);
  }
  device::AdmittanceOptions admittance = device::admittance_model();
  admittance.period_s = bench.period_s();
  device::SimulatedAdmittance device(admittance, bench.hand, script, clock);
  return device::run_loop(renderer, device, clock, options);
}

Result<Places> places_on(const Stage& stage) {
  if (std::optional<Error> none = why_no_truth(stage.scene.input))
    return std::move(*none).in_file(stage.scene_name);
  if (!stage.reference || stage.truth == nullptr)
    return Error{"this scene has no ground truth to compare with",
                 "use a generated model or a mesh file, or name a truth with --reference", stage.scene_name};
  const geometry::Aabb box = stage.scene.input.models.front().cloud->box_mm();
  Places places;
  const double size = kShareOfModel * box.extent_mm().maxCoeff();
  places.sizes.depth_mm = std::min(places.sizes.depth_mm, size);
  places.sizes.above_mm = std::min(places.sizes.above_mm, size);
  places.sizes.travel_mm = std::min(places.sizes.travel_mm, 5.0 * size);
  const std::vector<trace::TruthFrame>& truth = stage.reference->frames;
  std::vector<std::size_t> contact;
  for (std::size_t i = 0; i < truth.size(); ++i)
    if (truth[i].frame.contact && !truth[i].history_decides) contact.push_back(i);
  // Searches from the path's middle outwards for a place with free space above and material below.
  const std::size_t stride = std::max<std::size_t>(1, contact.size() / kLookedAt);
  std::optional<std::size_t> found;
  for (std::size_t k = 0; k < contact.size() && !found; k += stride) {
    const std::size_t middle = contact.size() / 2;
    const std::size_t at = contact[(middle + k) % contact.size()];
    const Vec3& g = truth[at].frame.god_object_mm;
    const Vec3& n = truth[at].normal;
    if (stage.truth->signed_distance_mm(g + places.sizes.above_mm * n) > 0.5 * places.sizes.above_mm &&
        stage.truth->signed_distance_mm(g - places.sizes.depth_mm * n) < -0.5 * places.sizes.depth_mm)
      found = at;
  }
  if (!found)
    return Error{"the path nowhere touches the true surface with room for a hand",
                 "name another path with --path", stage.path.name};
  places.flat = {truth[*found].frame.god_object_mm, truth[*found].normal, tangent_of(truth[*found].normal)};
  double turned = kEdgeCosine;
  for (std::size_t k = stride; k < contact.size(); k += stride) {
    const trace::TruthFrame &a = truth[contact[k - stride]], &b = truth[contact[k]];
    const double cosine = a.normal.dot(b.normal);
    const Vec3 normal = a.normal + b.normal, along = a.normal.cross(b.normal);
    if (cosine >= turned || (a.frame.god_object_mm - b.frame.god_object_mm).norm() > places.sizes.travel_mm ||
        !(normal.norm() > 0.0) || !(along.norm() > 0.0))
      continue;
    const geometry::SurfacePoint top = stage.truth->closest(
        0.5 * (a.frame.god_object_mm + b.frame.god_object_mm) + places.sizes.above_mm * normal.normalized());
    turned = cosine;
    places.has_edge = true;
    places.edge = {top.point_mm, normal.normalized(), along.normalized()};
  }
  return places;
}

}  // namespace palpate::experiments
