#include "experiments/live/hand.h"

#include <algorithm>
#include <cmath>

#include <palpate/replay.h>
#include <palpate/result.h>
#include "device/live/hand_controls.h"

namespace palpate::experiments {
namespace {

// Spacing of a script's waypoints: a quarter of a millimetre for a hand at 50 mm/s.
constexpr double kGoalStepS = 5e-3;

Result<device::HandScript> following(const trace::ProbePath& path, const device::DeviceMap& map,
                                     double seconds) {
  const double from_s = path.t_s.front();
  const auto points = static_cast<std::size_t>(std::ceil(seconds / kGoalStepS)) + 1;
  std::vector<double> t_s;
  std::vector<Vec3> goal_mm;
  t_s.reserve(points);
  goal_mm.reserve(points);
  const double step_s =
      path.size() > 1 ? (path.t_s.back() - from_s) / static_cast<double>(path.size() - 1) : kGoalStepS;
  const double stride = kGoalStepS / step_s;
  double at = 0.0;
  // Returns along the path: it starts in free space, but its end may be inside the model.
  int direction = 1;
  const double last = static_cast<double>(path.size() - 1);
  for (std::size_t i = 0; i < points; ++i) {
    t_s.push_back(static_cast<double>(i) * kGoalStepS);
    goal_mm.push_back(map.device_mm(path.hip_mm[static_cast<std::size_t>(std::lround(at))]));
    at += direction * stride;
    if (at > last || at < 0.0) {
      direction = at < 0.0 ? 1 : -1;
      at = std::clamp(at, 0.0, last);
    }
  }
  return device::HandScript::create(kFollowHand, std::move(t_s), std::move(goal_mm),
                                    device::HandScript::Between::kStraight);
}

}  // namespace

Result<device::TaskPlace> touched_place(const trace::ProbePath& path, render::HapticRenderer& renderer,
                                        const device::DeviceMap& map) {
  PALPATE_ASSIGN(const trace::ForceTrace felt, trace::replay(renderer, path));
  double deepest_n = 0.0;
  device::TaskPlace place;
  for (const render::Frame& frame : felt.frames) {
    const double size_n = frame.force_n.norm();
    if (!frame.contact || !(size_n > deepest_n)) continue;
    deepest_n = size_n;
    place.point_mm = map.device_mm(frame.god_object_mm);
    place.normal = map.device_n(frame.force_n / size_n);
  }
  if (!(deepest_n > 0.0))
    return Error{"the path nowhere touches the model", "name another path with --path", path.name};
  const Vec3 axis =
      std::abs(place.normal.x()) < std::abs(place.normal.y()) ? Vec3(Vec3::UnitX()) : Vec3(Vec3::UnitY());
  place.along = (axis - axis.dot(place.normal) * place.normal).normalized();
  return place;
}

bool is_hand_path(const std::string& path) {
  return path.substr(0, path.find(':')) == kHandPath;
}

const std::vector<std::string>& live_hands() {
  static const std::vector<std::string> kHands = {kExploreHand, kFollowHand, "press", "slide", "tap"};
  return kHands;
}

Result<device::HandScript> live_hand(const std::string& hand, const trace::ProbePath& path,
                                     render::HapticRenderer& renderer, const device::DeviceMap& map,
                                     double seconds) {
  if (hand == kFollowHand) return following(path, map, seconds);
  PALPATE_ASSIGN(const device::TaskPlace place, touched_place(path, renderer, map));
  const device::TaskSizes sizes;
  const device::HandScript once = hand == "press"   ? device::press(place, sizes)
                                  : hand == "slide" ? device::slide(place, sizes)
                                                    : device::tap(place, sizes);
  std::vector<double> t_s;
  std::vector<Vec3> goal_mm;
  for (double t = 0.0; t < seconds + kGoalStepS; t += kGoalStepS) {
    t_s.push_back(t);
    goal_mm.push_back(once.at(std::fmod(t, once.duration_s())).position_mm);
  }
  return device::HandScript::create(hand, std::move(t_s), std::move(goal_mm),
                                    device::HandScript::Between::kStraight);
}

Result<cloud::Cloud> within_reach(const cloud::Cloud& cloud, const device::DeviceMap& map,
                                  const device::DeviceLimits& limits) {
  constexpr double kShareOfReach = 0.8;      // the rest is for lifts and for surfaces that move
  constexpr std::size_t kFewestPoints = 16;  // of a plane's fit
  const Vec3 middle_mm = 0.5 * (limits.workspace_mm.low_mm + limits.workspace_mm.high_mm);
  const Vec3 half_mm = kShareOfReach * device::reachable_half_mm(limits);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 at_mm = map.device_mm(cloud.point_mm(i)) - middle_mm;
    if ((at_mm.cwiseAbs().array() <= half_mm.array()).all()) points.push_back(cloud.point_mm(i));
  }
  if (points.size() < kFewestPoints)
    return Error{"the device reaches nothing of the stream's first image", "give --mapping fitted"};
  return cloud::build_cloud(points, cloud::NonFinite::kDrop);
}

Result<std::unique_ptr<ExploringHand>> ExploringHand::create(const paths::PathTarget& target,
                                                             const paths::HandOptions& options,
                                                             const device::DeviceMap& map,
                                                             double grip_n_per_mm, double period_s) {
  PALPATE_ASSIGN(paths::Hand hand, paths::Hand::create(target, options));
  return std::unique_ptr<ExploringHand>(
      new ExploringHand(std::move(hand), target, map, grip_n_per_mm, period_s));
}

ExploringHand::ExploringHand(paths::Hand hand, const paths::PathTarget& target, const device::DeviceMap& map,
                             double grip_n_per_mm, double period_s)
    : hand_(std::move(hand)),
      world_from_model_(target.world_from_model),
      origin_mm_(target.cloud->origin_mm),
      map_(map),
      grip_n_per_mm_(grip_n_per_mm),
      period_s_(period_s),
      begin_mm_(world_from_model_ * Vec3(hand_.start_mm() + origin_mm_)),
      goal_mm_(begin_mm_),
      // The goal is set in every tick.
      guide_(std::make_shared<device::HandGuide>(map.device_mm(begin_mm_), period_s)) {}

void ExploringHand::took(const device::Tick& tick) noexcept {
  // The hand waits where it is while no force is sent.
  if (tick.fault != device::Fault::kNone) return;
  const auto in_model = [this](const Vec3& world) { return world_from_model_.rotation.inverse() * world; };
  const Vec3 stretch_mm = map_.device_mm(tick.hip_mm) - map_.device_mm(goal_mm_);
  const paths::HandInput felt{world_from_model_.inverse() * tick.hip_mm - origin_mm_,
                              in_model(map_.world_n(tick.sent_n)),
                              in_model(map_.world_n(grip_n_per_mm_ * stretch_mm))};
  goal_mm_ += period_s_ * (world_from_model_.rotation * hand_.step(felt, t_s_, period_s_));
  t_s_ += period_s_;
  guide_->aim(map_.device_mm(goal_mm_));
}

}  // namespace palpate::experiments
