// One live session for trials: a plan's renderers under one hand, behind device, governor and mixer.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "experiments/live/assembly.h"
#include "experiments/psychophysics/bench.h"
#include "experiments/psychophysics/observers.h"
#include "experiments/psychophysics/trials.h"
#include "experiments/study/study.h"

namespace palpate::experiments::psychophysics {

/// Refers to bench, clock and device. One thread creates and runs it; its parts state their own threads.
class Rig {
 public:
  /// Prepares every renderer of the plan, with that of `level`, and puts them under the hand. Errors: the
  /// scene's, the device's, a renderer's.
  [[nodiscard]] static Result<std::unique_ptr<Rig>> make(Bench& bench, SessionClock& clock,
                                                         SessionDevice& device, double level,
                                                         Progress& progress);
  [[nodiscard]] Result<SessionEnd> run(SessionTasks& tasks, ProgressBar& progress) {
    return assembly_->run(tasks, progress);
  }
  /// The renderer of another level, placed in free space, to be offered to the mixer. For a worker.
  [[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> renderer_of(double level, Progress& progress);

  [[nodiscard]] Conductor& conductor() noexcept { return *conductor_; }
  [[nodiscard]] device::Mixer& mixer() noexcept { return *mixer_; }
  [[nodiscard]] Assembly& assembly() noexcept { return *assembly_; }
  [[nodiscard]] const device::DeviceMap& map() const noexcept { return map_; }

 private:
  Rig(Bench& bench, SessionClock& clock) : bench_(bench), clock_(clock) {}
  [[nodiscard]] Status seat(SessionDevice& device, Progress& progress);
  [[nodiscard]] Status mix(double level, Progress& progress);

  Bench& bench_;
  SessionClock& clock_;
  device::DeviceMap map_;
  device::DeviceLimits limits_;
  double force_limit_n_ = 0.0;
  Vec3 free_mm_ = Vec3::Zero();  ///< world frame
  std::shared_ptr<device::HandGuide> guide_;
  std::optional<device::HandScript> task_;
  std::unique_ptr<render::HapticRenderer> felt_;  ///< the mixer and its wrappers
  device::Mixer* mixer_ = nullptr;
  std::unique_ptr<Assembly> assembly_;
  std::unique_ptr<Conductor> conductor_;
};

/// Runs one trial on its own device in virtual time: repetitions are bit-identical. Errors: the rig's; a
/// fault; a hand that does not finish.
[[nodiscard]] Result<FeltTrial> feel_alone(Bench& bench, const DeviceChoice& choice, const Passes& passes,
                                           double level, ProgressBar& progress);

inline constexpr const char* kTracesFolder = "traces";
/// Writes traces/trial-0007.csv: HIP and sent force, world frame, by interval. The file stays blind to the
/// renderers.
[[nodiscard]] Status write_trace(const OutputFolder& folder, std::uint64_t trial, const FeltTrial& felt);

// The machine observer, which predicts answers. It takes a simulated hand's forces and published thresholds.
// Predictions can be registered before people are asked.
//
// It first feels the pair of catch and practice trials once, as people do in practice, to learn each cue's
// direction. In a trial the cue that separates the intervals most decides, on its scale of just noticeable
// differences (cues.h): one is a d' of 0.954, so 75 of 100 two-interval choices are right there. Its internal
// noise, criterion and lapses are those of a simulated observer.

/// Refers to everything. One thread.
class Machine {
 public:
  Machine(const Plan& plan, const ObserverSpec& spec, Bench& bench, const DeviceChoice& device)
      : plan_(plan), spec_(spec), bench_(bench), device_(device) {}

  /// Feels the easiest pair. Call before the first answer.
  [[nodiscard]] Status learn(ProgressBar& progress);
  /// Each interval's strength in sensation deviations, from the pair's A towards B; without noise.
  [[nodiscard]] Result<std::vector<double>> feel(const Trial& trial, FeltTrial& felt, ProgressBar& progress);
  /// Answers a trial and leaves its samples in `felt`. Depends on plan, device and trial only, not on earlier
  /// trials.
  [[nodiscard]] Result<Answer> answer(const Trial& trial, FeltTrial& felt, ProgressBar& progress);

  /// Each cue's difference over the pair, in just noticeable differences.
  [[nodiscard]] const CueScales& apart() const noexcept { return apart_; }

 private:
  [[nodiscard]] std::vector<CueScales> scales(const FeltTrial& felt) const;
  [[nodiscard]] std::vector<double> strengths(const std::vector<CueScales>& intervals) const;

  const Plan& plan_;
  const ObserverSpec& spec_;
  Bench& bench_;
  const DeviceChoice& device_;
  Vec3 way_a_ = Vec3::Zero(), way_b_ = Vec3::Zero();  ///< directions of the pair's forces
  CueScales of_a_{}, apart_{};
};

/// Samples of one interval, in order.
[[nodiscard]] std::span<const FeltSample> samples_of(const FeltTrial& felt, std::uint32_t interval) noexcept;

// Runs trials with a person who answers by keys. The person holds a device or watches a simulated hand. Time
// markers tell external recorders when something happened, never which renderer was felt.

/// One worker at a time.
class Markers {
 public:
  Markers() = default;
  Markers(const Markers&) = delete;
  Markers& operator=(const Markers&) = delete;
  virtual ~Markers() = default;
  /// Marks an event `seconds_ago`. Does nothing here.
  virtual void push(const std::string& /*text*/, double /*seconds_ago*/) {}
};

/// Sends markers as a Lab Streaming Layer stream of type "Markers", named "Palpate", with source `source`.
/// Loads liblsl at this call: `library` is a file or a name that the system can resolve. Errors: library or
/// function missing; no outlet available.
[[nodiscard]] Result<std::unique_ptr<Markers>> lsl_markers(const std::string& library,
                                                           const std::string& source);
inline constexpr const char* kLslLibrary = "liblsl.so.2";

/// The end of a person's session.
struct PersonSession {
  bool complete = false;
  bool sat = false;      ///< the loop ran; else nothing was left to ask
  SessionRecord record;  ///< of the loop, if it ran
};

/// The question after the intervals, with its keys.
[[nodiscard]] std::string question_of(const Plan& plan);
/// 0 or 1; -1: no answer of this task.
[[nodiscard]] int choice_of(Task task, char key) noexcept;

/// Asks until the study or session ends or somebody presses q; no data is lost. Errors: the rig's; a renderer
/// failed for good; a row or trace cannot be written.
[[nodiscard]] Result<PersonSession> ask_person(const Plan& plan, Bench& bench, SessionClock& clock,
                                               SessionDevice& device, Ledger& ledger,
                                               const OutputFolder& folder, Markers& markers,
                                               ProgressBar& progress);

}  // namespace palpate::experiments::psychophysics
