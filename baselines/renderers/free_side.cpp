#include "baselines/renderers/free_side.h"

#include <cmath>
#include <numbers>

namespace palpate::baselines {
namespace {

/// The areas of a closed surface cancel as vectors; up to this share of all is taken for holes.
constexpr double kClosedShare = 0.1;

}  // namespace

FreeSide::FreeSide(const SurfaceMesh& mesh) : mesh_(&mesh), pieces_of_(pieces_of(mesh)) {
  struct Sums {
    double area = 0.0, volume = 0.0;
    Vec3 vector_area = Vec3::Zero(), moment = Vec3::Zero();
  };
  std::vector<Sums> sums(pieces_of_.count);
  for (std::uint32_t i = 0; i < mesh.facets().size(); ++i) {
    const Facet& facet = mesh.facet(i);
    Sums& sum = sums[pieces_of_.piece_of(i)];
    const Vec3 a = pieces_of_.side(i) == 0 ? facet.scaled_normal() : Vec3(-facet.scaled_normal());
    const double size = a.norm();
    sum.area += size;
    sum.vector_area += a;
    sum.volume += a.dot(facet.corner[0]);
    sum.moment += size * facet.corner[0];
  }
  pieces_.resize(sums.size());
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const Sums& sum = sums[i];
    Piece& piece = pieces_[i];
    if (!(sum.area > 0.0)) continue;
    piece.closed = sum.vector_area.norm() <= kClosedShare * sum.area;
    piece.outer = piece.front = sum.volume - sum.moment.dot(sum.vector_area) / sum.area >= 0.0 ? 0 : 1;
    any_closed_ = any_closed_ || piece.closed;
  }
}

/// Enclosed by a piece is who sees it under a solid angle (van Oosterom and Strackee 1983) of 4 pi; from
/// outside it is 0, and near those where there are holes.
void FreeSide::begin_at(const Vec3& hip) noexcept {
  if (!any_closed_) return;
  for (Piece& piece : pieces_) {
    piece.angle = 0.0;
    piece.front = piece.outer;
  }
  if (!mesh_->local_box_mm().contains(hip)) return;
  for (std::uint32_t i = 0; i < mesh_->facets().size(); ++i) {
    const Facet& facet = mesh_->facet(i);
    const Vec3 a = facet.corner[0] - hip, b = facet.corner[1] - hip, c = facet.corner[2] - hip;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    const double angle =
        2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    pieces_[pieces_of_.piece_of(i)].angle += pieces_of_.side(i) == 0 ? angle : -angle;
  }
  for (Piece& piece : pieces_)
    if (std::abs(piece.angle) > 2.0 * std::numbers::pi) piece.front = 1 - piece.outer;
}

}  // namespace palpate::baselines
