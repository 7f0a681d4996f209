// From which side the closed pieces of a smooth surface are felt: that on which a replay begins.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "toolkit/smooth/layers.h"
#include "toolkit/smooth/smooth_contact.h"

namespace palpate::render {
namespace {

/// Of all directions a closed piece takes all from inside, none from outside: half way is the border, and
/// half way to that is far enough from it not to be mistaken.
constexpr double kInside = 0.5, kClearlyInside = 0.75;
/// Half a spacing of the points at the default edge of a voxel.
constexpr float kInDoubt = 0.29f;

}  // namespace

/// Whether a place is as near to a piece as the piece may be off where the points are few.
bool SmoothContact::is_on(const Vec3& h, std::uint16_t piece) const noexcept {
  const Cube cube = cube_of(h);
  const std::uint32_t cell = grid_->cell_at(cube);
  if (cell == CellBlocks::kNone) return false;
  const std::uint32_t past = std::min(grid_->first[cell + 1], grid_->first[cell] + kMaxSmoothSheets);
  for (std::uint32_t b = grid_->first[cell]; b < past; b += layers_from(&grid_->bricks[b]))
    if (grid_->bricks[b].piece() == piece &&
        std::abs(layers_value(&grid_->bricks[b], place_in(cube, h))) < kInDoubt)
      return true;
  return false;
}

/// The free side of a closed piece with holes. Through a hole the inner side may be all that is seen: so what
/// it takes of all directions decides, but for places that are too near for that, which are in front of what
/// is nearest to them.
float SmoothContact::side_by_share(const Vec3& h, const ClosedPiece& closed, std::uint16_t piece) noexcept {
  const double share = std::abs(geometry::share_around(closed.parts, h));
  const float far = share > kInside ? -closed.outer_side : closed.outer_side;
  if (std::abs(share - kInside) > kClearlyInside - kInside || is_far(h)) return far;
  std::array<double, kPieceSamples> nearest_sq;
  nearest_sq.fill(std::numeric_limits<double>::infinity());
  std::array<const geometry::SurfacePart*, kPieceSamples> nearest{};
  for (const geometry::SurfacePart& part : closed.parts) {
    double sq = (part.middle.cast<double>() - h).squaredNorm();
    const geometry::SurfacePart* here = &part;
    for (std::size_t k = 0; k < kPieceSamples; ++k)
      if (sq < nearest_sq[k]) {
        std::swap(sq, nearest_sq[k]);
        std::swap(here, nearest[k]);
      }
  }
  if (is_on(h, piece)) return closed.outer_side;
  float sum = 0.0f;
  for (const geometry::SurfacePart* part : nearest)
    if (part != nullptr) sum += side_seen(h, part->middle.cast<double>(), piece);
  return sum > 0.0f ? 1.0f : sum < 0.0f ? -1.0f : far;
}

void SmoothContact::restart(const Vec3& h_mm) noexcept {
  start_from(h_mm);
  const Vec3 h = tested_to_;
  for (std::size_t piece = 1; piece < free_side_.size(); ++piece) {
    const ClosedPiece& closed = grid_->closed_pieces[piece - 1];
    free_side_[piece] = 0.0f;
    if (closed.outer_side != 0.0f) {
      free_side_[piece] = side_by_share(h, closed, static_cast<std::uint16_t>(piece));
      continue;
    }
    float sum = 0.0f;
    if (!is_far(h))
      for (const Eigen::Vector3f& target : closed.samples)
        sum += side_seen(h, target.cast<double>(), static_cast<std::uint16_t>(piece));
    free_side_[piece] = sum > 0.0f ? 1.0f : sum < 0.0f ? -1.0f : 0.0f;
  }
}

}  // namespace palpate::render
