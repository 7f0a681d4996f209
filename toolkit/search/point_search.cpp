#include "toolkit/search/point_search.h"

#include <cmath>
#include <limits>

#include "toolkit/core/tolerances.h"

namespace palpate::search {
namespace {

constexpr double kSearchPointsPerCell = 2.0;  // for a surface over two faces of its box; few enough to scan
constexpr std::int64_t kMaxRings = 24;  // beyond, (2 x 24 + 1)^3 cells: testing every point is no slower
// Two squared distances of three differences, squares and sums, and their sum.
constexpr int kRoundedOperations = 16;

double cell_for_nearest(const geometry::Aabb& box, std::size_t points) {
  const Vec3 extent_mm = box.extent_mm();
  // A surface of n points over an area A has spacing sqrt(A / n); the box's two largest faces estimate A.
  const double area_mm2 =
      extent_mm.x() * extent_mm.y() + extent_mm.y() * extent_mm.z() + extent_mm.z() * extent_mm.x();
  const auto n = static_cast<double>(points);
  // Collinear points have no area: uses the spacing along the line.
  const double cell_mm = std::max(std::sqrt(kSearchPointsPerCell * area_mm2 / n),
                                  kSearchPointsPerCell * extent_mm.maxCoeff() / n);
  return cell_mm > 0.0 ? cell_mm : 1.0;  // coincident points: any size works
}

}  // namespace

PointSearch::PointSearch(const cloud::Cloud& cloud, const geometry::Aabb& local_box, double cell_mm,
                         int threads)
    : cloud_(cloud), local_box_(local_box), grid_(UniformGrid::build(cloud, cell_mm, threads)) {
  order_.assign(grid_.order().begin(), grid_.order().end());
  grid_.drop_order();
  for (std::size_t slot = 0; slot < grid_.slots(); ++slot) {
    const IndexRange places = grid_.places_of(slot);
    std::sort(order_.begin() + places.begin, order_.begin() + places.end);
  }
}

PointSearch::PointSearch(const cloud::Cloud& cloud, double cell_mm, int threads)
    : PointSearch(cloud, local_box(cloud, threads), cell_mm, threads) {}

PointSearch::PointSearch(const cloud::Cloud& cloud, int threads)
    : PointSearch(cloud, cell_for_nearest(local_box(cloud, threads), cloud.size()), threads) {}

std::size_t PointSearch::nearest(const Vec3& p_mm) const {
  const Vec3 p = p_mm - cloud_.origin_mm;
  // The rings grow around the box's nearest place to p.
  const Vec3 inside = p.cwiseMax(local_box_.low_mm).cwiseMin(local_box_.high_mm);
  const double outside_sq = (p - inside).squaredNorm();
  const Cell centre = grid_.cell_of(inside);
  double best_sq = std::numeric_limits<double>::infinity();
  std::size_t best = 0;
  const auto visit = [&](std::size_t i) {
    const double sq = (cloud_.local_mm(i) - p).squaredNorm();
    if (sq < best_sq || (sq == best_sq && i < best)) best_sq = sq, best = i;
  };
  for (std::int64_t ring = 0; ring <= kMaxRings; ++ring) {
    for (std::int64_t dx = -ring; dx <= ring; ++dx) {
      for (std::int64_t dy = -ring; dy <= ring; ++dy) {
        const bool edge = std::max(std::abs(dx), std::abs(dy)) == ring;
        const std::int64_t stride = edge || ring == 0 ? 1 : 2 * ring;  // inside the shell only its two caps
        for (std::int64_t dz = -ring; dz <= ring; dz += stride)
          for (const std::uint32_t i : points_of({centre.x + dx, centre.y + dy, centre.z + dz})) visit(i);
      }
    }
    // Unseen points are farther from `inside` than the rings; from there no point of the box is at an acute
    // angle with p, so the squares add.
    const double seen_mm = std::max(0.0, static_cast<double>(ring) - kCellSlack) * grid_.cell_mm();
    if (best_sq * (1.0 + gamma(kRoundedOperations)) < outside_sq + seen_mm * seen_mm) return best;
  }
  for (std::size_t i = 0; i < cloud_.size(); ++i) visit(i);
  return best;
}

}  // namespace palpate::search
