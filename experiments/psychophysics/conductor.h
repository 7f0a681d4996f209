// Takes one hand through the intervals of a trial, in the servo thread.
//
//   idle -> [nothing is felt, so long] -> interval 1 -> lift off -> [nothing, so long] -> interval 2 -> .. ->
//   done
//
// Between two intervals a renderer is felt that answers nothing, so a switch from a thing to itself goes the
// same two ways, and takes the same time, as one to another thing. The mixer steps every renderer all along.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "device/live/mixer.h"
#include "device/servo/tick_observer.h"
#include "device/simulated/hand_guide.h"
#include "experiments/psychophysics/cues.h"

namespace palpate::experiments::psychophysics {

inline constexpr std::size_t kMostIntervals = 3;
/// The mixer's lane that answers nothing.
inline constexpr std::uint8_t kNothingLane = 0;

enum class Passage : std::uint8_t {
  kIdle,      ///< the worker's turn
  kDelay,     ///< nothing is felt
  kEntering,  ///< waits until the interval's renderer has taken over
  kInterval,
  kLeaving,  ///< waits until the hand has lifted off
  kDone,     ///< the worker's turn: take()
  kBroken,   ///< a fault: the trial is to be begun anew
  kStuck,    ///< a renderer cannot be felt any more
};

/// What a trial left.
struct FeltTrial {
  std::vector<FeltSample> samples;
  std::uint64_t missed_deadlines = 0, clipped_frames = 0;
  std::uint64_t frames = 0, whole_frames = 0;  ///< of the latter every renderer was stepped
  std::uint64_t samples_lost = 0;              ///< longer than there was room for
  double ended_s = 0.0;                        ///< of the servo's time
  device::DeviceMap map;                       ///< of the samples to the scene
};

/// Which lanes, for how long.
struct Passes {
  std::array<std::uint8_t, kMostIntervals> lanes{};
  std::size_t count = 0;
  double interval_s = 0.0, delay_s = 0.0;
};

/// begin() and take() are one worker's, took() the servo thread's, the rest anybody's. Refers to everything.
class Conductor final : public device::TickObserver {
 public:
  /// `most_samples`: room for a trial. A simulated hand is guided along `task`, times within an interval;
  /// both null: a person's.
  Conductor(device::Mixer& mixer, const device::Servo& servo, std::shared_ptr<device::HandGuide> guide,
            std::optional<device::HandScript> task, std::size_t most_samples);

  [[nodiscard]] Passage passage() const noexcept { return passage_.load(std::memory_order_acquire); }
  /// From 1; 0 before the first.
  [[nodiscard]] std::uint32_t interval() const noexcept { return interval_.load(std::memory_order_acquire); }
  /// When the last passage began, the servo's time.
  [[nodiscard]] double since_s() const noexcept { return since_s_.load(std::memory_order_acquire); }
  /// The hand has been off all surfaces, at full gain, for long enough.
  [[nodiscard]] bool calm() const noexcept { return calm_.load(std::memory_order_acquire); }
  /// While idle, done or broken.
  void begin(const Passes& passes) noexcept;
  /// Once done; idle then. The room for samples is lent: give it back with return_room().
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
  // The worker's while it is its turn, else the servo's.
  Passes passes_;
  FeltTrial trial_;
  bool begun_ = false;  ///< the servo has seen it
  // The servo's.
  std::atomic<double> since_s_{0.0};
  double restless_s_ = 0.0;
  bool seen_ = false;
  std::uint64_t clipped_before_ = 0;
};

}  // namespace palpate::experiments::psychophysics
