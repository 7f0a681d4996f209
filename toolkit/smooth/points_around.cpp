#include "toolkit/smooth/points_around.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "toolkit/smooth/surround.h"

namespace palpate::render {
namespace {

/// A point has a say in whether a place of the surface is between points where it is within kTellsSpacings of
/// its spacings of it, and at most this share of that off its tangent plane.
constexpr double kOffPlane = 0.5;
constexpr int kFewestNear = 4;
/// Points whose spacing is less than half that of the sparsest that tell of a place, squared, are beyond a
/// step of density: chance makes a quarter of difference, not half, in the cells that a spacing is counted
/// in. Dense points end farther from a place among sparse ones than their own spacing asks for; what the
/// sparse ones may leave open between them they may leave open up to there, too.
constexpr double kStepSq = 4.0;
constexpr double kGoldenSection = 0.6180340;

/// Points looked at between questions whether they tell: some four of them are near the place.
constexpr std::size_t kAtOnce = 8;
/// The reach, squared, of what is no point.
constexpr double kNothing = -1.0;

/// The eighth of a turn that a direction is in, as a bit.
unsigned eighth_of(double a, double b) {
  // By whether a is below 0, whether b is, and whether a is the larger: eighths counted from a's axis.
  constexpr std::array<std::uint8_t, 8> kEighth{1u << 1, 1u << 0, 1u << 6, 1u << 7,
                                                1u << 2, 1u << 3, 1u << 5, 1u << 4};
  const unsigned which = (a < 0.0 ? 4u : 0u) | (b < 0.0 ? 2u : 0u) | (std::abs(a) > std::abs(b) ? 1u : 0u);
  return kEighth[which];
}

/// Of each set of eighths: no two beside each other are without points, so that no angle of more than three
/// is.
constexpr std::array<bool, 256> kAllAround = [] {
  std::array<bool, 256> all{};
  for (unsigned seen = 0; seen < 256; ++seen) {
    const unsigned empty = ~seen & 255u, next = (empty >> 1 | empty << 7) & 255u;
    all[seen] = (empty & next) == 0;
  }
  return all;
}();

}  // namespace

void PointsAround::gather(const SmoothPoints& points, const Vec3& middle, double reach_mm, double spacing) {
  const double radius = reach_mm + kTellsSpacings * spacing, radius_sq = radius * radius;
  count_ = 0;
  points.about_ball(middle, radius, [&](std::uint32_t first, std::uint32_t past) {
    // As Ball::gather(): what is outside is overwritten.
    const std::size_t most = count_ + (past - first);
    if (near_.size() < most) near_.resize(std::max(most, 2 * near_.size()));
    for (std::uint32_t i = first; i < past; ++i) {
      const Vec3 d = points[i] - middle;
      const double own = kTellsSpacings * std::min(points.spacing_near(i), spacing);
      near_[count_] = {d, own * own};
      count_ += d.squaredNorm() <= radius_sq ? std::size_t{1} : std::size_t{0};
    }
  });
  // In steps of the golden section: the first few are from all around, and mostly tell.
  const std::size_t padded = (count_ + kAtOnce - 1) / kAtOnce * kAtOnce;
  for (std::vector<double>& lane : lanes_) lane.assign(padded, kNothing);
  auto step = static_cast<std::size_t>(kGoldenSection * static_cast<double>(count_));
  while (std::gcd(step, count_) > 1) ++step;
  for (std::size_t i = 0, at = 0; i < count_; ++i) {
    const Near& p = near_[at];
    lanes_[0][i] = p.at.x();
    lanes_[1][i] = p.at.y();
    lanes_[2][i] = p.at.z();
    lanes_[3][i] = p.reach_sq;
    at += step;
    at -= at >= count_ ? count_ : 0;
  }
}

bool PointsAround::are_around(const Vec3& foot, const Vec3& n) const {
  const Vec3 axis = std::abs(n.x()) < std::abs(n.y()) ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 u = n.cross(axis).normalized(), v = n.cross(u);
  const auto tells = [&](const Near& p, const Vec3& d) {
    const double along = d.dot(n);
    return d.squaredNorm() <= p.reach_sq && along * along <= kOffPlane * kOffPlane * p.reach_sq;
  };
  // Eighths of a turn are told without branches, and mostly enough.
  int count = 0;
  unsigned seen = 0;
  std::array<double, kAtOnce> a, b, near;
  for (std::size_t k = 0; k < lanes_[0].size(); k += kAtOnce) {
    const double *const x = &lanes_[0][k], *const y = &lanes_[1][k], *const z = &lanes_[2][k];
    const double* const reach_sq = &lanes_[3][k];
    for (std::size_t j = 0; j < kAtOnce; ++j) {
      const double dx = x[j] - foot.x(), dy = y[j] - foot.y(), dz = z[j] - foot.z();
      const double along = dx * n.x() + (dy * n.y() + dz * n.z());
      const double sq = dx * dx + (dy * dy + dz * dz);
      a[j] = dx * u.x() + (dy * u.y() + dz * u.z());
      b[j] = dx * v.x() + (dy * v.y() + dz * v.z());
      // Below 0 where it tells.
      near[j] = std::max(sq - reach_sq[j], along * along - kOffPlane * kOffPlane * reach_sq[j]);
    }
    for (std::size_t j = 0; j < kAtOnce; ++j) {
      const bool tells_here = near[j] <= 0.0;
      count += tells_here ? 1 : 0;
      seen |= tells_here && std::abs(a[j]) + std::abs(b[j]) > 0.0 ? eighth_of(a[j], b[j]) : 0u;
    }
    if (count >= kFewestNear && kAllAround[seen]) return true;
  }
  if (count < kFewestNear) return false;
  Surround exact;
  double widest_sq = 0.0;
  for (std::size_t k = 0; k < count_; ++k) {
    const Vec3 d = near_[k].at - foot;
    if (!tells(near_[k], d)) continue;
    exact.add(d.dot(u), d.dot(v));
    widest_sq = std::max(widest_sq, near_[k].reach_sq);
  }
  if (!exact.open()) return true;
  for (std::size_t k = 0; k < count_; ++k) {
    if (kStepSq * near_[k].reach_sq > widest_sq) continue;
    const Vec3 d = near_[k].at - foot;
    if (tells({d, widest_sq}, d)) exact.add(d.dot(u), d.dot(v));
  }
  return !exact.open();
}

}  // namespace palpate::render
