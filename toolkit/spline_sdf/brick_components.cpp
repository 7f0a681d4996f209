#include "toolkit/spline_sdf/brick_components.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/geometry/winding_number.h"

namespace palpate::render {

namespace {

/// A brick is made if a point lies within this many spacings of it: the surface stays that close to its
/// points, and the side of a HIP must be known slightly off the surface.
constexpr double kMargin = 1.0;
/// Share of the area that is sampled more coarsely than the spacing of the largest bricks.
constexpr double kCoarseArea = 0.5;

}  // namespace

void sort_unique(std::vector<std::uint64_t>& codes, int threads) {
  std::uint64_t bits = 0;
  for (const std::uint64_t code : codes) bits |= code;
  radix_sort(codes, static_cast<int>(std::bit_width(bits)), threads, [](std::uint64_t code) { return code; });
  codes.erase(std::unique(codes.begin(), codes.end()), codes.end());
}

int coarser_levels(const MortonPoints& points, std::span<const PointPatches> of_points) {
  if (!(points.spacing_mm() > 0.0)) return 0;
  std::vector<double> spacings;
  double area = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (of_points[i].patch[0] == PointPatches::kNone) continue;
    spacings.push_back(points.spacing_near(i));
    area += spacings.back() * spacings.back();
  }
  std::sort(spacings.begin(), spacings.end());
  double finer = 0.0, coarse = points.spacing_mm();
  for (const double spacing : spacings) {
    coarse = spacing;
    finer += spacing * spacing;
    if (finer >= (1.0 - kCoarseArea) * area) break;
  }
  int levels = 0;
  for (double at = 2.0 * points.spacing_mm(); at <= coarse && levels < BrickGrid::kMaxCoarser; at *= 2.0)
    ++levels;
  return levels;
}

void add_cubes_near_points(const MortonPoints& points, std::span<const PointPatches> of_points,
                           const BrickGrid& grid, int level, int threads,
                           const std::function<bool(std::uint64_t)>& wanted,
                           std::vector<std::uint64_t>& codes) {
  const double per = grid.per_voxel * grid.per_voxel_of(level) / kBrickCells;
  const auto last = static_cast<double>(((grid.last_brick + 1) << level) - 1);
  const auto look = [&](std::size_t begin, std::size_t end, std::vector<std::uint64_t>& mine) {
    for (std::size_t i = begin; i < end; ++i) {
      if (of_points[i].patch[0] == PointPatches::kNone) continue;
      const Vec3 at = (points[i] - grid.low_mm) * per;
      // Points farther apart than a cube have larger ones.
      const Vec3 off = Vec3::Constant(std::min(kMargin * points.spacing_near(i) * per, 1.0));
      const Vec3 low = (at - off).cwiseMax(0.0), high = (at + off).cwiseMin(last);
      for (auto x = static_cast<std::int32_t>(low.x()); x <= static_cast<std::int32_t>(high.x()); ++x)
        for (auto y = static_cast<std::int32_t>(low.y()); y <= static_cast<std::int32_t>(high.y()); ++y)
          for (auto z = static_cast<std::int32_t>(low.z()); z <= static_cast<std::int32_t>(high.z()); ++z) {
            const std::uint64_t code = morton_code_of({x, y, z});
            if ((mine.empty() || mine.back() != code) && wanted(code)) mine.push_back(code);
          }
    }
    std::sort(mine.begin(), mine.end());
    mine.erase(std::unique(mine.begin(), mine.end()), mine.end());
  };
  using Codes = std::vector<std::uint64_t>;
  for (const Codes& found : parallel_parts<Codes>(points.size(), kPointsPerChunk, threads, look))
    codes.insert(codes.end(), found.begin(), found.end());
  sort_unique(codes, threads);
}

namespace {

/// The number of such cells is the volume of their slab, so each represents this area in square voxels, at
/// any tilt.
constexpr double kCellArea = 0.5 / kCrossedCell;
/// A sheet with at most this many cells, or share of cells, outside its points is closed. The smallest hole
/// (two spacings wide) has about eight around it, a chance void one; edges of clean points have some in a
/// thousand.
constexpr double kChanceCells = 4.0, kChanceShare = 2e-3;
/// Closed pieces that a brick can name.
constexpr std::size_t kMaxPieces = std::numeric_limits<std::uint16_t>::max();

struct Piece {
  double cells = 0.0, beyond = 0.0;
  std::uint16_t number = 0;
  bool tight = false;
  std::vector<geometry::AreaElement> parts;
};

/// In voxels.
geometry::AreaElement part_of(const BrickGrid& grid, const BuiltBrick& one, std::uint64_t code, int level) {
  const double size = 1.0 / grid.per_voxel_of(level);
  const BrickGrid::Coordinate c = search::coordinate_of_code(code);
  const int count = std::popcount(one.brick.mask | one.beyond);
  const Vec3 middle = (Vec3(c[0], c[1], c[2]) * kBrickCells + one.places / count) * size;
  return {middle.cast<float>(), (one.normals * (kCellArea * size * size)).cast<float>()};
}

bool is_closed(const Piece& piece) {
  return piece.beyond <= std::max(kChanceShare * piece.cells, kChanceCells);
}

/// The sign of the distance outside a piece that encloses a volume, or 0.
float outer_side_of(const Piece& piece, bool both_sides, int threads) {
  const bool closed = is_closed(piece);
  if (!closed && both_sides) return 0.0f;
  const float side = geometry::normal_orientation(piece.parts, threads);
  if (side != 0.0f || !closed) return side;
  // Too thin for solid angles: decides by its volume.
  double volume = 0.0;
  const Vec3 from = piece.parts.front().middle.cast<double>();
  for (const geometry::AreaElement& part : piece.parts)
    volume += (part.middle.cast<double>() - from).dot(part.area.cast<double>());
  return volume < 0.0 ? -1.0f : 1.0f;
}

}  // namespace

void find_closed_components(BrickGrid& grid, BuiltBricks& made, const LevelCodes& codes, std::size_t count,
                            bool both_sides, int threads) {
  std::vector<Piece> pieces(count);
  const auto each_brick = [&](auto&& visit) {
    for (int l = 0; l < grid.levels; ++l) {
      const auto at = static_cast<std::size_t>(l);
      for (std::size_t i = 0; i < made[at].size(); ++i) visit(made[at][i], codes[at][i], l);
    }
  };
  each_brick([&](const BuiltBrick& one, std::uint64_t code, int level) {
    const std::uint64_t crossed = one.brick.mask | one.beyond;
    if (crossed == 0 || one.smaller) return;
    Piece& piece = pieces[one.piece];
    const double size = 1.0 / grid.per_voxel_of(level);
    piece.cells += size * size * std::popcount(one.brick.mask);
    piece.beyond += size * size * std::popcount(one.beyond);
    piece.parts.push_back(part_of(grid, one, code, level));
  });
  for (Piece& piece : pieces) {
    if (!(piece.cells > 0.0) || grid.closed_components.size() == kMaxPieces) continue;
    const float side = outer_side_of(piece, both_sides, threads);
    if (side == 0.0f) continue;
    const double mouth = geometry::opening_fraction(piece.parts);
    grid.min_enclosed = std::min(grid.min_enclosed, 1.0 - mouth);
    piece.tight = is_closed(piece) || mouth <= geometry::kTightOpeningFraction;
    grid.closed_components.push_back({side, piece.tight, std::move(piece.parts)});
    piece.number = static_cast<std::uint16_t>(grid.closed_components.size());
  }
  each_brick([&](BuiltBrick& one, std::uint64_t, int) {
    one.brick.piece = pieces[one.piece].number;
    if (pieces[one.piece].tight) one.brick.mask = ~std::uint64_t{0};
  });
}

}  // namespace palpate::render
