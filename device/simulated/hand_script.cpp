#include "device/simulated/hand_script.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate::device {
namespace {

// Durations of a task's parts: an adult's reach of some millimetres takes a few tenths of a second.
constexpr double kReachS = 0.3;
constexpr double kPressS = 4.3;  // long enough to see whether a swing dies: swing_of()
constexpr double kSlideS = 1.2;
constexpr double kTapS = 0.2;
constexpr int kTaps = 5;
constexpr double kReleaseS = 1.0, kAfterReleaseS = 1.5;

/// Makes the script of a task from waypoints valid by construction.
HandScript scripted(std::string name, std::vector<double> t_s, std::vector<Vec3> goal_mm) {
  return HandScript::create(std::move(name), std::move(t_s), std::move(goal_mm),
                            HandScript::Between::kMinimumJerk)
      .value();
}

}  // namespace

Result<HandScript> HandScript::create(std::string name, std::vector<double> t_s, std::vector<Vec3> goal_mm,
                                      Between between) {
  if (t_s.empty() || t_s.size() != goal_mm.size())
    return Error{"the hand's script has no waypoints, or not a time for each", "give both lists", name};
  for (std::size_t i = 0; i < t_s.size(); ++i)
    if (!std::isfinite(t_s[i]) || !is_finite(goal_mm[i]) || (i > 0 && !(t_s[i] > t_s[i - 1])))
      return Error{"waypoint " + std::to_string(i) + " of the hand's script is not finite, or not later",
                   "give finite places at increasing times", name};
  HandScript script;
  script.name_ = std::move(name);
  script.t_s_ = std::move(t_s);
  script.goal_mm_ = std::move(goal_mm);
  script.between_ = between;
  return script;
}

Result<HandScript> HandScript::along(const trace::ProbePath& path) {
  std::vector<double> t_s;
  t_s.reserve(path.size());
  for (const double t : path.t_s) t_s.push_back(t - path.t_s.front());
  return create(path.name, std::move(t_s), path.hip_mm, Between::kStraight);
}

HandScript HandScript::guided(std::string name, std::shared_ptr<HandGuide> guide) {
  HandScript script;
  script.name_ = std::move(name);
  script.t_s_ = {0.0};
  script.goal_mm_ = {guide->at(0.0).position_mm};
  script.guide_ = std::move(guide);
  return script;
}

Goal HandScript::at(double t_s) const noexcept {
  if (guide_) return guide_->at(t_s);
  if (!(t_s > t_s_.front())) return {goal_mm_.front(), Vec3::Zero()};
  if (t_s >= t_s_.back()) return {goal_mm_.back(), Vec3::Zero()};
  const auto next = static_cast<std::size_t>(std::upper_bound(t_s_.begin(), t_s_.end(), t_s) - t_s_.begin());
  const double span_s = t_s_[next] - t_s_[next - 1];
  const double share = (t_s - t_s_[next - 1]) / span_s;
  const Vec3 way_mm = goal_mm_[next] - goal_mm_[next - 1];
  if (between_ == Between::kStraight) return {goal_mm_[next - 1] + share * way_mm, way_mm / span_s};
  // 10 s^3 - 15 s^4 + 6 s^5: minimum jerk, at rest at both ends.
  const double s2 = share * share;
  const double part = s2 * share * (10.0 + share * (-15.0 + 6.0 * share));
  const double rate = 30.0 * s2 * (1.0 - share) * (1.0 - share) / span_s;
  return {goal_mm_[next - 1] + part * way_mm, rate * way_mm};
}

double HandScript::rests_from_s() const noexcept {
  if (guide_) return std::numeric_limits<double>::infinity();
  std::size_t last = t_s_.size() - 1;
  while (last > 0 && goal_mm_[last - 1] == goal_mm_[last]) --last;
  return t_s_[last];
}

HandScript press(const TaskPlace& place, const TaskSizes& sizes) {
  const Vec3 above = place.point_mm + sizes.above_mm * place.normal;
  const Vec3 below = place.point_mm - sizes.depth_mm * place.normal;
  return scripted("press", {0.0, kReachS, kPressS}, {above, below, below});
}

HandScript slide(const TaskPlace& place, const TaskSizes& sizes) {
  const Vec3 aside = 0.5 * sizes.travel_mm * place.along;
  const Vec3 up = sizes.above_mm * place.normal, down = -sizes.depth_mm * place.normal;
  const Vec3 from = place.point_mm - aside, to = place.point_mm + aside;
  return scripted("slide",
                  {0.0, kReachS, kReachS + kSlideS, kReachS + 2.0 * kSlideS, 2.0 * (kReachS + kSlideS)},
                  {from + up, from + down, to + down, from + down, from + up});
}

HandScript tap(const TaskPlace& place, const TaskSizes& sizes) {
  const Vec3 above = place.point_mm + sizes.above_mm * place.normal;
  const Vec3 below = place.point_mm - sizes.depth_mm * place.normal;
  std::vector<double> t_s = {0.0};
  std::vector<Vec3> goal_mm = {above};
  for (int i = 0; i < 2 * kTaps; ++i) {
    t_s.push_back(t_s.back() + kTapS);
    goal_mm.push_back(i % 2 == 0 ? below : above);
  }
  return scripted("tap", std::move(t_s), std::move(goal_mm));
}

HandScript release_contact(const TaskPlace& place, const TaskSizes& sizes) {
  const Vec3 above = place.point_mm + sizes.above_mm * place.normal;
  const Vec3 below = place.point_mm - sizes.depth_mm * place.normal;
  HandScript script = scripted("let-go", {0.0, kReachS, kAfterReleaseS}, {above, below, below});
  script.release_s = kReleaseS;
  return script;
}

}  // namespace palpate::device
