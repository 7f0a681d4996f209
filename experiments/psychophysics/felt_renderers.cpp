#include "experiments/psychophysics/felt_renderers.h"

namespace palpate::experiments::psychophysics {

render::Frame HeldRate::step(const Vec3& hip_mm, double t_s) noexcept {
  // A due time within a thousandth of a period counts as reached, since times are rounded sums.
  constexpr double kRounding = 1e-3;
  if (t_s + kRounding * period_s_ < due_s_) return held_;
  due_s_ += period_s_;
  if (due_s_ <= t_s) due_s_ = t_s + period_s_;  // missed times are skipped
  held_ = inner().step(hip_mm, t_s);
  return held_;
}

}  // namespace palpate::experiments::psychophysics
