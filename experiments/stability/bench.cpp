#include "experiments/stability/bench.h"

#include <algorithm>
#include <cmath>

#include <palpate/result.h>
#include "device/simulated/simulated_arm.h"

namespace palpate::experiments {
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
