// Crossing sheets of one cloud, such as a floor and a wall that continues below it. They share no points, so
// no walk over edges connects them; the god object's own path tells when it would cross another sheet.
#include <algorithm>
#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/half_space_projection.h"
#include "toolkit/local_delaunay/mesh_contact.h"

namespace palpate::local_delaunay {
namespace {

/// cos^2 of 30 degrees: a smaller turn counts as the same sheet.
constexpr double kSameSheet = 0.75;
/// Most planes per sheet.
constexpr std::size_t kMaxPlanes = 16;
/// Violation of a plane allowed for rounding, as a share of the coordinates.
constexpr double kHeldSlack = 64.0 * kUnitRoundoff;

bool is_part(const Facet& held, const Vec3& normal) noexcept {
  const Vec3 n = held.area_normal();
  const double along = n.dot(normal);
  return along * along > kSameSheet * n.squaredNorm() * normal.squaredNorm();
}

/// The planes of all sheets, with sheet numbers.
struct Planes {
  std::array<geometry::HalfSpace, kMaxSheets * kMaxPlanes> plane;
  std::array<std::size_t, kMaxSheets * kMaxPlanes> owner{};
  std::size_t size = 0;

  /// Adds the facet that holds a place near the closest point, or those of an edge or corner that is concave
  /// from the touched side.
  void add(const LocalDelaunayMesh& mesh, const MeshContact::Held& held, const Vec3& at,
           std::size_t number) noexcept {
    const std::size_t most = size + kMaxPlanes;
    const auto take = [&](const Facet& facet) noexcept {
      const Vec3 n = facet.area_normal();
      const double length = n.norm();
      if (!(length > 0.0) || size == most) return;
      const Vec3 outward = n * (held.side / length);
      owner[size] = number;
      plane[size++] = {outward, outward.dot(facet.corner[0])};
    };
    const Vec3 off = at - held.position.closest.point;
    if (held.side * side_of(mesh, held.position, at).height < 0.0 && off != Vec3::Zero())
      for_facets_at(mesh, held.position, take);
    else
      take(held.position.facet);
  }
};

}  // namespace

bool MeshContact::follow_single_sheet(const Vec3& h, ContactCounters& counters) noexcept {
  const SurfacePosition before = position_;
  const double side_before = side_;
  const bool was_watched = watched_;
  const bool held = follow(h, counters);
  if (!held || !(was_watched || watched_)) return held;
  // The place held by several sheets may lie on a facet of a sheet that left. It stays until the remaining
  // one offers a place as near; distances only fall.
  const Vec3 stood = before.closest.point;
  if (pull_.squaredNorm() > (stood - h).squaredNorm()) {
    position_ = before;
    side_ = side_before;
    stay_at(stood, h);
    return true;
  }
  SegmentHit hit;
  others_count_ = 1;  // both the old and the new place are on this sheet
  others_[0] = {before, side_before};
  const bool met = meet_other_sheet(before.closest.point, h + pull_, counters, hit);
  others_count_ = 0;
  if (!met) return true;
  position_ = before;
  side_ = side_before;
  others_[0].position = {};
  others_[0].position.facet = Facet(*mesh_, hit.place[0], hit.place[1], hit.place[2]);
  others_[0].side = hit.side;
  others_count_ = 1;
  return solve_all_sheets(h, counters);
}

bool MeshContact::meet_other_sheet(const Vec3& from, const Vec3& to, ContactCounters& counters,
                                   SegmentHit& hit) noexcept {
  if (from == to) return false;
  const geometry::Aabb around{from.cwiseMin(to), from.cwiseMax(to)};
  const SegmentQuery way{from, to, FloatBox::around(around)};
  std::uint32_t tested = 0;
  const auto takes = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) noexcept {
    if (!is_free(a, b, c, side)) return false;
    const Vec3 normal = Facet(*mesh_, a, b, c).area_normal();
    if (is_part(position_.facet, normal)) return false;
    return std::none_of(others_.begin(), others_.begin() + others_count_,
                        [&](const Held& held) { return is_part(held.position.facet, normal); });
  };
  const bool all =
      tree_->for_blocks(around, kMaxNodes, [&](std::uint32_t block, const BvhNode&, std::uint32_t) noexcept {
        intersect_block(*mesh_, *tree_, block, way, hit, tested, takes);
        return tested < kMaxTestedTriangles;
      });
  counters.tested += tested;
  bound_hit_ = bound_hit_ || !all;
  return hit.place[0] != kNoPlace;
}

bool MeshContact::solve_all_sheets(const Vec3& h, ContactCounters& counters) noexcept {
  std::array<Held, kMaxSheets> held;
  std::size_t count = 0;
  held[count++] = {position_, side_};
  for (const Held& other : others()) held[count++] = other;
  const Vec3 before = position_.closest.point;
  const double slack = kHeldSlack * (h.cwiseAbs().maxCoeff() + (before - h).norm());
  Vec3 at = before;
  Planes planes;
  geometry::NearestFeasible found;
  for (int round = 0; round < kHeldRounds; ++round) {
    planes.size = 0;
    for (std::size_t i = 0; i < count; ++i) {
      int moves = kMaxFacetMoves;
      if (!descend(*mesh_, at, held[i].position, moves)) bound_hit_ = true;
      counters.moves += static_cast<std::uint64_t>(kMaxFacetMoves - moves);
      planes.add(*mesh_, held[i], at, i);
    }
    found = geometry::nearest_feasible({planes.plane.data(), planes.size}, h, slack);
    at = found.point;
  }
  if (found.active > 0) at = on_facet({held.data(), count}, at);
  // Distances only fall: on rough sheets new planes may leave no place as near.
  if ((at - h).squaredNorm() > (before - h).squaredNorm()) {
    stay_at(before, h);
    return true;
  }
  // A sheet that held the god object, still or not, is not met again when leaving it.
  others_count_ = 0;
  position_ = held[0].position;
  for (std::size_t i = 1; i < count; ++i) others_[others_count_++] = held[i];
  SegmentHit hit;
  const bool met = meet_other_sheet(before, at, counters, hit);
  // A sheet that does not push is dropped and met again later; one past its border ends.
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) {
    bool pushes = false;
    for (std::size_t k = 0; k < found.active; ++k)
      pushes = pushes || (planes.owner[found.plane[k]] == i && found.push[k] > 0.0);
    const SurfacePosition& position = held[i].position;
    const bool ended =
        side_of(*mesh_, position, at).border &&
        past_border_sq(position, position.facet.area_normal(), at) > position.facet.longest_edge_sq();
    if (pushes && !ended) held[kept++] = held[i];
  }
  if (met && kept < kMaxSheets) {
    Held& other = held[kept++];
    other.position = {};
    other.position.facet = Facet(*mesh_, hit.place[0], hit.place[1], hit.place[2]);
    other.side = hit.side;
  }
  others_count_ = 0;
  position_.closest.point = at;
  framed_ = false;
  if (kept == 0 || at == h) return false;
  position_ = held[0].position;
  side_ = held[0].side;
  for (std::size_t i = 1; i < kept; ++i) others_[others_count_++] = held[i];
  stay_at(at, h);
  return true;
}

/// Planes continue past a border; facets do not.
Vec3 MeshContact::on_facet(std::span<const Held> held, const Vec3& at) const noexcept {
  ClosestPoint nearest;
  for (const Held& sheet : held) {
    SurfacePosition position = sheet.position;
    int moves = kMaxFacetMoves;
    descend(*mesh_, at, position, moves);
    if (position.closest.distance_sq < nearest.distance_sq) nearest = position.closest;
  }
  return nearest.point;
}

void MeshContact::stay_at(const Vec3& at, const Vec3& h) noexcept {
  pull_ = at - h;
  position_.closest.point = at;
  position_.closest.distance_sq = pull_.squaredNorm();
  watched_ = true;
  framed_ = false;
}

}  // namespace palpate::local_delaunay
