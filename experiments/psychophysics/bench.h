// Builds a plan's scenes, renderers and tasks. Renderers go by letter and level; tasks are the simulated
// hand's.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <palpate/device/servo.h>
#include <palpate/renderer.h>
#include "device/live/mixer.h"
#include "device/simulated/hand_script.h"
#include "experiments/driver/study_run.h"
#include "experiments/live/changes.h"
#include "experiments/live/session_device.h"
#include "experiments/psychophysics/cues.h"
#include "experiments/psychophysics/trials.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments::psychophysics {

// Takes a hand through a trial, in the servo thread. A trial has intervals.
//
//  idle -> [no force] -> interval 1 -> lift off -> [no force] -> interval 2 -> .. -> done
//
// Between intervals a renderer without force is felt, so switching a renderer to itself takes the same steps
// and time as switching to another. The mixer steps every renderer throughout.

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

/// Lanes of the mixer; lane 0 renders no force.
inline constexpr std::uint8_t kLaneOfA = 1, kLaneOfB = 2, kLaneOfCatch = 3;

struct BenchOptions {
  std::string hand = "press";  ///< press, slide or explore; for simulated devices
  double depth_mm = 4.0;       ///< depth of the hand's goal below the surface; device frame
  double rate_hz = 1000.0;
  bool paced = false;  ///< a device's own time: frames must not wait
};

/// Owns stages and model stores; one thread. Its functions do all slow work, so no frame has to.
class Bench {
 public:
  /// Loads the plan's scene and checks every value that the plan may request. Refers to the plan. Errors
  /// concern the plan's scene or name the value.
  [[nodiscard]] static Result<std::unique_ptr<Bench>> make(const Plan& plan, const BenchOptions& options,
                                                           Progress& progress);

  /// The lane's renderer for a trial of this level, prepared, not placed. O(points) where the level changes
  /// the scene itself.
  [[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> renderer(std::uint8_t lane, double level,
                                                                         Progress& progress);
  /// Lanes besides the one without force: 2, or 3 for comparisons with catch trials.
  [[nodiscard]] std::uint8_t lanes() const noexcept;
  /// The lanes of a trial in order.
  [[nodiscard]] Passes passes(const Trial& trial) const noexcept;
  /// Capacity for a trial's samples.
  [[nodiscard]] std::size_t most_samples() const noexcept;

  [[nodiscard]] const Stage& stage() const noexcept { return *standard_->stage; }
  [[nodiscard]] const render::Registry& registry() const noexcept { return registry_; }
  [[nodiscard]] const BenchOptions& options() const noexcept { return options_; }
  /// Notes and warnings of the scene, whole sentences.
  [[nodiscard]] const std::vector<std::string>& warnings() const noexcept { return stage().warnings; }

  /// The simulated hand's motion within an interval; device frame. Error: it touches nothing.
  [[nodiscard]] Result<device::HandScript> task(const device::DeviceMap& map, Progress& progress);

 private:
  /// A scene and what its renderers share.
  struct Bay {
    std::unique_ptr<Stage> stage;
    std::unique_ptr<Workshop> workshop;
  };
  Bench(const Plan& plan, const BenchOptions& options);
  [[nodiscard]] Result<std::unique_ptr<Bay>> make_bay(std::optional<double> value, Progress& progress) const;
  /// The bay for this value if the option changes the scene itself; else the plan's.
  [[nodiscard]] Result<Bay*> bay_of(double value, Progress& progress);
  [[nodiscard]] Result<LiveSetting> setting(std::uint8_t lane, double value) const;
  [[nodiscard]] Status check_values() const;

  const Plan& plan_;
  BenchOptions options_;
  render::Registry registry_;
  std::unique_ptr<Bay> standard_;                ///< the plan's scene
  std::map<double, std::unique_ptr<Bay>> bays_;  ///< by value of spacing or noise
};

// Wrappers and stand-ins for the renderers of a study.

/// Free space everywhere, felt between two intervals. It makes switching a renderer to itself take the same
/// steps and time as switching to another. A frame does nothing.
class Nothing final : public render::SceneFreeRenderer {
 public:
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    return frame;
  }
  [[nodiscard]] render::Description describe() const override {
    render::Description description;
    description.name = "nothing";
    description.summary = "free space";
    description.work_bound = "nothing";
    return description;
  }
};

/// Updates the renderer at a lower rate than the servo and holds its answer in between. A frame costs the
/// renderer's time or nothing.
class HeldRate final : public render::WrappedRenderer {
 public:
  HeldRate(std::unique_ptr<render::HapticRenderer> inner, double rate_hz) noexcept
      : WrappedRenderer(std::move(inner)), period_s_(1.0 / rate_hz) {}
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    due_s_ = t_s;
    inner().restart(hip_mm, t_s);
  }
  void release_contact(const Vec3& hip_mm) noexcept override {
    due_s_ = 0.0;
    inner().release_contact(hip_mm);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;

 private:
  double period_s_;
  double due_s_ = 0.0;
  render::Frame held_;
};

}  // namespace palpate::experiments::psychophysics
