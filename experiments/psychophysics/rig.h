// One live session for trials: the renderers of a plan under one hand, behind device, governor and mixer.
#pragma once

#include <memory>
#include <optional>

#include "experiments/live/assembly.h"
#include "experiments/psychophysics/bench.h"
#include "experiments/study/output_folder.h"

namespace palpate::experiments::psychophysics {

/// Refers to bench, clock and device. Made and run by one thread; of its parts each says whose it is.
class Rig {
 public:
  /// Prepares every renderer of the plan, that of `level` included, and puts them under the hand. Errors: of
  /// the scene, the device, a renderer.
  [[nodiscard]] static Result<std::unique_ptr<Rig>> make(Bench& bench, SessionClock& clock,
                                                         SessionDevice& device, double level,
                                                         Progress& progress);
  [[nodiscard]] Result<SessionEnd> run(SessionTasks& tasks, ProgressBar& progress) {
    return assembly_->run(tasks, progress);
  }
  /// The renderer of another level, placed where all is free, to be offered to the mixer. A worker's.
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
  Vec3 free_mm_ = Vec3::Zero();  ///< world
  std::shared_ptr<device::HandGuide> guide_;
  std::optional<device::HandScript> task_;
  std::unique_ptr<render::HapticRenderer> felt_;  ///< the mixer, and what goes around it
  device::Mixer* mixer_ = nullptr;
  std::unique_ptr<Assembly> assembly_;
  std::unique_ptr<Conductor> conductor_;
};

/// One trial on a device of its own, in virtual time: the same trial gives the same samples to the last bit.
/// Errors: of the rig; a fault; a hand that does not get through.
[[nodiscard]] Result<FeltTrial> feel_alone(Bench& bench, const DeviceChoice& choice, const Passes& passes,
                                           double level, ProgressBar& progress);

inline constexpr const char* kTracesFolder = "traces";
/// traces/trial-0007.csv: HIP and the force that was sent, world frame, by interval. Nothing in it says what
/// was felt.
[[nodiscard]] Status write_trace(const OutputFolder& folder, std::uint64_t trial, const FeltTrial& felt);

}  // namespace palpate::experiments::psychophysics
