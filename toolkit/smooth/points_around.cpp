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
constexpr double kGoldenSection = 0.6180340;

/// Points looked at between questions whether they tell: some four of them are near the place.
constexpr std::size_t kAtOnce = 8;

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
  step_ = static_cast<std::size_t>(kGoldenSection * static_cast<double>(count_));
  while (std::gcd(step_, count_) > 1) ++step_;
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
  for (std::size_t k = 0, at = 0; k < count_;) {
    for (const std::size_t past = std::min(k + kAtOnce, count_); k < past; ++k) {
      const Near& p = near_[at];
      at += step_;
      at -= at >= count_ ? count_ : 0;
      const Vec3 d = p.at - foot;
      const double a = d.dot(u), b = d.dot(v);
      const bool near = tells(p, d);
      count += near ? 1 : 0;
      seen |= near && std::abs(a) + std::abs(b) > 0.0 ? eighth_of(a, b) : 0u;
    }
    if (count >= kFewestNear && kAllAround[seen]) return true;
  }
  if (count < kFewestNear) return false;
  Surround exact;
  for (std::size_t k = 0; k < count_; ++k) {
    const Vec3 d = near_[k].at - foot;
    if (tells(near_[k], d)) exact.add(d.dot(u), d.dot(v));
  }
  return !exact.open();
}

}  // namespace palpate::render
