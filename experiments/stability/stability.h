// The whole of `palpate stability`: renderers under a simulated hand on a simulated device. Which stiffness
// stays stable, where the hand goes, and what is felt.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "device/simulated/closed_loop.h"
#include "experiments/report/page.h"
#include "experiments/session/study_run.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments {

inline constexpr const char* kStabilityFile = "stability.json";
/// Goes up when a key changes its meaning or goes away.
inline constexpr const char* kStabilitySchema = "palpate-stability/1";

/// Of the path where none is named: the hand's goal for six seconds.
inline constexpr int kStabilityFrames = 6'000;

struct StabilityArguments {
  RunArguments run;  ///< of it: scene, renderers, path, truth, folder, model, surface, json
  std::string device = "omni", hand = "hand";
  std::string rates = "500,1000,2000,4000,8000";                ///< Hz
  std::string delays = "0,1,2,4";                               ///< ms
  std::string dampings = "0,0.0001,0.0002,0.0005,0.001,0.002";  ///< of the wall, N s/mm
  bool cross = false;  ///< every rate with every delay, under each control
  double jitter_ms = 0.0;
  double slew_n_per_s = 1000.0;
};

/// One search for the largest stable stiffness.
struct StabilityPoint {
  std::string renderer;  ///< label
  std::string hand;      ///< "released": a steady push alone
  std::string varied;    ///< "rate", "delay", "damping", "control", "cross"; the base stands under "rate"
  std::string control = "none";
  double rate_hz = 1000.0, delay_ms = 0.0, damping_n_s_per_mm = 0.0;
  double largest_stable_n_per_mm = 0.0;    ///< 0: none that was tried
  bool unlimited = false;                  ///< the stiffest that was tried is stable
  std::optional<double> theory_n_per_mm;   ///< exact limit of the linear loop on a plane
  std::optional<double> passive_n_per_mm;  ///< bound for any hand, without delay
  // Just above the limit:
  bool lost = false;  ///< the surface does not hold the device: it falls through, or is pushed off
  double limit_cycle_mm = 0.0, limit_cycle_hz = 0.0;
  double generated_mj = 0.0;  ///< most energy given by the environment
};

/// One task of the hand with a renderer, beside the same with the truth in its place.
struct TaskResult {
  std::string renderer, task;
  bool stable = true;                                 ///< no fault, no swing at its end
  double contour_rms_mm = 0.0, contour_max_mm = 0.0;  ///< distance from the truth's way
  double generated_mj = 0.0;
  metrics::ForceSteps steps, truth_steps;
};

/// What the scores of accuracy say of a renderer along the path: replayed, and under the hand.
struct LoopScores {
  std::string renderer;
  struct Side {
    std::optional<double> force_rms_percent, direction_p99_deg, indistinguishable_percent, ripple_ratio;
    std::optional<double> ripple_shown_ratio;  ///< after the device's motors
    std::uint64_t frames = 0, contact_frames = 0;
  };
  Side open, closed;
};

struct StabilityDocument {
  metrics::DocumentHead head;
  std::string scene, path, truth, device, hand;
  double stiffness_n_per_mm = 0.0;  ///< the scene's
  bool truth_stable = true;         ///< with the truth in the loop no task swings
  std::vector<StabilityPoint> points;
  std::vector<TaskResult> tasks;
  std::vector<LoopScores> scores;
  std::vector<std::string> warnings, notes;
};

[[nodiscard]] std::string to_json(const StabilityDocument& document);
/// What a reader wants first, for the terminal and the page.
[[nodiscard]] std::vector<Table> stability_tables(const StabilityDocument& document);
/// stability.json, report.html with its figures.
[[nodiscard]] Status write_stability(const StabilityDocument& document, const OutputFolder& folder);

/// The exit status: 1 where a renderer could not be prepared.
int run_stability(const StabilityArguments& arguments, Context& context);

}  // namespace palpate::experiments
