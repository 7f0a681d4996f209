
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "toolkit/spline_sdf/point_interior.h"

namespace palpate::spline_sdf {
namespace {

/// A point counts for a surface place within kInfluenceSpacings of its spacings, and at most this share of
/// that off its tangent plane.
constexpr double kOffPlane = 0.5;
constexpr int kMinNear = 4;
/// Squared ratio of spacings that marks a density step (chance varies a cell's spacing by a quarter, not a
/// half). Dense points end farther from a place among sparse ones than their own spacing suggests; gaps
/// allowed between sparse points are allowed there too.
constexpr double kStepSq = 4.0;
/// Points within this range (about twelve, and others of their cells) usually decide. Affects speed only.
constexpr double kNearestSpacings = 2.0;

/// The octant of a direction in the plane, as a bit; none unless the point tells. Half of the points do, in
/// no order: a branch would be mispredicted.
unsigned eighth_of(double a, double b, bool tells) {
  // Indexed by the signs of a and b and whether |a| is larger; octants are counted from a's axis.
  constexpr std::array<std::uint8_t, 16> kEighth{
      0, 0, 0, 0, 0, 0, 0, 0, 1u << 1, 1u << 0, 1u << 6, 1u << 7, 1u << 2, 1u << 3, 1u << 5, 1u << 4};
  const double x = std::abs(a), y = std::abs(b);
  const bool beside = static_cast<bool>(static_cast<unsigned>(tells) & static_cast<unsigned>(x + y > 0.0));
  return kEighth[static_cast<unsigned>(beside) << 3 | static_cast<unsigned>(a < 0.0) << 2 |
                 static_cast<unsigned>(b < 0.0) << 1 | static_cast<unsigned>(x > y)];
}

/// Per set of octants: no two adjacent ones are empty, so no empty angle exceeds three octants.
constexpr std::array<bool, 256> kAllAround = [] {
  std::array<bool, 256> all{};
  for (unsigned seen = 0; seen < 256; ++seen) {
    const unsigned empty = ~seen & 255u, next = (empty >> 1 | empty << 7) & 255u;
    all[seen] = (empty & next) == 0;
  }
  return all;
}();

}  // namespace

void InteriorTest::begin(const MortonPoints& points, const Vec3& middle, double reach_mm, double spacing) {
  points_ = &points;
  middle_ = middle;
  reach_mm_ = reach_mm;
  spacing_ = spacing;
  gathered_ = false;
}

double InteriorTest::reach_sq(std::uint32_t point) const {
  const double own = kInfluenceSpacings * std::min(points_->spacing_near(point), spacing_);
  return own * own;
}

void InteriorTest::gather() {
  const double radius = reach_mm_ + kInfluenceSpacings * spacing_, radius_sq = radius * radius;
  count_ = 0;
  gathered_ = true;
  points_->visit_runs_near_ball(middle_, radius, [&](std::uint32_t first, std::uint32_t past) {
    // As Ball::gather(): points outside are overwritten.
    const std::size_t most = count_ + (past - first);
    if (near_.size() < most) near_.resize(std::max(most, 2 * near_.size()));
    for (std::uint32_t i = first; i < past; ++i) {
      const Vec3 d = (*points_)[i] - middle_;
      near_[count_] = {d, reach_sq(i)};
      count_ += d.squaredNorm() <= radius_sq ? std::size_t{1} : std::size_t{0};
    }
  });
}

/// True if the nearest points surround a place; then all do.
bool InteriorTest::nearest_points_surround(const Vec3& closest, const Vec3& n, const Vec3& u,
                                           const Vec3& v) const {
  const Vec3 place = middle_ + closest;
  int count = 0;
  unsigned seen = 0;
  bool all = false;
  // Copies, which no write can change: registers hold them.
  const Vec3 normal = n, first_axis = u, second_axis = v;
  points_->visit_runs_near_ball(
      place, kNearestSpacings * spacing_, [&](std::uint32_t first, std::uint32_t past) {
        int told = 0;
        unsigned sides = 0;
        for (std::uint32_t i = first; i < past; ++i) {
          const Vec3 d = (*points_)[i] - place;
          const double along = d.dot(normal), most = reach_sq(i);
          const bool tells = (d.squaredNorm() <= most) & (along * along <= kOffPlane * kOffPlane * most);
          told += tells ? 1 : 0;
          sides |= eighth_of(d.dot(first_axis), d.dot(second_axis), tells);
        }
        count += told;
        seen |= sides;
        return all = count >= kMinNear && kAllAround[seen];
      });
  return all;
}

bool InteriorTest::is_interior(const Vec3& closest, const Vec3& n) {
  const Vec3 axis = std::abs(n.x()) < std::abs(n.y()) ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 u = n.cross(axis).normalized(), v = n.cross(u);
  if (nearest_points_surround(closest, n, u, v)) return true;
  if (!gathered_) gather();
  const auto tells = [&](const Near& p, const Vec3& d) {
    const double along = d.dot(n);
    return d.squaredNorm() <= p.reach_sq && along * along <= kOffPlane * kOffPlane * p.reach_sq;
  };
  int count = 0;
  SectorMask exact;
  double widest_sq = 0.0;
  for (std::size_t k = 0; k < count_; ++k) {
    const Vec3 d = near_[k].at - closest;
    if (!tells(near_[k], d)) continue;
    exact.add(d.dot(u), d.dot(v));
    ++count;
    widest_sq = std::max(widest_sq, near_[k].reach_sq);
  }
  if (count < kMinNear) return false;
  if (!exact.open()) return true;
  for (std::size_t k = 0; k < count_; ++k) {
    if (kStepSq * near_[k].reach_sq > widest_sq) continue;
    const Vec3 d = near_[k].at - closest;
    if (tells({d, widest_sq}, d)) exact.add(d.dot(u), d.dot(v));
  }
  return !exact.open();
}

}  // namespace palpate::spline_sdf
