#include "toolkit/smooth/fit_sums.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "toolkit/core/lanes.h"

namespace palpate::render {
namespace {

/// Of so many points a median is found by counting, for each in turn, how many are less: the square of their
/// number, four at a time, but no branch that cannot be foretold.
constexpr std::size_t kMostRanked = 64;

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

double FitPoints::median_residual(const FitHeight& height) {
  const FitLanes all = lanes();
  const std::size_t rank = count_ / 2;
#if defined(__x86_64__)
  if (wide_here())
    wide_sums::residuals(all, height);
  else
#endif
    narrow_sums::residuals(all, height);
  std::fill(off_.begin() + static_cast<std::ptrdiff_t>(count_), off_.end(),
            std::numeric_limits<double>::infinity());
  if (count_ > kMostRanked) {
    const auto middle = off_.begin() + static_cast<std::ptrdiff_t>(rank);
    std::nth_element(off_.begin(), middle, off_.end());
    return *middle;
  }
#if defined(__x86_64__)
  if (wide_here()) return wide_sums::of_rank(all, count_, rank);
#endif
  return narrow_sums::of_rank(all, count_, rank);
}

double FitPoints::weights(const FitFrame& frame, const FitHeight& height, double per_scale) {
#if defined(__x86_64__)
  if (wide_here()) return wide_sums::weights(lanes(), frame, height, per_scale);
#endif
  return narrow_sums::weights(lanes(), frame, height, per_scale);
}

}  // namespace palpate::render
