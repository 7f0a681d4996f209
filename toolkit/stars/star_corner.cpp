// Sheets of one cloud that cross: a floor and a wall that goes on below it. They share no points, so that no
// walk over edges leads from one to the other; the god object's own way tells when it would go through
// another sheet.
#include <algorithm>
#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/half_spaces.h"
#include "toolkit/stars/star_contact.h"

namespace palpate::stars {
namespace {

/// What turns by less than 30 degrees from a sheet that holds already is taken for a part of it: cos^2.
constexpr double kSameSheet = 0.75;
/// Planes of one sheet, at most.
constexpr std::size_t kMaxPlanes = 16;
/// Violation of a plane that rounding may leave, as a share of the coordinates.
constexpr double kHeldSlack = 64.0 * kUnitRoundoff;

bool is_part(const Facet& held, const Vec3& normal) noexcept {
  const Vec3 n = held.area_normal();
  const double along = n.dot(normal);
  return along * along > kSameSheet * n.squaredNorm() * normal.squaredNorm();
}

/// The planes of all sheets, each with its sheet's number.
struct Planes {
  std::array<geometry::HalfSpace, kMaxHeld * kMaxPlanes> plane;
  std::array<std::size_t, kMaxHeld * kMaxPlanes> owner{};
  std::size_t size = 0;

  /// Of the facets that hold a place near the foot: one, or those of an edge or corner that is concave seen
  /// from the touched side.
  void add(const StarMesh& mesh, const StarContact::Held& held, const Vec3& at, std::size_t number) noexcept {
    const std::size_t most = size + kMaxPlanes;
    const auto take = [&](const Facet& facet) noexcept {
      const Vec3 n = facet.area_normal();
      const double length = n.norm();
      if (!(length > 0.0) || size == most) return;
      const Vec3 outward = n * (held.side / length);
      owner[size] = number;
      plane[size++] = {outward, outward.dot(facet.corner[0])};
    };
    const Vec3 off = at - held.stand.foot.point;
    if (held.side * side_of(mesh, held.stand, at).height < 0.0 && off != Vec3::Zero())
      for_facets_at(mesh, held.stand, take);
    else
      take(held.stand.facet);
  }
};

}  // namespace

bool StarContact::follow_alone(const Vec3& h, StarCounters& counters) noexcept {
  const Stand before = stand_;
  const double side_before = side_;
  const bool was_watched = watched_;
  const bool held = follow(h, counters);
  if (!held || !(was_watched || watched_)) return held;
  // What several sheets held may have been on a facet of another than the one that is left: until that one
  // leads as near it stays there. It only descends.
  const Vec3 stood = before.foot.point;
  if (pull_.squaredNorm() > (stood - h).squaredNorm()) {
    stand_ = before;
    side_ = side_before;
    stay_at(stood, h);
    return true;
  }
  Hit hit;
  others_count_ = 1;  // both where it was and where it is now are the sheet's own
  others_[0] = {before, side_before};
  const bool met = meet_other(before.foot.point, h + pull_, counters, hit);
  others_count_ = 0;
  if (!met) return true;
  stand_ = before;
  side_ = side_before;
  others_[0].stand = {};
  others_[0].stand.facet = Facet(*mesh_, hit.place[0], hit.place[1], hit.place[2]);
  others_[0].side = hit.side;
  others_count_ = 1;
  return hold_together(h, counters);
}

bool StarContact::meet_other(const Vec3& from, const Vec3& to, StarCounters& counters, Hit& hit) noexcept {
  if (from == to) return false;
  const geometry::Aabb around{from.cwiseMin(to), from.cwiseMax(to)};
  const Way way{from, to, FloatBox::around(around)};
  std::uint32_t tested = 0;
  const auto takes = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) noexcept {
    if (!is_free(a, b, c, side)) return false;
    const Vec3 normal = Facet(*mesh_, a, b, c).area_normal();
    if (is_part(stand_.facet, normal)) return false;
    return std::none_of(others_.begin(), others_.begin() + others_count_,
                        [&](const Held& held) { return is_part(held.stand.facet, normal); });
  };
  const bool all =
      tree_->for_blocks(around, kMaxNodes, [&](std::uint32_t block, const BoxNode&, std::uint32_t) noexcept {
        pierce_block(*mesh_, *tree_, block, way, hit, tested, takes);
        return tested < kMaxTested;
      });
  counters.tested += tested;
  bound_hit_ = bound_hit_ || !all;
  return hit.place[0] != kNoPlace;
}

bool StarContact::hold_together(const Vec3& h, StarCounters& counters) noexcept {
  std::array<Held, kMaxHeld> held;
  std::size_t count = 0;
  held[count++] = {stand_, side_};
  for (const Held& other : others()) held[count++] = other;
  const Vec3 before = stand_.foot.point;
  const double slack = kHeldSlack * (h.cwiseAbs().maxCoeff() + (before - h).norm());
  Vec3 at = before;
  Planes planes;
  geometry::NearestAllowed found;
  for (int round = 0; round < kHeldRounds; ++round) {
    planes.size = 0;
    for (std::size_t i = 0; i < count; ++i) {
      int moves = kMaxFacetMoves;
      if (!descend(*mesh_, at, held[i].stand, moves)) bound_hit_ = true;
      counters.moves += static_cast<std::uint64_t>(kMaxFacetMoves - moves);
      planes.add(*mesh_, held[i], at, i);
    }
    found = geometry::nearest_allowed({planes.plane.data(), planes.size}, h, slack);
    at = found.point;
  }
  if (found.active > 0) at = on_facet({held.data(), count}, at);
  // It only descends: on rough sheets planes looked up anew may leave no place as near as it is.
  if ((at - h).squaredNorm() > (before - h).squaredNorm()) {
    stay_at(before, h);
    return true;
  }
  // What held so far, held or not from now on, is not met by who leaves it.
  others_count_ = 0;
  stand_ = held[0].stand;
  for (std::size_t i = 1; i < count; ++i) others_[others_count_++] = held[i];
  Hit hit;
  const bool met = meet_other(before, at, counters, hit);
  // A sheet that does not push is met again when the god object comes to it; one whose border is passed ends.
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) {
    bool pushes = false;
    for (std::size_t k = 0; k < found.active; ++k)
      pushes = pushes || (planes.owner[found.plane[k]] == i && found.push[k] > 0.0);
    const Stand& stand = held[i].stand;
    const bool ended = side_of(*mesh_, stand, at).border &&
                       past_border_sq(stand, stand.facet.area_normal(), at) > stand.facet.longest_edge_sq();
    if (pushes && !ended) held[kept++] = held[i];
  }
  if (met && kept < kMaxHeld) {
    Held& other = held[kept++];
    other.stand = {};
    other.stand.facet = Facet(*mesh_, hit.place[0], hit.place[1], hit.place[2]);
    other.side = hit.side;
  }
  others_count_ = 0;
  stand_.foot.point = at;
  framed_ = false;
  if (kept == 0 || at == h) return false;
  stand_ = held[0].stand;
  side_ = held[0].side;
  for (std::size_t i = 1; i < kept; ++i) others_[others_count_++] = held[i];
  stay_at(at, h);
  return true;
}

/// Past a border a plane goes on, a facet does not.
Vec3 StarContact::on_facet(std::span<const Held> held, const Vec3& at) const noexcept {
  Foot nearest;
  for (const Held& sheet : held) {
    Stand stand = sheet.stand;
    int moves = kMaxFacetMoves;
    descend(*mesh_, at, stand, moves);
    if (stand.foot.distance_sq < nearest.distance_sq) nearest = stand.foot;
  }
  return nearest.point;
}

void StarContact::stay_at(const Vec3& at, const Vec3& h) noexcept {
  pull_ = at - h;
  stand_.foot.point = at;
  stand_.foot.distance_sq = pull_.squaredNorm();
  watched_ = true;
  framed_ = false;
}

}  // namespace palpate::stars
