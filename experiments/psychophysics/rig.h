// One live session for trials: a plan's renderers under one hand, behind device, governor and mixer.
#pragma once

#include <memory>
#include <optional>

#include "experiments/live/assembly.h"
#include "experiments/psychophysics/bench.h"
#include "experiments/study/output_folder.h"

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

}  // namespace palpate::experiments::psychophysics
