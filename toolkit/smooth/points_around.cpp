#include "toolkit/smooth/points_around.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "toolkit/smooth/surround.h"

namespace palpate::render {
namespace {

/// A point has a say in whether a place of the surface is between points where it is within kTellsSpacings of
/// its spacings of it, and at most this share of that off its tangent plane.
constexpr double kOffPlane = 0.5;
constexpr int kFewestNear = 4;
constexpr double kGoldenSection = 0.6180340;

}  // namespace

void PointsAround::gather(const SmoothPoints& points, const Vec3& middle, double reach_mm, double spacing) {
  gathered_.clear();
  points.in_ball(middle, reach_mm + kTellsSpacings * spacing, [&](std::uint32_t i, const Vec3& d, double) {
    const double own = kTellsSpacings * std::min(points.spacing_near(i), spacing);
    gathered_.push_back({d, own * own});
  });
  // In steps of the golden section: the first few are from all around, and mostly tell.
  near_.clear();
  const std::size_t count = gathered_.size();
  auto step = static_cast<std::size_t>(kGoldenSection * static_cast<double>(count));
  while (std::gcd(step, count) > 1) ++step;
  for (std::size_t i = 0, at = 0; i < count; ++i, at = (at + step) % count) near_.push_back(gathered_[at]);
}

bool PointsAround::are_around(const Vec3& foot, const Vec3& n) const {
  const Vec3 axis = std::abs(n.x()) < std::abs(n.y()) ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 u = n.cross(axis).normalized(), v = n.cross(u);
  Surround seen;
  int count = 0;
  for (const Near& p : near_) {
    const Vec3 d = p.at - foot;
    const double sq = d.squaredNorm(), along = d.dot(n);
    if (sq > p.reach_sq || along * along > kOffPlane * kOffPlane * p.reach_sq) continue;
    seen.add(d.dot(u), d.dot(v));
    if (++count >= kFewestNear && !seen.open()) return true;
  }
  return false;
}

}  // namespace palpate::render
