// Builds a plan's scenes, its renderers by letter and level, and the simulated hand's tasks.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>

#include "experiments/live/changes.h"
#include "experiments/live/session_device.h"
#include "experiments/psychophysics/conductor.h"
#include "experiments/psychophysics/plan.h"
#include "experiments/psychophysics/trials.h"
#include "experiments/session/study_run.h"

namespace palpate::experiments::psychophysics {

/// Lanes of the mixer; lane 0 renders no force.
inline constexpr std::uint8_t kLaneOfA = 1, kLaneOfB = 2, kLaneOfCatch = 3;

struct BenchOptions {
  std::string hand = "press";  ///< press, slide or explore; for simulated devices
  double depth_mm = 4.0;       ///< depth of the hand's goal below the surface; device frame
  double rate_hz = 1000.0;
};
/// "press", "slide", "explore".
[[nodiscard]] const std::vector<std::string>& bench_hands();

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

}  // namespace palpate::experiments::psychophysics
