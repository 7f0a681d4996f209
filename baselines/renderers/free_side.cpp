#include "baselines/renderers/free_side.h"

#include <cmath>
#include <numbers>

#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

/// The areas of a closed surface cancel as vectors; up to this share of all is taken for holes.
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

/// Of one piece, over fixed chunks.
Sums sums_of_one(const SurfaceMesh& mesh, const Pieces& pieces, int threads) {
  const std::size_t facets = mesh.facets().size();
  std::vector<Sums> parts((facets + kPointsPerChunk - 1) / kPointsPerChunk);
  parallel_chunks(facets, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (auto i = static_cast<std::uint32_t>(begin); i < end; ++i)
      parts[begin / kPointsPerChunk].add(mesh.facet(i), pieces.side(i));
  });
  Sums all;
  for (const Sums& part : parts) all.add(part);
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

PieceSides PieceSides::of(const SurfaceMesh& mesh, int threads) {
  PieceSides sides;
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

FreeSide::FreeSide(const SurfaceMesh& mesh, const PieceSides& sides) : mesh_(&mesh), sides_(&sides) {
  for (const PieceSides::Piece& piece : sides.each) here_.push_back({piece.outer, 0.0});
}

/// Enclosed by a piece is who sees it under a solid angle (van Oosterom and Strackee 1983) of 4 pi; from
/// outside it is 0, and near those where there are holes.
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
