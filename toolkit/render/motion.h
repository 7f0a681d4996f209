// Models that move: poses written at the simulation's rate and read by frames without a lock (section 3.3.1).
#pragma once

#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "toolkit/core/handover.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/rigid_transform.h"

namespace palpate::render {

/// A pose at an instant and how it goes on: a turn about a point that itself moves. Frames run more often
/// than the simulation; between two of its poses they follow this, so that a moving surface does not come in
/// steps.
struct PoseState {
  double t_s = 0.0;
  geometry::RigidTransform world_from_model;
  Vec3 velocity_mm_s = Vec3::Zero();           ///< of the point, world
  Vec3 angular_velocity_rad_s = Vec3::Zero();  ///< world
  Vec3 about_mm = Vec3::Zero();                ///< the point, at t_s, world
  /// This course began then, perhaps with a jump: before, the model stood there. Kept by MovingModel.
  double begun_s = -HUGE_VAL;
  geometry::RigidTransform before;

  [[nodiscard]] geometry::RigidTransform at(double now_s) const noexcept {
    if (now_s < begun_s) return before;
    const double dt = now_s - t_s;
    if (dt == 0.0) return world_from_model;
    const Vec3 turn = angular_velocity_rad_s * dt;
    const double angle = turn.norm();
    Eigen::Quaterniond turned = Eigen::Quaterniond::Identity();
    if (angle > 0.0) {
      turned.w() = std::cos(0.5 * angle);
      turned.vec() = turn * (std::sin(0.5 * angle) / angle);
    }
    geometry::RigidTransform pose;
    pose.rotation = (turned * world_from_model.rotation).normalized();
    pose.translation_mm =
        about_mm + velocity_mm_s * dt + turned * (world_from_model.translation_mm - about_mm);
    return pose;
  }
};

/// Counts the times that any of the models sharing it took another course: began, stopped, turned, jumped.
/// What was worked out from a pose holds only as long as its count.
using CourseCount = std::atomic<std::uint64_t>;

/// Where the simulation puts the poses of one model. One thread writes; one thread runs frames
/// (they may be the same).
class MovingModel {
 public:
  /// `courses`: shared by models that move together, never null.
  explicit MovingModel(const PoseState& start,
                       std::shared_ptr<CourseCount> courses = std::make_shared<CourseCount>(0))
      : frames_(start), last_(start), courses_(std::move(courses)) {}
  /// Writer. Wait-free. The count rises first: who reads it after an old pose sees that it is old.
  void publish(PoseState state) noexcept {
    const bool goes_on = continues(last_, state);
    state.begun_s = goes_on ? last_.begun_s : state.t_s;
    state.before = goes_on ? last_.before : last_.at(state.t_s);
    last_ = state;
    if (!goes_on) courses_->fetch_add(1, std::memory_order_release);
    frames_.publish(state);
  }
  /// The frame thread: the newest pose. Wait-free.
  [[nodiscard]] const PoseState& newest() noexcept {
    (void)frames_.acquire();
    return frames_.front();
  }
  [[nodiscard]] const std::shared_ptr<CourseCount>& courses() const noexcept { return courses_; }

 private:
  /// Whether a pose is where the one before was going, and goes on as it did.
  [[nodiscard]] static bool continues(const PoseState& before, const PoseState& now) noexcept;

  Handover<PoseState> frames_;
  PoseState last_;  ///< the writer's
  std::shared_ptr<CourseCount> courses_;
};

/// What moves the models of a scene. Owned by the thread that simulates; in a replay that is the one that
/// steps.
class Simulation {
 public:
  Simulation() = default;
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;
  virtual ~Simulation() = default;
  /// Back to time 0.
  virtual void reset() noexcept = 0;
  /// Time is now `t_s`: does the steps that are due, none where none is. Time never runs back but by reset().
  virtual void advance(double t_s) noexcept = 0;
  /// Up to this time advance() has nothing to do.
  [[nodiscard]] virtual double next_s() const noexcept = 0;
};

/// A motion that a scene file writes down: at rest, then a constant velocity and turn, then at rest.
struct ScriptedMotion {
  geometry::RigidTransform start;              ///< pose before start_s
  Vec3 velocity_mm_s = Vec3::Zero();           ///< world
  Vec3 angular_velocity_rad_s = Vec3::Zero();  ///< world
  Vec3 about_mm = Vec3::Zero();                ///< turning point at the start, world; moves with the velocity
  double start_s = 0.0;
  double stop_s = HUGE_VAL;

  [[nodiscard]] PoseState at(double t_s) const noexcept;
};

/// Rate of a simulation that says nothing else: rigid bodies are commonly stepped some 200 times a second.
inline constexpr double kSimulationHz = 200.0;

/// Publishes scripted motions at its own rate.
class ScriptedSimulation final : public Simulation {
 public:
  /// `rate_hz` > 0.
  explicit ScriptedSimulation(double rate_hz = kSimulationHz) : rate_hz_(rate_hz) {}
  /// Before the first frame. The returned model belongs into ModelInput::motion.
  [[nodiscard]] std::shared_ptr<MovingModel> add(const ScriptedMotion& motion);
  void reset() noexcept override;
  void advance(double t_s) noexcept override;
  [[nodiscard]] double next_s() const noexcept override { return next_tick_ / rate_hz_; }

 private:
  void publish(double t_s) noexcept;

  struct Part {
    ScriptedMotion motion;
    std::shared_ptr<MovingModel> model;
  };
  double rate_hz_;
  std::shared_ptr<CourseCount> courses_ = std::make_shared<CourseCount>(0);
  double next_tick_ = 0.0;  ///< ticks done: their number, so that time does not drift
  std::vector<Part> parts_;
};

}  // namespace palpate::render
