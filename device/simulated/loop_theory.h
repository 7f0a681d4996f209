// What is known of a sampled spring on a device, against which simulations are checked. SI in the sources,
// mm here.
#pragma once

#include "device/simulated/motion.h"

namespace palpate::device {

/// The largest stiffness that is passive, so stable under any hand: b > K T / 2 + |B| (Colgate and Schenkel
/// 1997), and K <= 2 f / step with an encoder (Abbott and Okamura 2005; Diolaiti and others 2006). B is the
/// wall's own damping, by differences of positions. 0 where none is. Without delay and lag.
[[nodiscard]] double passive_stiffness_n_per_mm(double damping_n_s_per_mm, double wall_damping_n_s_per_mm,
                                                double friction_n, double encoder_mm,
                                                double period_s) noexcept;

/// K < (b + B) / (T / 2 + delay) (Gil and others 2009; Hulin 2010): the limit of slow swings, for a linear
/// loop whose spring turns much slower than the samples.
[[nodiscard]] double delayed_stiffness_n_per_mm(double damping_n_s_per_mm, double wall_damping_n_s_per_mm,
                                                double period_s, double delay_s) noexcept;

struct LinearLoop {
  Plant plant;  ///< device and hand
  double period_s = 1e-3;
  double delay_s = 0.0;  ///< up to kMostPeriodsOfDelay periods
  double wall_damping_n_s_per_mm = 0.0;
};
inline constexpr int kMostPeriodsOfDelay = 64;
/// The exact limit of the linear loop: mass, spring, damper and lag as they are, F(n) = -K x(n) - B (x(n) -
/// x(n-1)) / T held from n T + delay on; stable while all eigenvalues of one period are inside the unit
/// circle. The least stiffness above `least_n_per_mm` at which one is not, to a millionth; infinite where
/// there is none below 1e6 times that. Not for a frame.
[[nodiscard]] double linear_stiffness_n_per_mm(const LinearLoop& loop, double least_n_per_mm = 1e-3);
/// The largest magnitude of the eigenvalues of one period.
[[nodiscard]] double spectral_radius(const LinearLoop& loop, double stiffness_n_per_mm);

}  // namespace palpate::device
