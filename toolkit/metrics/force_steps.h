// Steps of the force between ticks, as felt. Parts of them that the HIP's motion explains; the touch
// threshold for vibrations through a stylus.
#pragma once

#include <cstdint>

#include <palpate/vec.h>

namespace palpate::metrics {

/// Allowed excess on clean and on noisy points: a fifth and two fifths of a kick (0.5 N).
inline constexpr double kCleanExcessN = 0.1, kNoisyExcessN = 0.2;

/// The excess |dF| - k |dHIP| is not explained by a rigid surface of stiffness k; hitting a wall is a large
/// step without excess. No allocation.
class ForceSteps {
 public:
  struct Largest {
    double n = 0.0, t_s = 0.0;
    Vec3 hip_mm = Vec3::Zero();
  };

  explicit ForceSteps(double stiffness_n_per_mm = 0.0) : stiffness_n_per_mm_(stiffness_n_per_mm) {}

  void observe(double t_s, const Vec3& hip_mm, const Vec3& force_n) noexcept {
    if (known_) {
      const double step_n = (force_n - force_n_).norm();
      const double excess_n = step_n - stiffness_n_per_mm_ * (hip_mm - hip_mm_).norm();
      if (step_n > step_.n) step_ = {step_n, t_s, hip_mm};
      if (excess_n > excess_.n) excess_ = {excess_n, t_s, hip_mm};
      if (excess_n > kCleanExcessN) ++over_clean_;
      if (excess_n > kNoisyExcessN) ++over_noisy_;
    }
    known_ = true;
    hip_mm_ = hip_mm;
    force_n_ = force_n;
  }
  /// The next force has no predecessor.
  void interrupt() noexcept { known_ = false; }

  [[nodiscard]] const Largest& step() const noexcept { return step_; }
  [[nodiscard]] const Largest& excess() const noexcept { return excess_; }
  [[nodiscard]] std::uint64_t over_clean() const noexcept { return over_clean_; }
  [[nodiscard]] std::uint64_t over_noisy() const noexcept { return over_noisy_; }

 private:
  double stiffness_n_per_mm_;
  bool known_ = false;
  Vec3 hip_mm_ = Vec3::Zero(), force_n_ = Vec3::Zero();
  Largest step_, excess_;
  std::uint64_t over_clean_ = 0, over_noisy_ = 0;
};

/// Just noticeable amplitude at `hz` > 0, um: about 0.2 um from 160 to 300 Hz, the Pacinian channel's best
/// range (Israr, Choi and Tan 2006; the number from memory of the literature), 12 dB an octave less sensitive
/// on either side.
[[nodiscard]] inline double detection_threshold_um(double hz) noexcept {
  constexpr double kKeenestUm = 0.2, kKeenFromHz = 160.0, kKeenToHz = 300.0;
  const double off = hz < kKeenFromHz ? kKeenFromHz / hz : hz > kKeenToHz ? hz / kKeenToHz : 1.0;
  return kKeenestUm * off * off;
}

}  // namespace palpate::metrics
