#include "baselines/renderers/facet_walk.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate::baselines {
namespace {

/// Distance to a wall in rounding bounds, so that the god object is provably in front.
constexpr double kWallRoundings = 16.0;
/// Walls that hold at once: a facet's plane and three others; one more for a bent wall.
constexpr std::size_t kMaxWalls = 4;
/// Walls met by one move: each of those, and each once replaced by its neighbour.
constexpr int kWallTries = 2 * kMaxWalls;
/// Radius of a corner in wall distances: the strip along a wall past a vertex is no wider.
constexpr double kAtCorner = 4.0;
/// Distance just off a sheet in wall distances: above rounding, nearer than any wall there.
constexpr double kJustOff = 1.0 / 8.0;
/// Most facets without area crossed at once; a flight crosses the rare longer chains.
constexpr std::size_t kMaxFlat = 32;
/// A triangle cut by four planes has at most seven corners.
constexpr std::size_t kMaxPolygon = 8;
/// Tag of polygon edges on a wall; 0, 1, 2 are the facet's edges.
constexpr std::uint32_t kWallEdge = 3;

struct Wall {
  Vec3 normal;  ///< unit, towards the god object
  double offset;
  std::uint32_t facet;
};

struct Polygon {
  std::array<Vec3, kMaxPolygon> corner;
  std::array<std::uint32_t, kMaxPolygon> edge;  ///< tag of the edge from corner i to i + 1
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

/// Feature of the facet at a place on a polygon edge of this tag, for walking on beyond it.
Feature feature_at(const Facet& f, std::uint32_t tag, const Vec3& place, double near) noexcept {
  if (tag == kWallEdge) return kInside;
  for (const std::uint32_t corner : {tag, after(tag)})
    if ((place - f.corner[corner]).squaredNorm() <= near * near)
      return static_cast<Feature>(kCorner + corner);
  return static_cast<Feature>(kEdge + tag);
}

/// Closest point to p of a convex polygon on facet f, with its feature of f.
FacetPoint closest_on_polygon(const Facet& f, const Polygon& polygon, const Vec3& normal, const Vec3& p,
                              double near) noexcept {
  FacetPoint best{Vec3::Zero(), HUGE_VAL, kInside};
  if (polygon.size == 0) return best;
  const Vec3 q = p - normal * normal.dot(p - polygon.corner[0]);
  bool inside = polygon.size > 2;
  for (std::size_t i = 0; i < polygon.size; ++i) {
    const std::size_t next = (i + 1) % polygon.size;
    const Vec3& a = polygon.corner[i];
    const Vec3 ab = polygon.corner[next] - a;
    if (normal.dot(ab.cross(q - a)) < 0.0) inside = false;
    const double length_sq = ab.squaredNorm();
    const double t = length_sq > 0.0 ? std::fmin(1.0, std::fmax(0.0, ab.dot(p - a) / length_sq)) : 0.0;
    const Vec3 at = a + ab * t;
    const double d = (p - at).squaredNorm();
    if (!(d < best.distance_sq)) continue;
    // A polygon corner ends two edges: prefers the facet's own, over which the walk may go on.
    std::uint32_t tag = polygon.edge[i];
    if (tag == kWallEdge && t == 0.0) tag = polygon.edge[(i + polygon.size - 1) % polygon.size];
    if (tag == kWallEdge && t == 1.0) tag = polygon.edge[next];
    best = {at, d, feature_at(f, tag, at, near)};
  }
  if (inside) return {q, (p - q).squaredNorm(), kInside};
  return best;
}

/// Whether two walls form one surface bent away from the god object, which may pass around the bend: only the
/// later wall counts.
bool bent_away(const SurfaceMesh& mesh, const Wall& a, const Wall& b) noexcept {
  if (!share_vertex(mesh.facet(a.facet), mesh.facet(b.facet))) return false;
  const auto behind = [&](const Wall& wall, std::uint32_t other) {
    for (const Vec3& corner : mesh.facet(other).corner)
      if (wall.normal.dot(corner) > wall.offset) return false;  // the offset lies one wall distance in front
    return true;
  };
  return behind(a, b.facet) && behind(b, a.facet);
}

/// Closest point of a crossing facet reachable from `from` without passing walls; infinitely far if none is.
FacetPoint reach_behind_walls(const SurfaceMesh& mesh, const Crossings& crossings, HalfFacet half,
                              const Vec3& from, const Vec3& hip, FacetPoint target) noexcept {
  const Facet& f = mesh.facet(facet_of(half));
  const double keep = wall_distance_mm(mesh);
  const Vec3 normal = mesh.normal(half_facet(facet_of(half), 0));
  std::array<Wall, kMaxWalls> walls;
  std::size_t count = 0;
  for (int attempt = 0; attempt < kWallTries; ++attempt) {
    double fraction = 1.0;
    const std::uint32_t met = first_wall(mesh, crossings, half, from, target.point, &fraction);
    if (met == kNoFacet) return target;
    Wall wall{mesh.normal(half_facet(met, 0)), 0.0, met};
    const Vec3& on_wall = mesh.facet(met).corner[0];
    if (wall.normal.dot(from - on_wall) < 0.0) wall.normal = -wall.normal;
    wall.offset = wall.normal.dot(on_wall) + keep;
    std::size_t slot = count;
    for (std::size_t i = 0; i < count; ++i)
      if (bent_away(mesh, walls[i], wall)) slot = i;
    if (slot == walls.size()) break;
    walls[slot] = wall;
    if (slot == count) ++count;
    Polygon polygon;
    for (std::uint32_t i = 0; i < 3; ++i) polygon.add(f.corner[i], i);
    for (std::size_t i = 0; i < count; ++i) polygon = cut(polygon, walls[i]);
    target = closest_on_polygon(f, polygon, normal, hip, kAtCorner * keep);
    if (target.distance_sq == HUGE_VAL) break;
  }
  return {from, HUGE_VAL, kInside};
}

/// visit(half-facet) for facets behind those without area around `at`, where nothing is nearer.
template <class Visit>
void beyond_flat(const SurfaceMesh& mesh, const SurfacePosition& at, Visit&& visit) noexcept {
  std::array<HalfFacet, kMaxFlat> flat;
  std::size_t count = 0;
  const auto note = [&](HalfFacet half) noexcept {
    if (count == flat.size() || mesh.normal(half) != Vec3::Zero()) return;
    if (std::find(flat.begin(), flat.begin() + static_cast<std::ptrdiff_t>(count), half) ==
        flat.begin() + static_cast<std::ptrdiff_t>(count))
      flat[count++] = half;
  };
  note(at.half);
  for_facets_at(mesh, at, note);
  for (std::size_t i = 0; i < count; ++i)
    for (std::uint32_t e = 0; e < 3; ++e) {
      const HalfFacet over = mesh.neighbour(flat[i], e);
      if (over == kNoFacet) continue;
      if (mesh.normal(over) == Vec3::Zero())
        note(over);
      else
        visit(over);
    }
}

}  // namespace

Vec3 just_off(const SurfaceMesh& mesh, const SurfacePosition& at) noexcept {
  const double keep = wall_distance_mm(mesh);
  Vec3 away = mesh.normal(at.half);
  for_facets_at(mesh, at, [&](HalfFacet other) noexcept { away += mesh.normal(other); });
  const double length = away.norm();
  return length > 0.0 ? Vec3(at.point + away * (kJustOff * keep / length)) : at.point;
}

double wall_distance_mm(const SurfaceMesh& mesh) noexcept {
  return kWallRoundings * mesh.rounding_mm();
}

bool in_front(const SurfaceMesh& mesh, std::uint32_t other, HalfFacet half) noexcept {
  const Vec3 n = mesh.normal(half);
  const Vec3& on = mesh.facet(facet_of(half)).corner[0];
  if (n == Vec3::Zero()) return true;
  for (const Vec3& corner : mesh.facet(other).corner)
    if (n.dot(corner - on) > wall_distance_mm(mesh)) return true;
  return false;
}

std::uint32_t first_wall(const SurfaceMesh& mesh, const Crossings& crossings, HalfFacet half,
                         const Vec3& from, const Vec3& to, double* fraction) noexcept {
  const double keep = wall_distance_mm(mesh);
  std::uint32_t first = kNoFacet;
  for (const std::uint32_t other : crossings.of(facet_of(half))) {
    const Facet& f = mesh.facet(other);
    Vec3 n = mesh.normal(half_facet(other, 0));
    double before = n.dot(from - f.corner[0]), behind = n.dot(to - f.corner[0]);
    if (before < 0.0) {
      before = -before;
      behind = -behind;
    }
    // Piercing: the end is nearer than half the kept distance. Starting and ending in front is not.
    if (behind >= keep / 2 || before <= behind) continue;
    const double t = std::fmin(1.0, before / (before - behind));
    if (first != kNoFacet && t >= *fraction) continue;
    const Vec3 at = from + (to - from) * t;
    if (closest_on_facet(f, at).distance_sq > kAtWall * kAtWall * keep * keep) continue;
    if (!in_front(mesh, other, half)) continue;
    first = other;
    *fraction = t;
  }
  return first;
}

FacetPoint closest_point_before_walls(const SurfaceMesh& mesh, const Crossings* crossings, HalfFacet half,
                                      const Vec3& from, const Vec3& place) noexcept {
  const FacetPoint free = closest_on_facet(mesh.facet(facet_of(half)), place);
  if (crossings == nullptr || crossings->of(facet_of(half)).empty()) return free;
  const FacetPoint held = reach_behind_walls(mesh, *crossings, half, from, place, free);
  return held.distance_sq < HUGE_VAL ? held : free;
}

SlideCount slide(const SurfaceMesh& mesh, const Crossings* crossings, const Vec3& hip,
                 SurfacePosition& at) noexcept {
  SlideCount count;
  const auto crossed = [&](HalfFacet half) noexcept {
    return crossings != nullptr && !crossings->of(facet_of(half)).empty();
  };
  const auto reach = [&](HalfFacet half, const Vec3& from) noexcept {
    ++count.looked_at;
    const FacetPoint free = closest_on_facet(mesh.facet(facet_of(half)), hip);
    return crossed(half) ? reach_behind_walls(mesh, *crossings, half, from, hip, free) : free;
  };
  const auto take = [&](HalfFacet half, const FacetPoint& p) noexcept {
    at = {half, p.feature, p.point, p.distance_sq};
  };
  if (const FacetPoint here = reach(at.half, at.point); here.distance_sq < HUGE_VAL)
    take(at.half, here);
  else
    take(at.half, {at.point, (hip - at.point).squaredNorm(), kInside});
  while (count.looked_at < kMaxFacetsPerFrame) {
    HalfFacet best = kNoFacet;
    FacetPoint target;
    target.distance_sq = at.distance_sq;
    const auto consider_from = [&](HalfFacet half, const Vec3& from) noexcept {
      const FacetPoint p = reach(half, from);
      if (p.distance_sq < target.distance_sq) {
        target = p;
        best = half;
      }
    };
    const auto consider = [&](HalfFacet half) noexcept { consider_from(half, at.point); };
    if (at.feature >= kCorner) {
      mesh.around_corner(at.half, static_cast<std::uint32_t>(at.feature - kCorner), consider);
    } else if (at.feature >= kEdge) {
      if (const HalfFacet over = mesh.neighbour(at.half, static_cast<std::uint32_t>(at.feature - kEdge));
          over != kNoFacet)
        consider(over);
    }
    if (best == kNoFacet && mesh.counts().flat_facets > 0) beyond_flat(mesh, at, consider);
    if (best == kNoFacet && crossed(at.half)) {
      // Walls are searched anew from every place. A holding wall may lead on along itself.
      consider(at.half);
      const Vec3 eye = just_off(mesh, at);
      walls_at(mesh, crossings, at, [&](HalfFacet wall) noexcept { consider_from(wall, eye); });
    }
    if (best == kNoFacet) return count;
    count.moves += best != at.half;
    take(best, target);
  }
  count.finished = false;
  return count;
}

namespace {

/// Most facets at one place that are examined for planes.
constexpr std::size_t kMaxMeeting = 64;
struct Meeting {
  std::array<HalfFacet, kMaxMeeting> half{};
  std::size_t size = 0;
  void add(HalfFacet h) noexcept {
    if (size < half.size()) half[size++] = h;
  }
};

Meeting meeting_at(const SurfaceMesh& mesh, const SurfacePosition& at) noexcept {
  Meeting meeting;
  meeting.add(at.half);
  if (mesh.is_free_edge(at.half, at.feature)) return meeting;
  for_facets_at(mesh, at, [&](HalfFacet half) noexcept { meeting.add(half); });
  return meeting;
}

/// Whether all facets there lie on the half-facet's free side or in its plane.
bool bounds(const SurfaceMesh& mesh, HalfFacet half, const Meeting& meeting) noexcept {
  const Vec3 n = mesh.normal(half);
  const Vec3& on = mesh.facet(facet_of(half)).corner[0];
  const double clear = wall_distance_mm(mesh);
  for (std::size_t i = 0; i < meeting.size; ++i)
    for (const Vec3& corner : mesh.facet(facet_of(meeting.half[i])).corner)
      if (n.dot(corner - on) < -clear) return false;
  return n != Vec3::Zero();
}

}  // namespace

ContactPlanes::ContactPlanes(const SurfaceMesh& mesh, const Crossings* crossings, const SurfacePosition& at,
                             const Vec3& probe) noexcept
    : pull_(at.point - probe) {
  const Meeting meeting = meeting_at(mesh, at);
  for (std::size_t i = 0; i < meeting.size; ++i)
    if (bounds(mesh, meeting.half[i], meeting)) add(mesh.normal(meeting.half[i]));
  if (size_ == 0) {
    bool boundary = false;
    const Vec3 n = mesh.pseudonormal(at.half, at.feature, &boundary);
    if (n != Vec3::Zero()) add(n);
  }
  walls_at(mesh, crossings, at, [&](HalfFacet wall) noexcept { add(mesh.normal(wall)); });
}

void ContactPlanes::add(const Vec3& normal) noexcept {
  if (size_ < normal_.size()) {
    normal_[size_++] = normal;
    return;
  }
  std::size_t least = size_;
  double depth = normal.dot(pull_);
  for (std::size_t i = 0; i < size_; ++i) {
    if ((normal_[i] - normal).norm() < geometry::kMinIndependence) return;
    if (normal_[i].dot(pull_) < depth) {
      depth = normal_[i].dot(pull_);
      least = i;
    }
  }
  if (least < size_) normal_[least] = normal;
}

Vec3 ContactPlanes::allowed_motion(const Vec3& way) const noexcept {
  std::array<geometry::HalfSpace, render::kMaxPlanesPerTouch> planes;
  for (std::size_t i = 0; i < size_; ++i) planes[i] = {normal_[i], 0.0};
  return geometry::nearest_feasible(std::span(planes).first(size_), way, render::kJointSlack * way.norm())
      .point;
}

bool is_on_other_sheet(const SurfaceMesh& mesh, const Crossings* crossings,
                       const SurfacePosition& at) noexcept {
  bool any = false;
  walls_at(mesh, crossings, at, [&](HalfFacet) noexcept { any = true; });
  return any;
}

}  // namespace palpate::baselines
