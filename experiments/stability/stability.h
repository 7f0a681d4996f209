// `palpate test stability`: renderers under a simulated hand and device. Measures stable stiffness, hand
// motion and rendered force.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/control.h>
#include "device/simulated/closed_loop.h"
#include "device/simulated/simulated_arm.h"
#include "experiments/driver/json_document.h"
#include "experiments/driver/study_run.h"
#include "experiments/report/figures.h"
#include "experiments/report/page.h"
#include "experiments/run/stage.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {

// Test bench: a renderer on the simulated device.

/// Scales the renderer's force by a gain, so one preparation serves every stiffness. Refers to it.
class GainRenderer final : public render::WrappedRenderer {
 public:
  GainRenderer(render::HapticRenderer& inner, double gain) : WrappedRenderer(inner), gain_(gain) {}
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    render::Frame frame = inner().step(hip_mm, t_s);
    frame.force_n *= gain_;
    return frame;
  }

 private:
  double gain_;
};

/// The truth as a renderer: a spring to the closest point of the true surface. Refers to it. Caches the last
/// answer, since encoders hold a HIP in place for many ticks.
class TruthRenderer final : public render::SceneFreeRenderer {
 public:
  TruthRenderer(const metrics::TruthSurface& truth, double stiffness_n_per_mm)
      : truth_(truth), stiffness_n_per_mm_(stiffness_n_per_mm) {}
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;
  [[nodiscard]] render::Description describe() const override {
    return {"truth", "the true surface", "", "that of a closest point", {}};
  }

 private:
  [[nodiscard]] render::Frame answer(const Vec3& hip_mm) const noexcept;
  const metrics::TruthSurface& truth_;
  double stiffness_n_per_mm_;
  Vec3 last_hip_mm_ = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());  // NaN equals no position
  render::Frame last_;
};

inline constexpr double kMillisecondsPerS = 1e3;

/// A run's device and hand.
struct Bench {
  std::optional<device::ArmOptions> arm;  ///< or the admittance device
  device::Hand hand;
  double rate_hz = 1000.0, delay_s = 0.0, jitter_s = 0.0;
  double slew_n_per_s = 1000.0;
  [[nodiscard]] double period_s() const { return 1.0 / rate_hz; }
};

/// Device "omni", .., "admittance", and a hand by name. Errors list the names.
[[nodiscard]] Result<Bench> bench_of(const std::string& device, const std::string& hand);

/// A run's duration, and the time at rest after which it ends early; 0: never.
struct RunLength {
  double duration_s = 0.0, still_s = 0.0;
};

/// Runs the script, whose coordinates are relative to `origin_mm`, world frame.
[[nodiscard]] Result<device::LoopRun> run_on(const Bench& bench, const device::HandScript& script,
                                             render::HapticRenderer& renderer, const Vec3& origin_mm,
                                             const RunLength& length);

/// Places for tasks; world frame.
struct Places {
  device::TaskPlace flat;  ///< at the truth's contact
  bool has_edge = false;   ///< the normal turns within a few mm somewhere
  device::TaskPlace edge;  ///< where it turns most
  device::TaskSizes sizes;
};
/// Errors: no truth, or a path without contact.
[[nodiscard]] Result<Places> places_on(const Stage& stage);

inline constexpr const char* kStabilityFile = "stability.json";
/// Increases when a key is redefined or removed.
inline constexpr const char* kStabilitySchema = "palpate-stability/1";

/// Default path length: six seconds of the hand's goal.
inline constexpr int kStabilityFrames = 6'000;

struct StabilityArguments {
  RunArguments run;  ///< scene, renderers, path, truth, folder, model, surface, json
  std::string device = "omni", hand = "hand";
  std::string rates = "500,1000,2000,4000,8000";                ///< Hz
  std::string delays = "0,1,2,4";                               ///< ms
  std::string dampings = "0,0.0001,0.0002,0.0005,0.001,0.002";  ///< the wall's, N s/mm
  bool cross = false;  ///< every rate with every delay, for each control
  double jitter_ms = 0.0;
  double slew_n_per_s = 1000.0;
};

/// A search for the largest stable stiffness.
struct StabilityPoint {
  std::string renderer;  ///< label
  std::string hand;      ///< "released": a steady push only
  std::string varied;    ///< "rate", "delay", "damping", "control", "cross"; the base is under "rate"
  std::string control = "none";
  double rate_hz = 1000.0, delay_ms = 0.0, damping_n_s_per_mm = 0.0;
  double largest_stable_n_per_mm = 0.0;    ///< 0: none tried was stable
  bool unlimited = false;                  ///< the stiffest tried is stable
  std::optional<double> theory_n_per_mm;   ///< exact limit of the linear loop on a plane
  std::optional<double> passive_n_per_mm;  ///< bound for any hand, without delay
  // Just above the limit:
  bool lost = false;  ///< the device falls through or is pushed off
  double limit_cycle_mm = 0.0, limit_cycle_hz = 0.0;
  double generated_mj = 0.0;  ///< largest energy from the environment
};

/// A task of the hand with a renderer, compared with the truth in its place.
struct TaskResult {
  std::string renderer, task;
  bool stable = true;                                 ///< no fault, no final swing
  double contour_rms_mm = 0.0, contour_max_mm = 0.0;  ///< distance from the path with the truth
  double generated_mj = 0.0;
  /// As metrics::ForceSteps has them; the last with the truth in the renderer's place.
  double largest_step_n = 0.0, largest_excess_n = 0.0, truth_largest_excess_n = 0.0;
};

/// Accuracy scores of a renderer along the path: replayed, and under the hand.
struct LoopScores {
  std::string renderer;
  struct Side {
    std::optional<double> force_rms_percent, direction_p99_deg, indistinguishable_percent, ripple_ratio;
    std::optional<double> ripple_shown_ratio;  ///< after the device's motors
    std::uint64_t frames = 0, contact_frames = 0;
  };
  Side open, closed;
};

/// All that is measured of one renderer.
struct MeasuredLoop {
  std::vector<StabilityPoint> points;
  std::vector<TaskResult> tasks;
  std::vector<LoopScores> scores;
};
PALPATE_JSON_MEMBERS(StabilityPoint, renderer, hand, varied, control, rate_hz, delay_ms, damping_n_s_per_mm,
                     largest_stable_n_per_mm, unlimited, theory_n_per_mm, passive_n_per_mm, lost,
                     limit_cycle_mm, limit_cycle_hz, generated_mj)
PALPATE_JSON_MEMBERS(TaskResult, renderer, task, stable, contour_rms_mm, contour_max_mm, generated_mj,
                     largest_step_n, largest_excess_n, truth_largest_excess_n)
PALPATE_JSON_MEMBERS(LoopScores::Side, frames, contact_frames, force_rms_percent, direction_p99_deg,
                     indistinguishable_percent, ripple_ratio, ripple_shown_ratio)
PALPATE_JSON_MEMBERS(LoopScores, renderer, open, closed)
PALPATE_JSON_MEMBERS(MeasuredLoop, points, tasks, scores)

struct StabilityDocument {
  metrics::DocumentHead head;
  std::string scene, path, truth, device, hand;
  double stiffness_n_per_mm = 0.0;  ///< the scene's
  bool truth_stable = true;         ///< no task swings with the truth in the loop
  std::vector<StabilityPoint> points;
  std::vector<TaskResult> tasks;
  std::vector<LoopScores> scores;
  std::vector<std::string> warnings, notes;
};

[[nodiscard]] std::string to_json(const StabilityDocument& document);
/// Main results for terminal and page.
[[nodiscard]] std::vector<Table> stability_tables(const StabilityDocument& document);
/// The page, its figures drawn into `folder`.
[[nodiscard]] Page stability_page(const StabilityDocument& document, const OutputFolder& folder);

/// Returns the exit status: 1 if a renderer could not be prepared.
[[nodiscard]] Result<int> run_stability(const StabilityArguments& arguments, Context& context);

[[nodiscard]] std::string limit_text(const StabilityPoint& point);

/// A table per renderer: rows are hand, control and delay, columns the rates. The truth's table adds the
/// linear loop on a plane. Empty without cross points.
[[nodiscard]] std::vector<Table> cross_tables(const StabilityDocument& document);

/// A chart per renderer and hand: a line per control (colour) and delay (dashes).
[[nodiscard]] std::vector<Chart> cross_charts(const StabilityDocument& document);

// Measurements of one renderer in the loop.

using RunDone = std::function<void()>;

/// The largest stiffness that rests under the hand of `point`, like every smaller one tried. Tries upwards in
/// steps of a half, then bisects to 3 %. Fills the point. `unit` renders 1 N/mm; `control` encloses it.
/// Error: an invalid bench.
[[nodiscard]] Status find_largest_stable(render::HapticRenderer& unit, double unit_n_per_mm,
                                         const control::ControlOptions& control, Bench bench,
                                         const Places& places, StabilityPoint& point, const RunDone& done);

/// Runs every task with the renderer and with the truth.
[[nodiscard]] Result<std::vector<TaskResult>> do_tasks(render::HapticRenderer& renderer, const Stage& stage,
                                                       const Bench& bench, const Places& places,
                                                       const RunDone& done);

/// Scores along the stage's path.
[[nodiscard]] Result<LoopScores> score_loop(render::HapticRenderer& renderer, const Stage& stage,
                                            const Bench& bench, const Places& places, Progress& progress,
                                            const RunDone& done);

/// Stiffness of the scene's model, N/mm.
[[nodiscard]] double scene_stiffness(const Stage& stage);

}  // namespace palpate::experiments
