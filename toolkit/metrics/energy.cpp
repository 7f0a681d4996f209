// The energy that a renderer takes and returns.
#include <algorithm>
#include <cmath>

#include <palpate/accuracy.h>
#include <palpate/result.h>
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/metrics/scores.h"

namespace palpate::metrics {
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
