// Moving models: poses written at the simulation's rate and read by frames without a lock (section 3.3.1).
//
// First:
//   auto simulation = std::make_shared<palpate::render::ScriptedSimulation>();
//   palpate::render::ScriptedMotion slide;
//   slide.velocity_mm_s = {10.0, 0.0, 0.0};
//   scene.models[0].motion = simulation->add(slide);
//   scene.simulation = simulation;  // and before each frame: simulation->advance(t_s)
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/triple_buffer.h>
#include <palpate/vec.h>

namespace palpate::render {

/// A pose at an instant with its velocity: a turn about a point that itself moves. Frames run more often than
/// the simulation and extrapolate with it, so a moving surface has no steps.
struct PoseState {
  double t_s = 0.0;
  geometry::RigidTransform world_from_model;
  Vec3 velocity_mm_s = Vec3::Zero();           ///< of the pivot, world
  Vec3 angular_velocity_rad_s = Vec3::Zero();  ///< world
  Vec3 about_mm = Vec3::Zero();                ///< the pivot at t_s, world
  /// Start time of this motion, perhaps with a jump; the model stood still before. Set by MovingModel.
  double motion_start_s = -HUGE_VAL;
  geometry::RigidTransform before;

  [[nodiscard]] geometry::RigidTransform at(double now_s) const noexcept {
    if (now_s < motion_start_s) return before;
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

/// Counts changes of motion (start, stop, turn, jump) of the models that share it. A value derived from a
/// pose is valid while the count stays the same.
using MotionVersion = std::atomic<std::uint64_t>;

/// Carries one model's poses from the simulation. One thread writes and one thread runs frames (may be the
/// same).
class MovingModel {
 public:
  /// `motion_version` is shared by models that move together and is never null.
  explicit MovingModel(const PoseState& start,
                       std::shared_ptr<MotionVersion> motion_version = std::make_shared<MotionVersion>(0))
      : frames_(start), last_(start), motion_version_(std::move(motion_version)) {}
  /// Writer. Wait-free. The count rises first, so a reader that sees it after an old pose knows the pose is
  /// old.
  void publish(PoseState state) noexcept {
    const bool goes_on = continues(last_, state);
    state.motion_start_s = goes_on ? last_.motion_start_s : state.t_s;
    state.before = goes_on ? last_.before : last_.at(state.t_s);
    last_ = state;
    if (!goes_on) motion_version_->fetch_add(1, std::memory_order_release);
    frames_.publish(state);
  }
  /// Frame thread. The newest pose. Wait-free.
  [[nodiscard]] const PoseState& newest() noexcept {
    (void)frames_.acquire();
    return frames_.front();
  }
  [[nodiscard]] const std::shared_ptr<MotionVersion>& motion_version() const noexcept {
    return motion_version_;
  }

 private:
  /// True if `now` lies on the course of `before` and continues it.
  [[nodiscard]] static bool continues(const PoseState& before, const PoseState& now) noexcept;

  TripleBuffer<PoseState> frames_;
  PoseState last_;  ///< writer thread only
  std::shared_ptr<MotionVersion> motion_version_;
};

/// Moves the models of a scene. Owned by the simulating thread; in a replay that is the stepping thread.
class Simulation {
 public:
  Simulation() = default;
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;
  virtual ~Simulation() = default;
  /// Returns to time 0.
  virtual void reset() noexcept = 0;
  /// Sets the time to `t_s` and runs the steps that are due. Only reset() moves time back.
  virtual void advance(double t_s) noexcept = 0;
  /// The earliest time at which advance() has work.
  [[nodiscard]] virtual double next_s() const noexcept = 0;
};

/// A motion written in a scene file: at rest, then constant velocity and turn, then at rest. A swing to and
/// fro adds to it.
struct ScriptedMotion {
  geometry::RigidTransform start;              ///< pose before start_s
  Vec3 velocity_mm_s = Vec3::Zero();           ///< world
  Vec3 angular_velocity_rad_s = Vec3::Zero();  ///< world
  Vec3 about_mm = Vec3::Zero();                ///< pivot at the start, world; moves with the velocity
  double start_s = 0.0;
  double stop_s = HUGE_VAL;
  Vec3 swing_mm = Vec3::Zero();  ///< amplitude, world
  double swing_hz = 0.0;

  [[nodiscard]] PoseState at(double t_s) const noexcept;
};

/// Default simulation rate; rigid bodies are commonly stepped about 200 times a second.
inline constexpr double kSimulationHz = 200.0;

/// Publishes scripted motions at its own rate.
class ScriptedSimulation final : public Simulation {
 public:
  /// `rate_hz` > 0.
  explicit ScriptedSimulation(double rate_hz = kSimulationHz) : rate_hz_(rate_hz) {}
  /// Call before the first frame. Put the returned model into ModelInput::motion.
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
  std::shared_ptr<MotionVersion> motion_version_ = std::make_shared<MotionVersion>(0);
  double next_tick_ = 0.0;  ///< ticks done; counting them prevents drift
  std::vector<Part> parts_;
};

// Moves of points from a slower deformer to the frames: the second arrangement of section 2.2.2.3, where the
// deformation is computed beside the haptic loop. The frame applies a batch before it collides, so contact
// points do not move between collision and response. The edits belong to the scene: every renderer on it
// reads all of them.

/// Most moves in a batch: 0.25 to 0.8 ms of work for the frame that applies it, on a million points.
inline constexpr std::size_t kMaxBatch = 512;

/// New positions of cloud points, relative to its origin, mm.
struct MoveBatch {
  std::uint64_t number = 0;
  std::uint32_t count = 0;
  std::array<std::uint32_t, kMaxBatch> point{};
  std::array<Vec3f, kMaxBatch> to_mm{};
};

/// One renderer's reading end. Belongs to the thread of its frames.
class MoveReader {
 public:
  /// The next batch, or null; unchanged until the next call. Wait-free.
  [[nodiscard]] const MoveBatch* take() noexcept {
    if (!buffer_.acquire()) return nullptr;
    taken_.store(buffer_.front().number, std::memory_order_release);
    return &buffer_.front();
  }

 private:
  friend class MoveQueue;
  TripleBuffer<MoveBatch> buffer_;
  std::atomic<std::uint64_t> taken_{0};
};

/// Hands batches from one computing thread to all readers, without locks or loss: a batch is published once
/// every reader has taken the last one. A subscribed reader that never steps blocks the others; a destroyed
/// one does not.
class MoveQueue {
 public:
  /// Adds a reader, during preparation and before the computing thread continues. It receives what is
  /// published from then on.
  [[nodiscard]] std::shared_ptr<MoveReader> subscribe() {
    auto reader = std::make_shared<MoveReader>();
    reader->taken_.store(published_, std::memory_order_relaxed);
    readers_.push_back(reader);
    return reader;
  }
  /// Computing thread: the batch to fill, or null while a reader has not taken the last one.
  [[nodiscard]] MoveBatch* begin() {
    std::erase_if(readers_,
                  [](const std::shared_ptr<MoveReader>& reader) { return reader.use_count() == 1; });
    const auto is_behind = [this](const std::shared_ptr<MoveReader>& reader) {
      return reader->taken_.load(std::memory_order_acquire) != published_;
    };
    if (std::any_of(readers_.begin(), readers_.end(), is_behind)) return nullptr;
    batch_.count = 0;
    return &batch_;
  }
  void publish() noexcept {
    batch_.number = ++published_;
    for (const std::shared_ptr<MoveReader>& reader : readers_) reader->buffer_.publish(batch_);
  }

 private:
  std::vector<std::shared_ptr<MoveReader>> readers_;
  MoveBatch batch_;
  std::uint64_t published_ = 0;
};

}  // namespace palpate::render
