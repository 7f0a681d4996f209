// Intention of a simulated hand: a moving goal and a release time. The goal pulls the hand through its spring
// and damper; forces decide where the hand goes.
#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <palpate/result.h>
#include <palpate/trace.h>
#include <palpate/triple_buffer.h>
#include <palpate/vec.h>

namespace palpate::device {

struct Goal {
  Vec3 position_mm = Vec3::Zero();
  Vec3 velocity_mm_s = Vec3::Zero();
};

class HandGuide;

/// A goal along waypoints, device frame. It rests before the first and after the last.
class HandScript {
 public:
  enum class Between {
    kStraight,     ///< constant speed between waypoints: recorded paths
    kMinimumJerk,  ///< rests at each waypoint, as a reaching hand does (Flash and Hogan 1985): scripted tasks
  };

  /// Times increase and count from the device's opening. An Error names the wrong waypoint.
  [[nodiscard]] static Result<HandScript> create(std::string name, std::vector<double> t_s,
                                                 std::vector<Vec3> goal_mm, Between between);
  /// A probe path as the goal; times count from its first sample.
  [[nodiscard]] static Result<HandScript> along(const trace::ProbePath& path);

  /// Follows the guide. Only one device may use it, whose thread owns at().
  [[nodiscard]] static HandScript guided(std::string name, std::shared_ptr<HandGuide> guide);

  /// O(log waypoints), no allocation.
  [[nodiscard]] Goal at(double t_s) const noexcept;
  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] double duration_s() const noexcept { return t_s_.back(); }
  /// From this time on the goal is constant; infinite with a guide. O(waypoints that rest at the end).
  [[nodiscard]] double rests_from_s() const noexcept;

  double release_s = std::numeric_limits<double>::infinity();  ///< when the hand releases the device

 private:
  HandScript() = default;
  std::string name_;
  std::shared_ptr<HandGuide> guide_;  // null: waypoints
  std::vector<double> t_s_;
  std::vector<Vec3> goal_mm_;
  Between between_ = Between::kStraight;
};

/// A surface place for a task; device frame.
struct TaskPlace {
  Vec3 point_mm = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();  ///< outward
  Vec3 along = Vec3::UnitX();   ///< a tangent; at an edge its direction
};

struct TaskSizes {
  double depth_mm = 2.0;    ///< goal below the surface
  double above_mm = 2.0;    ///< start and end of the goal
  double travel_mm = 10.0;  ///< total, of a slide
};

/// Presses a wall: 0.3 s down, then still until 4.3 s.
[[nodiscard]] HandScript press(const TaskPlace& place, const TaskSizes& sizes);
/// Moves down, along and back, up: 3 s.
[[nodiscard]] HandScript slide(const TaskPlace& place, const TaskSizes& sizes);
/// Five taps at 2.5 Hz.
[[nodiscard]] HandScript tap(const TaskPlace& place, const TaskSizes& sizes);
/// Presses and releases at 1 s.
[[nodiscard]] HandScript release_contact(const TaskPlace& place, const TaskSizes& sizes);

// A hand steered live by a mouse or a program. The goal moves smoothly, since a mouse reports far less often
// than a servo ticks.

class HandGuide {
 public:
  /// Lag of the goal: two reports of a mouse (60 to 125 a second).
  static constexpr double kFollowS = 0.03;
  /// Greatest speed of an exploring hand; device frame.
  static constexpr double kFastestMmS = 250.0;
  /// A longer time between two calls counts as a pause.
  static constexpr double kLongestS = 0.05;

  /// Device frame. `follow_s` may be shorter for sources faster than a mouse.
  explicit HandGuide(const Vec3& start_mm, double follow_s = kFollowS)
      : aim_(start_mm), at_mm_(start_mm), follow_s_(follow_s) {}

  /// Sets the aim, device frame. One thread; wait-free.
  void aim(const Vec3& goal_mm) noexcept { aim_.publish(goal_mm); }

  /// Gives the goal at `t_s`, which may go back only to 0. Simulated device's thread. Wait-free, no
  /// allocation.
  [[nodiscard]] Goal at(double t_s) noexcept {
    (void)aim_.acquire();
    const double dt_s = std::clamp(t_s - last_s_, 0.0, kLongestS);
    last_s_ = t_s;
    if (!is_finite(aim_.front())) return {at_mm_, Vec3::Zero()};
    // Backward Euler of a first-order lag: stable for any step.
    const Vec3 way_mm = aim_.front() - at_mm_;
    Vec3 velocity_mm_s = way_mm / (follow_s_ + dt_s);
    const double speed = velocity_mm_s.norm();
    if (speed > kFastestMmS) velocity_mm_s *= kFastestMmS / speed;
    at_mm_ += dt_s * velocity_mm_s;
    return {at_mm_, velocity_mm_s};
  }

 private:
  TripleBuffer<Vec3> aim_;
  Vec3 at_mm_;
  double follow_s_;
  double last_s_ = 0.0;
};

}  // namespace palpate::device
