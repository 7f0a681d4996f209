#include "baselines/renderers/facet_walk.h"

#include <array>
#include <cmath>

namespace palpate::baselines {
namespace {

/// Multiple of the rounding bound that keeps the god object provably in front of a wall.
constexpr double kWallRoundings = 16.0;
/// Walls that one move may meet: two planes beside the facet's own, and each once replaced by its neighbour.
constexpr int kWallTries = 4;
/// Two walls whose normals agree to this cosine are one bent wall: the later replaces the earlier (8
/// degrees).
constexpr double kSameWallCosine = 0.99;
/// A triangle cut by two planes has at most five corners.
constexpr std::size_t kMaxPolygon = 8;
/// Tag of a polygon's edge that lies on a wall; 0, 1, 2 are the facet's own edges.
constexpr std::uint32_t kWallEdge = 3;

struct Wall {
  Vec3 normal;  ///< unit, towards the god object
  double offset;
};

struct Polygon {
  std::array<Vec3, kMaxPolygon> corner;
  std::array<std::uint32_t, kMaxPolygon> edge;  ///< tag of the edge corner i -> i + 1
  std::size_t size = 0;
  void add(const Vec3& p, std::uint32_t tag) noexcept {
    if (size == kMaxPolygon) return;
    corner[size] = p;
    edge[size++] = tag;
  }
};

Polygon cut(const Polygon& in, const Wall& wall) noexcept {
  Polygon out;
  for (std::size_t i = 0; i < in.size; ++i) {
    const Vec3& p = in.corner[i];
    const Vec3& q = in.corner[(i + 1) % in.size];
    const double dp = wall.normal.dot(p) - wall.offset, dq = wall.normal.dot(q) - wall.offset;
    if (dp >= 0.0) out.add(p, in.edge[i]);
    if ((dp >= 0.0) != (dq >= 0.0))
      out.add(p + (q - p) * (dp / (dp - dq)), dp >= 0.0 ? kWallEdge : in.edge[i]);
  }
  return out;
}

/// The point of a convex plane polygon nearest to p, with the facet's feature it lies on.
FacetPoint closest_on_polygon(const Polygon& polygon, const Vec3& normal, const Vec3& p) noexcept {
  FacetPoint best{Vec3::Zero(), HUGE_VAL, kInside};
  if (polygon.size == 0) return best;
  const Vec3 q = p - normal * normal.dot(p - polygon.corner[0]);
  bool inside = polygon.size > 2;
  for (std::size_t i = 0; i < polygon.size; ++i) {
    const Vec3& a = polygon.corner[i];
    const Vec3 ab = polygon.corner[(i + 1) % polygon.size] - a;
    if (normal.dot(ab.cross(q - a)) < 0.0) inside = false;
    const double length_sq = ab.squaredNorm();
    const double t = length_sq > 0.0 ? std::fmin(1.0, std::fmax(0.0, ab.dot(p - a) / length_sq)) : 0.0;
    const Vec3 at = a + ab * t;
    const double d = (p - at).squaredNorm();
    if (d < best.distance_sq)
      best = {at, d, polygon.edge[i] == kWallEdge ? kInside : static_cast<Feature>(kEdge + polygon.edge[i])};
  }
  if (inside) return {q, (p - q).squaredNorm(), kInside};
  return best;
}

/// The nearest point of a facet that crosses others, no further than the walls between it and `from` let one
/// go.
FacetPoint reach_behind_walls(const SurfaceMesh& mesh, const Crossings& crossings, HalfFacet half,
                              const Vec3& from, const Vec3& hip, FacetPoint target) noexcept {
  const std::uint32_t facet = facet_of(half);
  const double keep = wall_distance_mm(mesh);
  const Vec3 normal = mesh.normal(half_facet(facet, 0));
  std::array<Wall, 2> walls;
  std::size_t count = 0;
  for (int attempt = 0; attempt < kWallTries; ++attempt) {
    double fraction = 1.0;
    const std::uint32_t met = first_wall(mesh, crossings, facet, from, target.point, &fraction);
    if (met == kNoFacet) return target;
    Wall wall{mesh.normal(half_facet(met, 0)), 0.0};
    const Vec3& on_wall = mesh.facet(met).corner[0];
    if (wall.normal.dot(from - on_wall) < 0.0) wall.normal = -wall.normal;
    wall.offset = wall.normal.dot(on_wall) + keep;
    std::size_t slot = count < 2 ? count : 1;
    for (std::size_t i = 0; i < count; ++i)
      if (walls[i].normal.dot(wall.normal) > kSameWallCosine) slot = i;
    walls[slot] = wall;
    if (slot == count) ++count;
    Polygon polygon;
    for (std::uint32_t i = 0; i < 3; ++i) polygon.add(mesh.facet(facet).corner[i], i);
    for (std::size_t i = 0; i < count; ++i) polygon = cut(polygon, walls[i]);
    target = closest_on_polygon(polygon, normal, hip);
    if (target.distance_sq == HUGE_VAL) break;
  }
  return {from, (hip - from).squaredNorm(), kInside};
}

}  // namespace

double wall_distance_mm(const SurfaceMesh& mesh) noexcept {
  return kWallRoundings * mesh.rounding_mm();
}

std::uint32_t first_wall(const SurfaceMesh& mesh, const Crossings& crossings, std::uint32_t facet,
                         const Vec3& from, const Vec3& to, double* fraction) noexcept {
  const double keep = wall_distance_mm(mesh);
  std::uint32_t first = kNoFacet;
  for (const std::uint32_t other : crossings.of(facet)) {
    const Facet& f = mesh.facet(other);
    Vec3 n = mesh.normal(half_facet(other, 0));
    double before = n.dot(from - f.corner[0]), behind = n.dot(to - f.corner[0]);
    if (before < 0.0) {
      before = -before;
      behind = -behind;
    }
    // Ending nearer than half the kept distance counts as piercing; starting and ending in front does not.
    if (behind >= keep / 2 || before <= behind) continue;
    const double t = std::fmin(1.0, before / (before - behind));
    if (first != kNoFacet && t >= *fraction) continue;
    const Vec3 at = from + (to - from) * t;
    if (closest_on_facet(f, at).distance_sq > 4 * keep * keep) continue;
    first = other;
    *fraction = t;
  }
  return first;
}

SlideCount slide(const SurfaceMesh& mesh, const Crossings* crossings, const Vec3& hip,
                 SurfacePosition& at) noexcept {
  SlideCount count;
  const auto reach = [&](HalfFacet half) noexcept {
    ++count.looked_at;
    const FacetPoint free = closest_on_facet(mesh.facet(facet_of(half)), hip);
    if (crossings == nullptr || crossings->of(facet_of(half)).empty()) return free;
    return reach_behind_walls(mesh, *crossings, half, at.point, hip, free);
  };
  const auto take = [&](HalfFacet half, const FacetPoint& p) noexcept {
    at = {half, p.feature, p.point, p.distance_sq};
  };
  take(at.half, reach(at.half));
  while (count.looked_at < kMaxFacetsPerFrame) {
    HalfFacet best = kNoFacet;
    FacetPoint target;
    target.distance_sq = at.distance_sq;
    const auto consider = [&](HalfFacet half) noexcept {
      const FacetPoint p = reach(half);
      if (p.distance_sq < target.distance_sq) {
        target = p;
        best = half;
      }
    };
    if (at.feature >= kCorner) {
      mesh.around_corner(at.half, static_cast<std::uint32_t>(at.feature - kCorner), consider);
    } else if (at.feature >= kEdge) {
      if (const HalfFacet over = mesh.neighbour(at.half, static_cast<std::uint32_t>(at.feature - kEdge));
          over != kNoFacet)
        consider(over);
    }
    // Walls are found anew from every place: what held back before may not from here.
    if (best == kNoFacet && crossings != nullptr && !crossings->of(facet_of(at.half)).empty())
      consider(at.half);
    if (best == kNoFacet) return count;
    count.moves += best != at.half;
    take(best, target);
  }
  count.finished = false;
  return count;
}

}  // namespace palpate::baselines
