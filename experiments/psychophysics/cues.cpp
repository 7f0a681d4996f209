#include "experiments/psychophysics/cues.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments::psychophysics {
namespace {

// Time over which motions are compared: long against an encoder's steps, short against a press.
constexpr double kStrideS = 0.02;
// Vibration range of the hand, Hz; below is motion.
constexpr double kLowestHz = 20.0, kHighestHz = 500.0;
// Length of a spectrum's stretch; its frequency spacing is finer than a hand's resonances.
constexpr double kStretchS = 0.5;
// A Hann window spreads a tone's power over 1.5 frequency steps.
constexpr double kHannBands = 1.5;
// Smallest force step of a common device: 0.5 N/mm times 0.055 mm.
constexpr double kFloorN = 0.0275;
// A spring softer than the arm that holds it (10 N/m, Yokokohji and Yoshikawa 1994) is not felt.
constexpr double kSoftestNPerMm = 0.01;
constexpr double kUmPerM = 1e6;

/// Steps of an evenly sampled trace within `seconds`; at least one.
std::size_t steps_in(std::span<const FeltSample> samples, double seconds) {
  if (samples.size() < 2) return 1;
  const double step_s = (samples.back().t_s - samples.front().t_s) / static_cast<double>(samples.size() - 1);
  return step_s > 0.0 ? std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(seconds / step_s))) : 1;
}

/// Least-squares fit of force by depth over strides that move more along `normal` than sideways.
double felt_stiffness(std::span<const FeltSample> samples, const Vec3& normal) {
  const std::size_t stride = steps_in(samples, kStrideS);
  double both = 0.0, squares = 0.0;
  for (std::size_t i = stride; i < samples.size(); ++i) {
    const FeltSample &now = samples[i], &before = samples[i - stride];
    if (!now.contact || !before.contact) continue;
    const Vec3 way_mm = now.at_mm - before.at_mm;
    const double deeper_mm = -way_mm.dot(normal);
    if (std::abs(deeper_mm) < (way_mm + deeper_mm * normal).norm()) continue;
    both += deeper_mm * (now.force_n - before.force_n).dot(normal);
    squares += deeper_mm * deeper_mm;
  }
  return squares > 0.0 ? std::max(0.0, both / squares) : 0.0;
}

/// Power of displacement in a stretch, in squared just noticeable amplitudes.
double noticed_power(std::span<const FeltSample> stretch, const Vec3& mean_n, double step_s,
                     double moved_kg) {
  const auto n = static_cast<double>(stretch.size());
  double power = 0.0;
  for (double hz = std::ceil(kLowestHz * n * step_s) / (n * step_s); hz <= std::min(kHighestHz, 0.5 / step_s);
       hz += 1.0 / (n * step_s)) {
    const double turn = 2.0 * std::numbers::pi * hz * step_s;
    const std::complex<double> step(std::cos(turn), -std::sin(turn));
    std::complex<double> at(1.0, 0.0);
    std::array<std::complex<double>, 3> sums{};
    double weights = 0.0;
    for (std::size_t i = 0; i < stretch.size(); ++i) {
      const double window = 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(i) + 0.5) / n);
      weights += window;
      for (int axis = 0; axis < 3; ++axis)
        sums[static_cast<std::size_t>(axis)] += window * (stretch[i].force_n[axis] - mean_n[axis]) * at;
      at *= step;
    }
    double force_power = 0.0;
    for (const std::complex<double>& sum : sums) force_power += std::norm(2.0 * sum / weights);
    const double omega = 2.0 * std::numbers::pi * hz;
    const double um = std::sqrt(force_power) / (moved_kg * omega * omega) * kUmPerM;
    const double ratio = um / metrics::detection_threshold_um(hz);
    power += ratio * ratio / kHannBands;
  }
  return power;
}

/// Mean over complete stretches that are in contact throughout.
double felt_vibration(std::span<const FeltSample> samples, double moved_kg) {
  const std::size_t length = steps_in(samples, kStretchS);
  if (samples.size() < 2) return 0.0;
  const double step_s = (samples.back().t_s - samples.front().t_s) / static_cast<double>(samples.size() - 1);
  double power = 0.0;
  std::size_t stretches = 0, held = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    held = samples[i].contact ? held + 1 : 0;
    if (held < length) continue;
    held = 0;
    const auto stretch = samples.subspan(i + 1 - length, length);
    Vec3 mean_n = Vec3::Zero();
    for (const FeltSample& one : stretch) mean_n += one.force_n / static_cast<double>(length);
    power += noticed_power(stretch, mean_n, step_s, moved_kg);
    ++stretches;
  }
  return stretches > 0 ? std::sqrt(power / static_cast<double>(stretches)) : 0.0;
}

}  // namespace

Cues cues_of(std::span<const FeltSample> samples, const Thresholds& thresholds) {
  Cues cues;
  Vec3 sum_n = Vec3::Zero();
  double sizes_n = 0.0;
  std::size_t touched = 0;
  for (const FeltSample& one : samples) {
    if (!one.contact) continue;
    ++touched;
    sum_n += one.force_n;
    sizes_n += one.force_n.norm();
  }
  if (touched == 0 || !(sum_n.norm() > 0.0)) return cues;
  cues.touched = true;
  cues.force_n = sizes_n / static_cast<double>(touched);
  cues.direction = sum_n.normalized();
  cues.stiffness_n_per_mm = felt_stiffness(samples, cues.direction);
  cues.vibration = felt_vibration(samples, thresholds.moved_kg);
  return cues;
}

double sensation(double x, double floor, double weber) noexcept {
  const double knee = floor / weber;
  return x <= knee ? x / floor : 1.0 / weber + std::log(x / knee) / std::log1p(weber);
}

CueScales scales_of(const Cues& cues, const Thresholds& thresholds, const Vec3& from,
                    const Vec3& to) noexcept {
  const Thresholds& t = thresholds;
  const double one_way_rad = t.direction_deg * std::numbers::pi / 180.0;
  const Vec3 apart = to - from;
  const double size = apart.norm();
  const double turned = size > 0.0 && cues.touched ? (cues.direction - from).dot(apart) / size : 0.0;
  return {sensation(cues.stiffness_n_per_mm, t.stiffness * kSoftestNPerMm, t.stiffness),
          sensation(cues.force_n, kFloorN, t.force),
          sensation(cues.vibration, t.vibration_floor, t.vibration), turned / one_way_rad};
}

}  // namespace palpate::experiments::psychophysics
