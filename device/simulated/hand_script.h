// What a simulated hand means to do: a goal that moves, and when it lets go. The goal pulls the hand through
// its own spring and damper; where the hand truly goes is decided by the forces.
#pragma once

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"
#include "toolkit/trace/trace.h"

namespace palpate::device {

/// Where the goal is, and how it moves.
struct Goal {
  Vec3 position_mm = Vec3::Zero();
  Vec3 velocity_mm_s = Vec3::Zero();
};

class HandGuide;  // hand_guide.h

/// A goal along waypoints; device frame. Before the first and after the last one it rests.
class HandScript {
 public:
  enum class Between {
    kStraight,     ///< constant speed from one to the next: recorded paths
    kMinimumJerk,  ///< rests at each, as a reaching hand does (Flash and Hogan 1985): scripted tasks
  };

  /// Times count from the opening of the device and increase. An Error names the waypoint that is wrong.
  [[nodiscard]] static Result<HandScript> create(std::string name, std::vector<double> t_s,
                                                 std::vector<Vec3> goal_mm, Between between);
  /// A probe path as the goal; its times count from its first sample.
  [[nodiscard]] static Result<HandScript> along(const trace::ProbePath& path);

  /// No waypoints: wherever the guide says. Only one device may follow it, and at() then belongs to its
  /// thread.
  [[nodiscard]] static HandScript guided(std::string name, std::shared_ptr<HandGuide> guide);

  /// O(log waypoints), no allocation.
  [[nodiscard]] Goal at(double t_s) const noexcept;
  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] double duration_s() const noexcept { return t_s_.back(); }
  /// From here on the goal stays where it is. Infinite where a guide leads. O(waypoints that rest at the
  /// end).
  [[nodiscard]] double rests_from_s() const noexcept;

  double release_s = std::numeric_limits<double>::infinity();  ///< from here on nobody holds the device

 private:
  HandScript() = default;
  std::string name_;
  std::shared_ptr<HandGuide> guide_;  // null: the waypoints
  std::vector<double> t_s_;
  std::vector<Vec3> goal_mm_;
  Between between_ = Between::kStraight;
};

/// A place on a surface where a task is done; device frame.
struct TaskPlace {
  Vec3 point_mm = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();  ///< outward
  Vec3 along = Vec3::UnitX();   ///< a tangent: of an edge its direction
};

struct TaskSizes {
  double depth_mm = 2.0;    ///< of the goal below the surface
  double above_mm = 2.0;    ///< where the goal begins and ends
  double travel_mm = 10.0;  ///< of a slide, all told
};

/// Touches a wall and rests on it: 0.3 s down, then still until 4.3 s.
[[nodiscard]] HandScript press(const TaskPlace& place, const TaskSizes& sizes);
/// Goes down, along and back, and up: 3 s.
[[nodiscard]] HandScript slide(const TaskPlace& place, const TaskSizes& sizes);
/// Five taps at 2.5 Hz.
[[nodiscard]] HandScript tap(const TaskPlace& place, const TaskSizes& sizes);
/// Presses and lets go at 1 s.
[[nodiscard]] HandScript let_go(const TaskPlace& place, const TaskSizes& sizes);

}  // namespace palpate::device
