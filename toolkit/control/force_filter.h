// Force filtering (section 3.2.5 of the thesis): "restrictions on the current frame's force vector in
// relation to what the force vector in the previous frame looked like". The thesis gives no more than that
// sentence; how far a force may change, and in what, is filled in here, once to the letter and once made
// right.
#pragma once

#include <cstdint>
#include <optional>

#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"

namespace palpate::control {

/// The haptic frame of the thesis: what a limit "per frame" means where it is given per second.
inline constexpr double kLiteralFrameS = 1e-3;

enum class FilterForm : std::uint8_t {
  /// Limits hold per time; a wanted force of zero is zero at once; a turned force is the part of the wanted
  /// one along the direction it may have, so that nothing pushes where nothing was wanted.
  kPerTime,
  /// As printed: limits hold from frame to frame, however long a frame is (kLiteralFrameS of them); a turned
  /// force keeps its wanted size; after release the force fades by the same rule, outside the model.
  kLiteral,
};

/// A limit of 0 is no limit.
struct ForceFilterOptions {
  double rate_limit_n_per_s = 0.0;    ///< of the size of a change
  double turn_limit_deg_per_s = 0.0;  ///< of the direction, while there was a force and is one
  FilterForm form = FilterForm::kPerTime;
  [[nodiscard]] bool any() const noexcept { return rate_limit_n_per_s > 0.0 || turn_limit_deg_per_s > 0.0; }
};

/// Both limits must be finite and not negative, or there is an Error that names the wrong one.
[[nodiscard]] Status check(const ForceFilterOptions& options);

/// Direction first, then rate: on the way from the last force to the turned one no force turns further than
/// the turned one does, so both limits hold at once. A filter delays (filter_delay) and therefore is active:
/// it gives back on the way out what it withheld on the way in (docs/control.md has figures).
class ForceFilter {
 public:
  explicit ForceFilter(const ForceFilterOptions& options = {}) noexcept : options_(options) {}

  void reset() noexcept { last_n_.setZero(); }
  /// The force that may act now, `dt_s` after the last. A wanted force that is not finite counts as zero, a
  /// time step that is not above 0 as no time. Bounded work, no allocation.
  [[nodiscard]] Vec3 filter(const Vec3& wanted_n, double dt_s) noexcept;
  [[nodiscard]] const ForceFilterOptions& options() const noexcept { return options_; }

 private:
  [[nodiscard]] Vec3 turned(const Vec3& wanted_n, double most_rad) const noexcept;

  ForceFilterOptions options_;
  Vec3 last_n_ = Vec3::Zero();
};

/// What a filter's delay is measured with.
struct FilterProbe {
  double step_n = 1.0;            ///< onset of contact: from 0 to this in one frame
  double ramp_n_per_s = 10.0;     ///< pressing in: 0.5 N/mm at 20 mm/s
  double step_deg = 10.0;         ///< a change of point: 0.2 mm aside at 1 mm depth is 11 degrees
  double ramp_deg_per_s = 100.0;  ///< sliding over a curved surface: 10 mm radius at 20 mm/s is 115
  double dt_s = 1e-3;
};

/// Times from the frame that wanted the step, 0 where that frame already shows it.
struct StepDelay {
  double to_63_percent_s = 0.0;
  double to_95_percent_s = 0.0;
  /// How far the output is behind a steady ramp at last; nothing where it falls behind without end.
  std::optional<double> ramp_lag_s;
};
struct FilterDelay {
  StepDelay size;       ///< of a force that changes its size
  StepDelay direction;  ///< of a force of step_n that changes its direction, which a rate limit delays too
};
/// Measured by running the filter, not by formula. An Error where the options or the probe are wrong (steps
/// below a right angle, a ramp that needs two frames at least for one), or where a step is not reached within
/// kMeasuredFrames frames.
[[nodiscard]] Result<FilterDelay> filter_delay(const ForceFilterOptions& options, const FilterProbe& probe);
inline constexpr int kMeasuredFrames = 100'000;

}  // namespace palpate::control
