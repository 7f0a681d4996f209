// Perceptual scores: lag, ripple, relief, and the share of indistinguishable frames.
#include <algorithm>
#include <cmath>
#include <complex>
#include <deque>
#include <numbers>

#include <palpate/accuracy.h>
#include <palpate/result.h>
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/metrics/force_steps.h"
#include "toolkit/metrics/scores.h"

namespace palpate::metrics {
namespace {

constexpr double kMsPerS = 1e3;

double median_step_s(const trace::ProbePath& path) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < path.size(); ++i) steps.push_back(path.t_s[i] - path.t_s[i - 1]);
  return steps.empty() ? 0.0 : upper_median(std::move(steps));
}

// ---- lag

constexpr std::size_t kMaxLag = 200;  // samples: a fifth of a second at 1 kHz, half a stroke of the weave
constexpr double kExplained = 0.5;    // reduction of the squared error from which it is a delay

void score_lag(const ScoreInput& in, Accuracy& a) {
  const std::size_t n = in.frames.size(), most = std::min(kMaxLag, n / 4);
  double energy = 0.0;
  for (const render::Frame& frame : in.frames) energy += frame.force_n.squaredNorm();
  if (!(energy > 0.0)) return;
  // The same frames for every delay, for comparable sums.
  const auto error_of = [&](std::size_t lag) {
    double sum = 0.0;
    for (std::size_t i = most; i < n; ++i)
      if (in.decided(i)) sum += (in.rendered(i) - in.wanted(i - lag)).squaredNorm();
    return sum;
  };
  const double now = error_of(0);
  double best = kExplained * now;
  std::size_t lag = 0;
  for (std::size_t l = 1; l <= most; ++l)
    if (const double error = error_of(l); error < best) {
      best = error;
      lag = l;
    }
  a.lag_ms = static_cast<double>(lag) * median_step_s(in.path) * kMsPerS;
}

// ---- ripple

constexpr double kLowHz = 20.0, kHighHz = 500.0;
// The mass that the force moves: a Phantom Omni's 45 g and the literature's default hand, in SI.
constexpr double kMassKg = 0.045 + 0.15, kDampingNsPerM = 4.5, kStiffnessNPerM = 400.0;
constexpr double kUmPerM = 1e6;
constexpr std::size_t kWindow = 256;  // a quarter of a second at 1 kHz: bins of 3.9 Hz

double moved_um_per_n(double hz) {
  const double w = 2.0 * std::numbers::pi * hz;
  return kUmPerM / std::abs(std::complex<double>(kStiffnessNPerM - kMassKg * w * w, kDampingNsPerM * w));
}

/// Welch's estimate over windows of unbroken true contact, half overlapping.
void score_ripple(const ScoreInput& in, Accuracy& a) {
  const double step_s = median_step_s(in.path);
  if (!(step_s > 0.0)) return;
  const double bin_hz = 1.0 / (step_s * kWindow);
  std::vector<double> shape(kWindow), cosine(kWindow), sine(kWindow);
  double weight = 0.0;
  for (std::size_t k = 0; k < kWindow; ++k) {
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) / kWindow;
    cosine[k] = std::cos(turn);
    sine[k] = std::sin(turn);
    shape[k] = 0.5 - 0.5 * cosine[k];  // Hann
    weight += shape[k];
  }
  std::vector<double> power(kWindow / 2 + 1, 0.0);
  std::vector<Vec3> error(kWindow);
  std::size_t windows = 0, unbroken = 0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    unbroken = in.in_true_contact(i) ? unbroken + 1 : 0;
    if (unbroken < kWindow) continue;
    unbroken = kWindow / 2;
    ++windows;
    Vec3 mean = Vec3::Zero();
    for (std::size_t k = 0; k < kWindow; ++k) {
      const std::size_t at = i + 1 - kWindow + k;
      error[k] = in.rendered(at) - in.wanted(at);
      mean += error[k] / kWindow;
    }
    for (std::size_t bin = 1; bin < power.size(); ++bin) {
      const double hz = static_cast<double>(bin) * bin_hz;
      if (hz < kLowHz || hz > kHighHz) continue;
      Vec3 re = Vec3::Zero(), im = Vec3::Zero();
      for (std::size_t k = 0; k < kWindow; ++k) {
        const Vec3 value = shape[k] * (error[k] - mean);
        re += cosine[bin * k % kWindow] * value;
        im += sine[bin * k % kWindow] * value;
      }
      power[bin] += re.squaredNorm() + im.squaredNorm();
    }
  }
  if (windows == 0) return;
  a.ripple_ratio = 0.0;
  for (std::size_t bin = 1; bin < power.size(); ++bin) {
    const double hz = static_cast<double>(bin) * bin_hz;
    if (hz < kLowHz || hz > kHighHz) continue;
    // A pure tone has no twin of negative frequency only at half the sampling rate.
    const double twin = bin + 1 == power.size() ? 1.0 : 2.0;
    const double amplitude_n = twin * std::sqrt(power[bin] / static_cast<double>(windows)) / weight;
    const double ratio = amplitude_n * moved_um_per_n(hz) / detection_threshold_um(hz);
    if (ratio <= *a.ripple_ratio) continue;
    a.ripple_ratio = ratio;
    a.ripple_hz = hz;
  }
}

// ---- relief

// Louw, Kappers and Koenderink 2000: a finger notices bumps of width w from 8 mm (w / 240 mm)^1.3 on.
constexpr double kBumpMm = 8.0, kBumpWidthMm = 240.0, kBumpExponent = 1.3;
constexpr double kWidthsMm[] = {1.0, 3.0, 10.0};

/// Largest difference of two values within any `width` of the way.
double most_relief(const std::vector<double>& way_mm, const std::vector<double>& height_mm, double width_mm) {
  std::deque<std::size_t> highest, lowest;
  double most = 0.0;
  for (std::size_t i = 0; i < way_mm.size(); ++i) {
    while (!highest.empty() && height_mm[highest.back()] <= height_mm[i]) highest.pop_back();
    while (!lowest.empty() && height_mm[lowest.back()] >= height_mm[i]) lowest.pop_back();
    highest.push_back(i);
    lowest.push_back(i);
    while (way_mm[i] - way_mm[highest.front()] > width_mm) highest.pop_front();
    while (way_mm[i] - way_mm[lowest.front()] > width_mm) lowest.pop_front();
    most = std::max(most, height_mm[highest.front()] - height_mm[lowest.front()]);
  }
  return most;
}

void score_relief(const ScoreInput& in, Accuracy& a) {
  std::vector<double> way_mm, height_mm;
  const auto take = [&] {
    for (const double width : kWidthsMm) {
      if (way_mm.empty() || way_mm.back() < width) continue;
      const double ratio =
          most_relief(way_mm, height_mm, width) / (kBumpMm * std::pow(width / kBumpWidthMm, kBumpExponent));
      if (a.relief_ratio && ratio <= *a.relief_ratio) continue;
      a.relief_ratio = ratio;
      a.relief_width_mm = width;
    }
    way_mm.clear();
    height_mm.clear();
  };
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.decided(i) || !in.frames[i].contact || !in.truth[i].frame.contact) {
      take();
      continue;
    }
    const Vec3& g = in.truth[i].frame.god_object_mm;
    const double step = way_mm.empty() ? 0.0 : (g - in.truth[i - 1].frame.god_object_mm).norm();
    way_mm.push_back(way_mm.empty() ? 0.0 : way_mm.back() + step);
    height_mm.push_back((in.frames[i].god_object_mm - g).dot(in.truth[i].normal));
  }
  take();
}

// ---- the headline

void score_headline(const ScoreInput& in, const Episodes& episodes, Accuracy& a) {
  std::vector<double> same(episodes.count), asked(episodes.count);
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    const double wanted = in.wanted(i).norm();
    // Differences below the device's floor decide nothing.
    if (!in.decided(i) || !(std::max(wanted, in.rendered(i).norm()) > a.floor_n)) continue;
    const std::uint32_t e = episodes.of_frame[i];
    asked[e] += 1.0;
    const bool near = (in.rendered(i) - in.wanted(i)).norm() <= std::max(kForceJnd * wanted, a.floor_n);
    const bool smooth =
        i == 0 || !in.decided(i - 1) || in.true_edge(i, a.floor_n) || in.jump_error_n(i) <= a.floor_n;
    if (near && smooth) same[e] += 1.0;
  }
  const auto share = [&](std::span<const std::uint32_t> counts) -> std::optional<double> {
    double good = 0.0, all = 0.0;
    for (std::size_t e = 0; e < episodes.count; ++e) {
      const double times = counts.empty() ? 1.0 : static_cast<double>(counts[e]);
      good += times * same[e];
      all += times * asked[e];
    }
    return all > 0.0 ? std::optional(kToPercent * good / all) : std::nullopt;
  };
  a.indistinguishable_percent = share({});
  a.indistinguishable_interval = bootstrap(
      episodes.count, [&](std::span<const std::uint32_t> counts, Random&) { return share(counts); });
}

}  // namespace

Episodes episodes_of(const std::vector<trace::TruthFrame>& truth) {
  Episodes episodes;
  bool before = false;
  for (const trace::TruthFrame& frame : truth) {
    const bool now = felt(frame.frame.force_n);
    if (now && !before) ++episodes.in_contact;
    before = now;
    episodes.of_frame.push_back(
        static_cast<std::uint32_t>(episodes.in_contact == 0 ? 0 : episodes.in_contact - 1));
  }
  episodes.count = std::max<std::size_t>(episodes.in_contact, 1);
  return episodes;
}

void score_perception(const ScoreInput& in, const Episodes& episodes, Accuracy& a) {
  score_lag(in, a);
  score_ripple(in, a);
  score_relief(in, a);
  score_headline(in, episodes, a);
}

// Scores by Coulomb's law, from the force, the god object's motion and the true normal.

namespace {

/// Literature: the coefficient in slip within 5 %.
constexpr double kFrictionTolerance = 0.05;
/// Motion relative to the HIP: at least half is slip, at most a hundredth stick; between them a slip begins
/// or ends in the frame.
constexpr double kSlips = 0.5, kSticks = 0.01;
/// Below this share of the dynamic coefficient a god object must stick. Not nearer to 1: on curved surfaces
/// the normals at god object and HIP give coefficients a tenth apart.
constexpr double kWellInside = 0.5;
constexpr double kDriftPercentile = 95.0;

}  // namespace

std::vector<double> friction_ratios(const trace::ForceTrace& trace, const TruthSurface& truth) {
  std::vector<double> ratios;
  ratios.reserve(trace.frames.size());
  for (const render::Frame& frame : trace.frames) {
    if (!frame.contact || !felt(frame.force_n)) {
      ratios.push_back(0.0);
      continue;
    }
    const Vec3 normal = truth.closest(frame.god_object_mm).normal;
    const double along = frame.force_n.dot(normal);
    ratios.push_back(along > 0.0 ? (frame.force_n - along * normal).norm() / along : kPullsInward);
  }
  return ratios;
}

void score_friction(const ScoreInput& in, const TruthSamples& answers, Accuracy& a) {
  const AccuracyOptions& o = in.options;
  if (!(o.static_friction > 0.0 || o.dynamic_friction > 0.0) || answers.friction_ratio.empty()) return;
  const double most = std::max(o.static_friction, o.dynamic_friction) * (1.0 + kFrictionTolerance);
  std::uint64_t contact = 0, outside = 0, told = 0, right = 0;
  std::vector<double> slip_errors, drifts_mm_s;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    if (!in.decided(i) || !in.frames[i].contact || !(in.rendered(i).norm() >= a.floor_n)) continue;
    const double ratio = answers.friction_ratio[i];
    ++contact;
    outside += ratio == kPullsInward || ratio > most ? 1u : 0u;
    if (ratio == kPullsInward || !in.frames[i - 1].contact) continue;
    const double way = in.travel_mm(i);
    if (!(way > a.rounding_mm / kSticks)) continue;  // too short to tell
    const double went = (in.frames[i].god_object_mm - in.frames[i - 1].god_object_mm).norm();
    const bool slips = went >= kSlips * way, sticks = went <= kSticks * way;
    // Well inside the cone it must stick; slipping has the dynamic coefficient.
    const bool must_stick = ratio < kWellInside * o.dynamic_friction;
    if (slips && o.dynamic_friction > 0.0)
      slip_errors.push_back(kToPercent * std::abs(ratio / o.dynamic_friction - 1.0));
    if (must_stick) drifts_mm_s.push_back(went / (in.path.t_s[i] - in.path.t_s[i - 1]));
    if (!slips && !sticks) continue;
    ++told;
    right += (slips ? !must_stick : ratio <= most) ? 1u : 0u;
  }
  if (contact > 0) a.friction_cone_percent = percent_of(outside, contact);
  if (told > 0) a.stick_slip_percent = percent_of(right, told);
  if (!slip_errors.empty()) a.friction_slip_error_percent = upper_median(std::move(slip_errors));
  if (drifts_mm_s.empty()) return;
  std::sort(drifts_mm_s.begin(), drifts_mm_s.end());
  a.stick_drift_mm_s = nearest_rank(drifts_mm_s, kDriftPercentile);
}

// The energy that a renderer takes and returns.

namespace {

Status check_stiffness(const trace::ProbePath& path, std::span<const double> stiffness_n_per_mm) {
  if (stiffness_n_per_mm.empty() || !std::all_of(stiffness_n_per_mm.begin(), stiffness_n_per_mm.end(),
                                                 [](double k) { return k > 0.0 && std::isfinite(k); }))
    return Error{"the stiffness is not positive", "", path.name};
  return Done{};
}

double stiffness_of(const render::Frame& frame, std::span<const double> stiffness_n_per_mm) {
  const auto model = static_cast<std::size_t>(std::max(frame.model, 0));
  return stiffness_n_per_mm[model < stiffness_n_per_mm.size() ? model : 0];
}

}  // namespace

Result<Energy> observe_energy(const trace::ProbePath& path, const trace::ForceTrace& trace,
                              std::span<const double> stiffness_n_per_mm) {
  PALPATE_TRY(check_lengths(path, trace.frames.size(), "the trace"));
  PALPATE_TRY(check_finite(path, trace.frames, "the trace"));
  PALPATE_TRY(check_stiffness(path, stiffness_n_per_mm));
  Energy e;
  control::PassivityObserver observer(control::EnergyRule::kTrapezoid);
  const double stiffest = *std::max_element(stiffness_n_per_mm.begin(), stiffness_n_per_mm.end());
  double work_mj = 0.0, reach_mj = 0.0, sway_mm2 = 0.0;  // scales of E's rounding
  for (std::size_t i = 0; i < path.size(); ++i) {
    const render::Frame& frame = trace.frames[i];
    const double k = stiffness_of(frame, stiffness_n_per_mm);
    e.max_stored_mj = std::max(e.max_stored_mj, frame.force_n.squaredNorm() / (2.0 * k));
    observer.observe(path.hip_mm[i], frame.force_n);
    if (i == 0) continue;
    const Vec3& before_n = trace.frames[i - 1].force_n;
    if (!felt(frame.force_n) && !felt(before_n)) continue;
    const double step_mm = (path.hip_mm[i] - path.hip_mm[i - 1]).norm(), size_mm = path.hip_mm[i].norm();
    const double force_n = std::max(frame.force_n.norm(), before_n.norm());
    work_mj += force_n * step_mm;
    reach_mj += force_n * size_mm;
    sway_mm2 += size_mm * step_mm;
  }
  // Roundings of the products (Higham 2002, section 4.2), position differences and forces.
  constexpr int kProduct = 5, kMaxTerms = 1 << 30;
  const int terms = static_cast<int>(std::min<std::size_t>(path.size(), kMaxTerms)) + kProduct;
  e.rounding_mj =
      gamma(terms) * work_mj + 2.0 * kUnitRoundoff * reach_mj + stiffest * kConvergedPerSize * sway_mm2;
  e.generated_mj = std::max(0.0, -observer.min_energy_mj());  // never -0
  e.final_mj = observer.energy_mj();
  if (e.max_stored_mj > 0.0) e.generated_percent = kToPercent * e.generated_mj / e.max_stored_mj;
  return e;
}

Status observe_episodes(const trace::ProbePath& path, const trace::ForceTrace& trace,
                        const trace::ReferenceTrace& reference, std::span<const double> stiffness_n_per_mm,
                        Energy& energy) {
  PALPATE_TRY(check_lengths(path, trace.frames.size(), "the trace"));
  PALPATE_TRY(check_lengths(path, reference.frames.size(), "the reference"));
  PALPATE_TRY(check_stiffness(path, stiffness_n_per_mm));
  const Episodes episodes = episodes_of(reference.frames);
  if (episodes.in_contact == 0) return Done{};
  struct Episode {
    double stored_mj = 0.0;  // most by the true contact
    double kept_mj = 0.0;    // put in, minus what a spring would still store
    double most_mj = 0.0, drawdown_mj = 0.0;
  };
  std::vector<Episode> all(episodes.count);
  double given_mj = 0.0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    Episode& e = all[episodes.of_frame[i]];
    const render::Frame& frame = trace.frames[i];
    const double held_mj = frame.force_n.squaredNorm() / (2.0 * stiffness_of(frame, stiffness_n_per_mm));
    const render::Frame& truth = reference.frames[i].frame;
    e.stored_mj =
        std::max(e.stored_mj, truth.force_n.squaredNorm() / (2.0 * stiffness_of(truth, stiffness_n_per_mm)));
    const bool begins = i == 0 || episodes.of_frame[i] != episodes.of_frame[i - 1];
    if (i > 0)
      given_mj -=
          0.5 * (trace.frames[i - 1].force_n + frame.force_n).dot(path.hip_mm[i] - path.hip_mm[i - 1]);
    e.kept_mj = given_mj - held_mj;
    e.most_mj = begins ? e.kept_mj : std::max(e.most_mj, e.kept_mj);
    e.drawdown_mj = std::max(e.drawdown_mj, e.most_mj - e.kept_mj);
  }
  std::vector<double> percent;
  for (const Episode& e : all)
    if (e.stored_mj > 0.0) percent.push_back(kToPercent * e.drawdown_mj / e.stored_mj);
  if (percent.empty()) return Done{};
  energy.drawdown_percent = *std::max_element(percent.begin(), percent.end());
  energy.drawdown_p50_percent = upper_median(std::move(percent));
  return Done{};
}

}  // namespace palpate::metrics
