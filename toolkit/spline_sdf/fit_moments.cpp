#include "toolkit/spline_sdf/fit_moments.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "toolkit/core/simd.h"

namespace palpate::spline_sdf {
namespace {

/// Up to this many points, a median is found by counting smaller ones for each: quadratic, but four at a time
/// and branch-free.
constexpr std::size_t kMaxRanked = 24;
/// With more, bounds first close in until this few lie between them, or for this many rounds.
constexpr std::size_t kFewBetween = 8;
constexpr int kMaxBounds = 12;
/// Median of |x| over its mean for a normal distribution; the first bound tried.
constexpr double kMedianOfMean = 0.845;
/// Bounds aim this many ranks to either side of the wanted one, so both close in.
constexpr double kBesideAim = 2.5;
/// Least reduction by a bound, as a share of the last two's interval.
constexpr double kMinPart = 0.1;

static_assert(sizeof(Double4) == FitPoints::kSimdWidth * sizeof(double));

#define PALPATE_SUMS narrow_sums
#define PALPATE_TARGET
#include "toolkit/spline_sdf/fit_moments.inl"
#undef PALPATE_SUMS
#undef PALPATE_TARGET

#if defined(__x86_64__)
#define PALPATE_SUMS wide_sums
#define PALPATE_TARGET PALPATE_AVX2
#include "toolkit/spline_sdf/fit_moments.inl"
#undef PALPATE_SUMS
#undef PALPATE_TARGET
#endif

/// Values around the residual of a rank, and the counts below each.
struct Bounds {
  double low = 0.0, high = std::numeric_limits<double>::infinity();
  std::size_t below_low = 0, below_high = 0;
};

/// Interpolates linearly: residuals up to the median are about uniform.
template <class Below>
Bounds close_in(std::size_t points, std::size_t rank, double first, Below&& below) {
  Bounds b;
  b.below_high = points;
  double next = first;
  for (int i = 0; i < kMaxBounds && b.below_high - b.below_low > kFewBetween; ++i) {
    if (!(next > b.low && next < b.high)) break;
    const std::size_t count = below(next);
    const bool is_low = count <= rank;
    (is_low ? b.low : b.high) = next;
    (is_low ? b.below_low : b.below_high) = count;
    const double low_count = static_cast<double>(b.below_low);
    const double aim = static_cast<double>(rank) + 0.5 + (is_low ? kBesideAim : -kBesideAim);
    if (b.high == std::numeric_limits<double>::infinity())
      next = b.low * std::max(aim / std::max(low_count, 1.0), 1.0 + 1.0 / kBesideAim);
    else
      next = b.low + (b.high - b.low) *
                         std::clamp((aim - low_count) / (static_cast<double>(b.below_high) - low_count),
                                    kMinPart, 1.0 - kMinPart);
  }
  return b;
}

/// Asked for every fit.
bool wide_here() {
  static const bool kWide = has_avx2();
  return kWide;
}

}  // namespace

void FitPoints::take(const std::vector<Vec3>& away) {
  count_ = away.size();
  const std::size_t padded = (count_ + kSimdWidth - 1) / kSimdWidth * kSimdWidth;
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
  const bool wide = wide_here();
  const double sum = wide ? wide_sums::residuals(all, height) : narrow_sums::residuals(all, height);
#else
  const double sum = narrow_sums::residuals(all, height);
#endif
  std::fill(off_.begin() + static_cast<std::ptrdiff_t>(count_), off_.end(),
            std::numeric_limits<double>::infinity());
  if (count_ > kMaxRanked) {
    const auto below = [&](double value) {
#if defined(__x86_64__)
      if (wide) return wide_sums::below(all, value);
#endif
      return narrow_sums::below(all, value);
    };
    const Bounds b = close_in(count_, rank, kMedianOfMean * sum / static_cast<double>(count_), below);
    return of_rank_between(b.low, b.high, rank - b.below_low);
  }
#if defined(__x86_64__)
  if (wide) return wide_sums::of_rank(all, count_, rank);
#endif
  return narrow_sums::of_rank(all, count_, rank);
}

double FitPoints::of_rank_between(double low, double high, std::size_t rank) {
  between_.resize(x_.size() + 1);
#if defined(__x86_64__)
  const std::size_t few = wide_here() ? wide_sums::between(lanes(), low, high, between_.data())
                                      : narrow_sums::between(lanes(), low, high, between_.data());
#else
  const std::size_t few = narrow_sums::between(lanes(), low, high, between_.data());
#endif
  if (rank >= few) return off_[count_ / 2];  // some are NaN
  const auto at = between_.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(between_.begin(), at, between_.begin() + static_cast<std::ptrdiff_t>(few));
  return *at;
}

double FitPoints::weights(const FitFrame& frame, const FitHeight& height, double per_scale) {
#if defined(__x86_64__)
  if (wide_here()) return wide_sums::weights(lanes(), frame, height, per_scale);
#endif
  return narrow_sums::weights(lanes(), frame, height, per_scale);
}

}  // namespace palpate::spline_sdf
