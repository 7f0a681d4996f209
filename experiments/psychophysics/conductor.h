// Takes a hand through a trial, in the servo thread. A trial has intervals.
//
//  idle -> [no force] -> interval 1 -> lift off -> [no force] -> interval 2 -> .. -> done
//
// Between intervals a renderer without force is felt, so switching a renderer to itself takes the same steps
// and time as switching to another. The mixer steps every renderer throughout.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include <palpate/device/servo.h>
#include "device/live/mixer.h"
#include "device/simulated/hand_script.h"
#include "experiments/psychophysics/cues.h"

namespace palpate::experiments::psychophysics {

inline constexpr std::size_t kMostIntervals = 3;
/// The mixer's lane without force.
inline constexpr std::uint8_t kNothingLane = 0;

enum class Passage : std::uint8_t {
  kIdle,      ///< waits for the worker
  kDelay,     ///< no force
  kEntering,  ///< waits until the interval's renderer is fully felt
  kInterval,
  kLeaving,  ///< waits until the hand has lifted off
  kDone,     ///< waits for the worker's take()
  kBroken,   ///< a fault: the trial must start again
  kStuck,    ///< a renderer failed for good
};

/// Recorded data of a trial.
struct FeltTrial {
  std::vector<FeltSample> samples;
  std::uint64_t missed_deadlines = 0, clipped_frames = 0;
  std::uint64_t frames = 0, whole_frames = 0;  ///< `whole_frames` stepped every renderer
  std::uint64_t samples_lost = 0;              ///< beyond the capacity
  device::DeviceMap map;                       ///< maps the samples to the scene
};

/// The lanes of a trial and their durations.
struct Passes {
  std::array<std::uint8_t, kMostIntervals> lanes{};
  std::size_t count = 0;
  double interval_s = 0.0, delay_s = 0.0;
};

/// begin() and take() are for one worker, took() for the servo thread, the rest for any thread. Refers to
/// everything.
class Conductor final : public device::TickObserver {
 public:
  /// `most_samples`: capacity of a trial. `guide` leads a simulated hand along `task`, whose times are within
  /// an interval; both null for a person.
  Conductor(device::Mixer& mixer, const device::Servo& servo, std::shared_ptr<device::HandGuide> guide,
            std::optional<device::HandScript> task, std::size_t most_samples);

  [[nodiscard]] Passage passage() const noexcept { return passage_.load(std::memory_order_acquire); }
  /// From 1; 0 before the first.
  [[nodiscard]] std::uint32_t interval() const noexcept { return interval_.load(std::memory_order_acquire); }
  /// Servo time at which the last passage began.
  [[nodiscard]] double since_s() const noexcept { return since_s_.load(std::memory_order_acquire); }
  /// True once the hand has been off all surfaces at full gain for long enough.
  [[nodiscard]] bool calm() const noexcept { return calm_.load(std::memory_order_acquire); }
  /// Call while idle, done or broken.
  void begin(const Passes& passes) noexcept;
  /// Call when done; becomes idle. Lends the sample buffer: give it back with return_room().
  [[nodiscard]] FeltTrial take() noexcept;
  void return_room(FeltTrial&& trial) noexcept;

  void took(const device::Tick& tick) noexcept override;

 private:
  void advance(const device::Tick& tick, Passage passage) noexcept;
  void note(const device::Tick& tick, Passage passage) noexcept;
  void watch_calm(const device::Tick& tick) noexcept;
  void guide_hand(const device::Tick& tick, Passage passage) noexcept;
  void ask(std::uint8_t lane) noexcept;
  [[nodiscard]] bool felt(std::uint8_t lane) const noexcept;
  [[nodiscard]] std::uint64_t clipped() const noexcept;

  device::Mixer& mixer_;
  const device::Servo& servo_;
  std::shared_ptr<device::HandGuide> guide_;
  std::optional<device::HandScript> task_;
  std::atomic<Passage> passage_{Passage::kIdle};
  std::atomic<std::uint32_t> interval_{0};
  std::atomic<bool> calm_{false};
  // Owned by the worker in its turns, else by the servo.
  Passes passes_;
  FeltTrial trial_;
  bool begun_ = false;  ///< the servo has seen it
  // Owned by the servo.
  std::atomic<double> since_s_{0.0};
  double restless_s_ = 0.0;
  bool seen_ = false;
  std::uint64_t clipped_before_ = 0;
};

}  // namespace palpate::experiments::psychophysics
