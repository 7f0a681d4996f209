// What a window gets to see of a running servo: the newest tick as a whole, and a few numbers of every tick.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "device/live/mixer.h"
#include "device/servo/servo.h"
#include "device/servo/tick_observer.h"
#include "toolkit/core/handover.h"
#include "toolkit/deformation/editable.h"
#include "toolkit/render/motion.h"

namespace palpate::experiments {

/// Models whose motion is shown; further ones are drawn where they began.
inline constexpr std::size_t kMostShownMotions = 16;

/// A tick and all that belongs to it.
struct WatchedTick {
  std::uint64_t ticks = 0;  ///< since the session began, this one included; 0: none yet
  device::Tick tick;
  device::MixedFrame mixed;
  device::DeviceMap map;
  /// Of the models that move, in the order in which the feed was given them.
  std::array<geometry::RigidTransform, kMostShownMotions> world_from_model;
};

/// Points of a model that gives way: the window asks where they are now, the servo answers with its next
/// tick.
struct PointQuestion {
  /// Some 10 us of a tick, and of one tick a picture: reading a point is a look-up.
  static constexpr std::size_t kMost = 256;
  std::uint32_t model = 0, count = 0;
  std::array<std::uint32_t, kMost> point{};  ///< of the model's cloud
};
struct PointAnswer {
  PointQuestion of;
  /// Relative to the cloud's origin.
  std::array<Vec3f, PointQuestion::kMost> place_mm{};
  bool known = false;  ///< false: the felt renderer has no points that give way
};

/// What plots show of a tick.
struct TickSample {
  double t_s = 0.0;
  float sent_n = 0.0f;   ///< magnitude
  float step_us = 0.0f;  ///< all renderers together
  float late_us = 0.0f;  ///< from due to begun
  bool contact = false;
  bool fault = false;
};

/// Samples from one thread to another, in order: a ring of fixed size without a lock. What does not fit,
/// because the reader stood still, is lost and counted.
class SampleRing {
 public:
  /// 16 s at 1 kHz.
  static constexpr std::size_t kSize = std::size_t{1} << 14;

  /// The writer. Wait-free, no allocation.
  void push(const TickSample& sample) noexcept;
  /// The reader: appends everything that is there. How many.
  std::size_t drain(std::vector<TickSample>& into);
  /// Any thread.
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_.load(std::memory_order_relaxed); }

 private:
  std::array<TickSample, kSize> ring_{};
  std::atomic<std::uint64_t> written_{0}, read_{0}, lost_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

/// An observer of ticks that hands over to one reader. The servo's side copies some 3 KB a tick, looks up at
/// most PointQuestion::kMost points, and never waits, whatever the reader does. Keeps references to servo and
/// mixer: took() is called while they live.
class WindowFeed final : public device::TickObserver {
 public:
  /// `moving`: at most kMostShownMotions of them are followed; read in the servo's thread alone.
  WindowFeed(const device::Servo& servo, const device::Mixer& mixer,
             std::vector<std::shared_ptr<render::MovingModel>> moving);
  void took(const device::Tick& tick) noexcept override;

  /// The reader's thread. True where there is a newer tick than the last one taken.
  bool acquire() noexcept { return newest_.acquire(); }
  [[nodiscard]] const WatchedTick& newest() const noexcept { return newest_.front(); }
  [[nodiscard]] SampleRing& samples() noexcept { return samples_; }
  /// The reader's thread: the newest question counts.
  void ask(const PointQuestion& question) { questions_.publish(question); }
  /// The reader's thread: an answer that was not there before, or null.
  [[nodiscard]] const PointAnswer* answer() noexcept {
    return answers_.acquire() ? &answers_.front() : nullptr;
  }
  /// The magnitude of the force that went out last, N; for any thread.
  [[nodiscard]] const std::atomic<float>& force_n() const noexcept { return force_n_; }
  /// Ticks that were taken, for anybody: it goes on whatever the reader does.
  [[nodiscard]] std::uint64_t ticks() const noexcept { return ticks_.load(std::memory_order_acquire); }

 private:
  const device::Servo& servo_;
  const device::Mixer& mixer_;
  std::vector<std::shared_ptr<render::MovingModel>> moving_;
  void answer_question() noexcept;

  Handover<WatchedTick> newest_;
  Handover<PointQuestion> questions_;
  Handover<PointAnswer> answers_;
  const render::HapticRenderer* asked_ = nullptr;  // the felt one, as last seen
  const render::Editable* editable_ = nullptr;     // the same, where its points give way
  SampleRing samples_;
  std::atomic<std::uint64_t> ticks_{0};
  std::atomic<float> force_n_{0.0f};
};

}  // namespace palpate::experiments
