// Force filtering (section 3.2.5): "restrictions on the current frame's force vector in relation to what the
// force vector in the previous frame looked like". The thesis gives only this sentence; the limits are ours,
// in a literal and a corrected form.
#pragma once

#include <cstdint>
#include <optional>

#include <palpate/control.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::control {

/// The thesis's haptic frame, which converts limits per second to limits per frame.
inline constexpr double kLiteralFrameS = 1e-3;

/// An Error names the limit that is negative or not finite.
[[nodiscard]] Status check(const ForceFilterOptions& options);

/// Limits direction, then rate: no force between the last and the turned one turns further, so both limits
/// hold. A filter delays (filter_delay) and is therefore active: it returns on the way out what it withheld
/// on the way in (figures in docs/reference/scene-keys.md).
class ForceFilter {
 public:
  explicit ForceFilter(const ForceFilterOptions& options = {}) noexcept : options_(options) {}

  void reset() noexcept { last_n_.setZero(); }
  /// The allowed force `dt_s` after the last. A non-finite wanted force counts as zero, dt_s <= 0 as no time.
  /// Bounded work, no allocation.
  [[nodiscard]] Vec3 filter(const Vec3& wanted_n, double dt_s) noexcept;
  [[nodiscard]] const ForceFilterOptions& options() const noexcept { return options_; }

 private:
  [[nodiscard]] Vec3 turned(const Vec3& wanted_n, double max_rad) const noexcept;

  ForceFilterOptions options_;
  Vec3 last_n_ = Vec3::Zero();
};

/// Test inputs for measuring a filter's delay.
struct FilterProbe {
  double step_n = 1.0;            ///< onset of contact: from 0 to this in one frame
  double ramp_n_per_s = 10.0;     ///< pressing in: 0.5 N/mm at 20 mm/s
  double step_deg = 10.0;         ///< a change of point: 0.2 mm aside at 1 mm depth is 11 degrees
  double ramp_deg_per_s = 100.0;  ///< sliding over a curved surface: 10 mm radius at 20 mm/s is 115
  double dt_s = 1e-3;
};

/// Times from the frame that wanted the step; 0 if it shows at once.
struct StepDelay {
  double to_63_percent_s = 0.0;
  double to_95_percent_s = 0.0;
  /// Final lag behind a steady ramp; nothing if it grows without end.
  std::optional<double> ramp_lag_s;
};
struct FilterDelay {
  StepDelay size;       ///< of a change of magnitude
  StepDelay direction;  ///< of a change of direction at step_n, which the rate limit delays too
};
/// Measured by running the filter. Errors: invalid options or probe (steps below a right angle, a ramp of at
/// least two frames), or a step not reached within kMeasuredFrames frames.
[[nodiscard]] Result<FilterDelay> filter_delay(const ForceFilterOptions& options, const FilterProbe& probe);
inline constexpr int kMeasuredFrames = 100'000;

}  // namespace palpate::control
