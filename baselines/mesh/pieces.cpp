#include "baselines/mesh/pieces.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "toolkit/core/disjoint_sets.h"

namespace palpate::baselines {
namespace {

/// Facets a chunk; along a Morton curve few have neighbours in other chunks. Constant, because it decides
/// where a non-orientable piece disagrees.
constexpr std::size_t kFacetsPerChunk = 16384;

/// The only neighbour over edge `e` of a facet, seen from side 0; kNoFacet if there are several or none.
HalfFacet only_neighbour(const SurfaceMesh& mesh, std::uint32_t facet, std::uint32_t e) noexcept {
  const HalfFacet next = mesh.neighbour(half_facet(facet, 0), e);
  if (next == kNoFacet || facet_of(next) == facet) return kNoFacet;
  return facet_of(mesh.neighbour(half_facet(facet, 1), e)) == facet_of(next) ? next : kNoFacet;
}

/// A pair of facets in one piece across a chunk border, and whether their orientations differ.
struct Link {
  std::uint32_t facet, other, flipped;
};

/// Joins the facets of one chunk; collects links to earlier chunks.
void join_chunk(const SurfaceMesh& mesh, std::uint32_t begin, std::uint32_t end, OrientedDisjointSets& sets,
                std::vector<Link>& links) {
  for (std::uint32_t facet = begin; facet < end; ++facet)
    for (std::uint32_t e = 0; e < 3; ++e) {
      const HalfFacet next = only_neighbour(mesh, facet, e);
      if (next == kNoFacet || facet_of(next) > facet) continue;
      if (facet_of(next) < begin)
        links.push_back({facet, facet_of(next), side_of(next)});
      else
        sets.join(facet, facet_of(next), side_of(next));
    }
}

/// Numbers sets by their first members.
std::vector<std::uint32_t> numbered(OrientedDisjointSets& sets, std::size_t members, std::size_t& count) {
  std::vector<std::uint32_t> number(members);
  for (std::uint32_t i = 0; i < members; ++i) {
    const std::uint32_t first = sets.find(i).set;  // not after i
    number[i] = first == i ? static_cast<std::uint32_t>(count++) : number[first];
  }
  return number;
}

/// Frees arrays that carry no information, as for most meshes; frames then skip the lookup.
void free_trivial_arrays(Pieces& pieces) {
  if (pieces.count <= 1) std::vector<std::uint32_t>().swap(pieces.number);
  if (std::find(pieces.flipped.begin(), pieces.flipped.end(), 1) == pieces.flipped.end())
    std::vector<std::uint8_t>().swap(pieces.flipped);
}

}  // namespace

Pieces pieces_of(const SurfaceMesh& mesh, int threads) {
  const std::size_t facets = mesh.facets().size();
  OrientedDisjointSets sets(facets, threads);
  const auto join = [&](std::size_t begin, std::size_t end, std::vector<Link>& later) {
    join_chunk(mesh, static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end), sets, later);
  };
  for (const Link& link : parallel_list<Link>(facets, kFacetsPerChunk, threads, join))
    sets.join(link.facet, link.other, link.flipped);
  Pieces pieces;
  pieces.number = numbered(sets, facets, pieces.count);
  for (std::uint32_t i = 0; i < facets; ++i)
    pieces.flipped.push_back(static_cast<std::uint8_t>(sets.find(i).flipped));
  free_trivial_arrays(pieces);
  return pieces;
}

Pieces pieces_across_many(const SurfaceMesh& mesh) {
  Pieces pieces;
  const std::size_t facets = mesh.facets().size();
  pieces.number.assign(facets, kNoFacet);
  pieces.flipped.assign(facets, 0);
  std::vector<std::uint32_t> open;
  for (std::uint32_t start = 0; start < facets; ++start) {
    if (pieces.number[start] != kNoFacet) continue;
    const auto number = static_cast<std::uint32_t>(pieces.count++);
    pieces.number[start] = number;
    open.push_back(start);
    while (!open.empty()) {
      const std::uint32_t facet = open.back();
      open.pop_back();
      for (std::uint32_t e = 0; e < 3; ++e) {
        const HalfFacet next = mesh.neighbour(half_facet(facet, pieces.flipped[facet]), e);
        if (next == kNoFacet || pieces.number[facet_of(next)] != kNoFacet) continue;
        pieces.number[facet_of(next)] = number;
        pieces.flipped[facet_of(next)] = static_cast<std::uint8_t>(side_of(next));
        open.push_back(facet_of(next));
      }
    }
  }
  free_trivial_arrays(pieces);
  return pieces;
}

std::vector<std::uint32_t> components_of(const SurfaceMesh& mesh) {
  const std::size_t facets = mesh.facets().size();
  OrientedDisjointSets sets(facets);
  for (HalfFacet half = 0; half < 2 * facets; ++half)
    for (std::uint32_t e = 0; e < 3; ++e)
      if (const HalfFacet next = mesh.neighbour(half, e); next != kNoFacet)
        sets.join(facet_of(half), facet_of(next));
  std::size_t count = 0;
  return numbered(sets, facets, count);
}

namespace {

/// The area vectors of a closed surface cancel; up to this share of the total counts as holes.
constexpr double kClosedShare = 0.1;

struct Sums {
  double area = 0.0, volume = 0.0;
  Vec3 vector_area = Vec3::Zero(), moment = Vec3::Zero();

  void add(const Facet& facet, std::uint32_t side) noexcept {
    const Vec3 a = side == 0 ? facet.scaled_normal() : Vec3(-facet.scaled_normal());
    const double size = a.norm();
    area += size;
    vector_area += a;
    volume += a.dot(facet.corner[0]);
    moment += size * facet.corner[0];
  }
  void add(const Sums& other) noexcept {
    area += other.area;
    volume += other.volume;
    vector_area += other.vector_area;
    moment += other.moment;
  }
};

/// Sums of one piece over fixed chunks.
Sums sums_of_one(const SurfaceMesh& mesh, const Pieces& pieces, int threads) {
  const std::size_t facets = mesh.facets().size();
  const auto add = [&](std::size_t i, Sums& sums) {
    const auto facet = static_cast<std::uint32_t>(i);
    sums.add(mesh.facet(facet), pieces.side(facet));
  };
  Sums all;
  for (const Sums& part : parallel_parts<Sums>(facets, kPointsPerChunk, threads, add)) all.add(part);
  return all;
}

std::vector<Sums> sums_of(const SurfaceMesh& mesh, const Pieces& pieces, int threads) {
  if (pieces.count == 1) return {sums_of_one(mesh, pieces, threads)};
  std::vector<Sums> sums(pieces.count);
  for (std::uint32_t i = 0; i < mesh.facets().size(); ++i)
    sums[pieces.piece_of(i)].add(mesh.facet(i), pieces.side(i));
  return sums;
}

}  // namespace

PieceOrientation PieceOrientation::of(const SurfaceMesh& mesh, int threads) {
  PieceOrientation sides;
  sides.pieces = pieces_of(mesh, threads);
  for (const Sums& sum : sums_of(mesh, sides.pieces, threads)) {
    Piece& piece = sides.each.emplace_back();
    if (!(sum.area > 0.0)) continue;
    piece.closed = sum.vector_area.norm() <= kClosedShare * sum.area;
    piece.outer = sum.volume - sum.moment.dot(sum.vector_area) / sum.area >= 0.0 ? 0 : 1;
    sides.any_closed = sides.any_closed || piece.closed;
  }
  return sides;
}

FreeSide::FreeSide(const SurfaceMesh& mesh, const PieceOrientation& sides) : mesh_(&mesh), sides_(&sides) {
  for (const PieceOrientation::Piece& piece : sides.each) here_.push_back({piece.outer, 0.0});
}

/// A piece encloses points that see it under a solid angle (van Oosterom and Strackee 1983) of 4 pi; outside
/// it is 0, and holes change both a little.
void FreeSide::begin_at(const Vec3& hip) noexcept {
  if (!sides_->any_closed) return;
  for (std::size_t i = 0; i < here_.size(); ++i) here_[i] = {sides_->each[i].outer, 0.0};
  if (!mesh_->local_box_mm().contains(hip)) return;
  for (std::uint32_t i = 0; i < mesh_->facets().size(); ++i) {
    const Facet& facet = mesh_->facet(i);
    const Vec3 a = facet.corner[0] - hip, b = facet.corner[1] - hip, c = facet.corner[2] - hip;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    const double angle =
        2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    here_[sides_->pieces.piece_of(i)].angle += sides_->pieces.side(i) == 0 ? angle : -angle;
  }
  for (std::size_t i = 0; i < here_.size(); ++i)
    if (std::abs(here_[i].angle) > 2.0 * std::numbers::pi) here_[i].front = 1 - sides_->each[i].outer;
}

}  // namespace palpate::baselines
