// Builds a plan's scenes, renderers and tasks. Renderers go by letter and level; tasks are the simulated
// hand's.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <palpate/renderer.h>
#include "experiments/driver/study_run.h"
#include "experiments/live/changes.h"
#include "experiments/live/session_device.h"
#include "experiments/psychophysics/conductor.h"
#include "experiments/psychophysics/plan.h"
#include "experiments/psychophysics/trials.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments::psychophysics {

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
