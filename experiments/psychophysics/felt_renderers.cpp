#include "experiments/psychophysics/felt_renderers.h"

namespace palpate::experiments::psychophysics {

render::Frame HeldRate::step(const Vec3& hip_mm, double t_s) noexcept {
  // Times are sums of roundings: what is due within a thousandth of a period is due.
  constexpr double kRounding = 1e-3;
  if (t_s + kRounding * period_s_ < due_s_) return held_;
  due_s_ += period_s_;
  if (due_s_ <= t_s) due_s_ = t_s + period_s_;  // what is past is not made up for
  held_ = inner().step(hip_mm, t_s);
  return held_;
}

}  // namespace palpate::experiments::psychophysics
