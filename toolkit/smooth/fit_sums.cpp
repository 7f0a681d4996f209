#include "toolkit/smooth/fit_sums.h"

#include "toolkit/core/lanes.h"

namespace palpate::render {
namespace {

#define PALPATE_SUMS narrow_sums
#define PALPATE_TARGET
#include "toolkit/smooth/fit_sums.inl"
#undef PALPATE_SUMS
#undef PALPATE_TARGET

#if defined(__x86_64__)
#define PALPATE_SUMS wide_sums
#define PALPATE_TARGET __attribute__((target("avx2")))
#include "toolkit/smooth/fit_sums.inl"
#undef PALPATE_SUMS
#undef PALPATE_TARGET
#endif

/// Asked for every fit.
bool wide_here() {
  static const bool kWide = wide_lanes();
  return kWide;
}

}  // namespace

void FitPoints::take(const std::vector<Vec3>& away) {
  count_ = away.size();
  const std::size_t padded = (count_ + kAtOnce - 1) / kAtOnce * kAtOnce;
  for (std::vector<double>* of : {&x_, &y_, &z_, &real_, &u_, &v_, &w_, &off_}) of->resize(padded);
  for (std::size_t i = 0; i < count_; ++i) {
    x_[i] = away[i].x();
    y_[i] = away[i].y();
    z_[i] = away[i].z();
    real_[i] = 1.0;
  }
  for (std::size_t i = count_; i < padded; ++i) x_[i] = y_[i] = z_[i] = real_[i] = 0.0;
}

FitLanes FitPoints::lanes() noexcept {
  return {x_.data(), y_.data(), z_.data(),   real_.data(), u_.data(),
          v_.data(), w_.data(), off_.data(), x_.size()};
}

void FitPoints::moments(const FitFrame& frame, const FitHeight& height, double per_scale, FitMoments& out) {
#if defined(__x86_64__)
  if (wide_here()) return wide_sums::moments(lanes(), frame, height, per_scale, out);
#endif
  narrow_sums::moments(lanes(), frame, height, per_scale, out);
}

std::span<double> FitPoints::residuals(const FitHeight& height) {
  const std::span<double> found(off_.data(), count_);
#if defined(__x86_64__)
  if (wide_here()) {
    wide_sums::residuals(lanes(), height);
    return found;
  }
#endif
  narrow_sums::residuals(lanes(), height);
  return found;
}

double FitPoints::weights(const FitFrame& frame, const FitHeight& height, double per_scale) {
#if defined(__x86_64__)
  if (wide_here()) return wide_sums::weights(lanes(), frame, height, per_scale);
#endif
  return narrow_sums::weights(lanes(), frame, height, per_scale);
}

}  // namespace palpate::render
