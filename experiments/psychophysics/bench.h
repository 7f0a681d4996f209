// What the things of a plan are made of: scenes, renderers by letter and level, and what a simulated hand
// does at them.
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

/// The lanes of the mixer: 0 answers nothing.
inline constexpr std::uint8_t kLaneOfA = 1, kLaneOfB = 2, kLaneOfCatch = 3;

struct BenchOptions {
  std::string hand = "press";  ///< press, slide or explore; of simulated devices
  double depth_mm = 4.0;       ///< of the hand's goal below the surface; device frame
  double rate_hz = 1000.0;
};
/// "press", "slide", "explore".
[[nodiscard]] const std::vector<std::string>& bench_hands();

/// Owns stages and model stores; one thread. Everything that may take long is done by its functions, never in
/// a frame.
class Bench {
 public:
  /// Loads the plan's scene, and checks that every value that the plan can ask for can be made. Refers to the
  /// plan. Errors are of the plan's scene, or name the value.
  [[nodiscard]] static Result<std::unique_ptr<Bench>> make(const Plan& plan, const BenchOptions& options,
                                                           Progress& progress);

  /// The renderer of a lane for a trial of this level, prepared, not placed. O(points) where the scene itself
  /// differs by level.
  [[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> renderer(std::uint8_t lane, double level,
                                                                         Progress& progress);
  /// Lanes besides that which answers nothing: 2, of plans that compare and have catch trials 3.
  [[nodiscard]] std::uint8_t lanes() const noexcept;
  /// Which lanes are felt in a trial, in order.
  [[nodiscard]] Passes passes(const Trial& trial) const noexcept;
  /// Room for the samples of a trial.
  [[nodiscard]] std::size_t most_samples() const noexcept;

  [[nodiscard]] const Stage& stage() const noexcept { return *standard_->stage; }
  [[nodiscard]] const render::Registry& registry() const noexcept { return registry_; }
  [[nodiscard]] const BenchOptions& options() const noexcept { return options_; }
  /// Notes and warnings of the scene, whole sentences.
  [[nodiscard]] const std::vector<std::string>& warnings() const noexcept { return stage().warnings; }

  /// What a simulated hand does within an interval; device frame. Errors: it touches nothing.
  [[nodiscard]] Result<device::HandScript> task(const device::DeviceMap& map, Progress& progress);

 private:
  /// A scene with what is shared by renderers on it.
  struct Bay {
    std::unique_ptr<Stage> stage;
    std::unique_ptr<Workshop> workshop;
  };
  Bench(const Plan& plan, const BenchOptions& options);
  [[nodiscard]] Result<std::unique_ptr<Bay>> make_bay(std::optional<double> value, Progress& progress) const;
  /// The bay of this value of an option that changes the scene itself; else that of the plan's scene.
  [[nodiscard]] Result<Bay*> bay_of(double value, Progress& progress);
  [[nodiscard]] Result<LiveSetting> setting(std::uint8_t lane, double value) const;
  [[nodiscard]] Status check_values() const;

  const Plan& plan_;
  BenchOptions options_;
  render::Registry registry_;
  std::unique_ptr<Bay> standard_;                ///< the scene as the plan has it
  std::map<double, std::unique_ptr<Bay>> bays_;  ///< by value, of spacing and noise
};

}  // namespace palpate::experiments::psychophysics
