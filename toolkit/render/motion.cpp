#include <palpate/motion.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::render {
namespace {

/// Poses of one course, each computed from its start, agree to a few roundings. This tolerance is a million
/// roundings and a thousandth of a near list's margin.
constexpr double kSameMotion = 1e-9;

}  // namespace

bool MovingModel::continues(const PoseState& before, const PoseState& now) noexcept {
  const geometry::RigidTransform there = before.at(now.t_s);
  const Vec3 &a = there.translation_mm, &b = now.world_from_model.translation_mm;
  const double size = a.norm() + b.norm() + now.about_mm.norm();
  return before.velocity_mm_s == now.velocity_mm_s &&
         before.angular_velocity_rad_s == now.angular_velocity_rad_s &&
         (a - b).norm() <= kSameMotion * size &&
         std::abs(there.rotation.dot(now.world_from_model.rotation)) >= 1.0 - kSameMotion;
}

PoseState ScriptedMotion::at(double t_s) const noexcept {
  PoseState state;
  state.t_s = start_s;
  state.world_from_model = start;
  state.about_mm = about_mm;
  state.velocity_mm_s = velocity_mm_s;
  state.angular_velocity_rad_s = angular_velocity_rad_s;
  const double moving_s = std::clamp(t_s, start_s, stop_s);
  PoseState now = state;
  now.world_from_model = state.at(moving_s);
  now.about_mm = about_mm + velocity_mm_s * (moving_s - start_s);
  now.t_s = t_s;
  if (t_s < start_s || t_s >= stop_s) {
    now.velocity_mm_s = Vec3::Zero();
    now.angular_velocity_rad_s = Vec3::Zero();
  }
  if (!(swing_hz > 0.0)) return now;
  const double omega = 2.0 * std::numbers::pi * swing_hz;
  const Vec3 swung = std::sin(omega * t_s) * swing_mm;
  now.world_from_model.translation_mm += swung;
  now.about_mm += swung;
  now.velocity_mm_s += omega * std::cos(omega * t_s) * swing_mm;
  return now;
}

std::shared_ptr<MovingModel> ScriptedSimulation::add(const ScriptedMotion& motion) {
  parts_.push_back({motion, std::make_shared<MovingModel>(motion.at(0.0), motion_version_)});
  return parts_.back().model;
}

void ScriptedSimulation::reset() noexcept {
  next_tick_ = 0.0;
  publish(0.0);
  next_tick_ = 1.0;
}

void ScriptedSimulation::advance(double t_s) noexcept {
  const double ticks = std::floor(t_s * rate_hz_);
  if (ticks < next_tick_) return;
  next_tick_ = ticks + 1.0;
  publish(ticks / rate_hz_);
}

void ScriptedSimulation::publish(double t_s) noexcept {
  for (const Part& part : parts_) part.model->publish(part.motion.at(t_s));
}

}  // namespace palpate::render
