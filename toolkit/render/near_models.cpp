#include "toolkit/render/near_models.h"

#include <algorithm>
#include <cmath>

namespace palpate::render {
namespace {

/// A list's reach around the HIP, as a share of the models' mean diagonal. Few models are tested in vain; a
/// list lasts some six frames at 1 m/s among models of 100 mm, and over a hundred at 50 mm/s.
constexpr double kMarginShare = 1.0 / 16.0;

geometry::Aabb around(const geometry::Aabb& local, const geometry::RigidTransform& pose) noexcept {
  // Extent along each world axis: |R| times the half extent.
  const Vec3 half = 0.5 * local.extent_mm();
  const Vec3 reach = pose.rotation.toRotationMatrix().cwiseAbs() * half;
  const Vec3 centre = pose * local.centre_mm();
  return {centre - reach, centre + reach};
}

}  // namespace

SceneBroadPhase::SceneBroadPhase(std::vector<ModelBox> models, double horizon_s)
    : models_(std::move(models)), horizon_s_(horizon_s) {
  double diagonals = 0.0;
  for (const ModelBox& model : models_) {
    diagonals += model.local_mm.extent_mm().norm();
    if (model.motion == nullptr) continue;
    moves_ = true;
    const std::shared_ptr<MotionVersion>& count = model.motion->motion_version();
    if (std::find(motion_version_.begin(), motion_version_.end(), count) == motion_version_.end())
      motion_version_.push_back(count);
  }
  if (!models_.empty()) margin_mm_ = kMarginShare * diagonals / static_cast<double>(models_.size());
  for (const ModelBox& model : models_) boxes_.push_back(box_of(model));
  phase_ = geometry::BroadPhase(boxes_);
}

/// Everywhere the model can be from now to the horizon.
geometry::Aabb SceneBroadPhase::box_of(const ModelBox& model) const noexcept {
  if (model.motion == nullptr) return around(model.local_mm, model.world_from_model);
  const PoseState& pose = model.motion->newest();
  geometry::Aabb box = around(model.local_mm, pose.at(t_s_));
  const geometry::RigidTransform later = pose.at(t_s_ + horizon_s_);
  box.add(around(model.local_mm, later));
  // A turning point strays from its chord by at most the length of its arc.
  const Vec3 about = pose.about_mm + pose.velocity_mm_s * (t_s_ - pose.t_s);
  const double arm =
      (around(model.local_mm, later).centre_mm() - about).norm() + model.local_mm.extent_mm().norm();
  return box.grown(pose.angular_velocity_rad_s.norm() * horizon_s_ * arm);
}

void SceneBroadPhase::move_to(double t_s) noexcept {
  t_s_ = t_s;
  if (!moves_) return;
  for (std::size_t i = 0; i < models_.size(); ++i) boxes_[i] = box_of(models_[i]);
  phase_.update(boxes_);
}

void SceneBroadPhase::run(double t_s, const Vec3& from_mm, const Vec3& to_mm) noexcept {
  const std::uint64_t before = motion_version();
  move_to(t_s);
  geometry::Aabb region;
  region.add(from_mm);
  region.add(to_mm);
  region = region.grown(margin_mm_);
  std::array<geometry::BoxHit, kMaxNearbyModels> hits;
  const geometry::BoxQuery query = phase_.query(region, hits);
  found_.valid = region;
  found_.motion_version = before;
  found_.until_s = moves_ ? t_s + horizon_s_ : HUGE_VAL;
  found_.count = query.hits;
  found_.too_many = query.left_out > 0;
  for (std::uint32_t i = 0; i < query.hits; ++i) found_.model[i] = hits[i].item;
  std::sort(found_.model.begin(), found_.model.begin() + found_.count);
}

std::size_t SceneBroadPhase::bytes() const noexcept {
  return models_.capacity() * sizeof(ModelBox) + phase_.bytes() + boxes_.capacity() * sizeof(geometry::Aabb) +
         sizeof(*this);
}

}  // namespace palpate::render
