#include "toolkit/spline_sdf/brick_components.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/geometry/winding_number.h"

namespace palpate::spline_sdf {

namespace {

/// A brick is made if a point lies within this many spacings of it: the surface stays that close to its
/// points, and the side of a HIP must be known slightly off the surface.
constexpr double kMargin = 1.0;
/// Share of the area that is sampled more coarsely than the spacing of the largest bricks.
constexpr double kCoarseArea = 0.5;
constexpr std::size_t kTilesPerChunk = 1024;

}  // namespace

void sort_unique(std::vector<std::uint64_t>& codes, int threads) {
  std::uint64_t bits = 0;
  for (const std::uint64_t code : codes) bits |= code;
  radix_sort(codes, static_cast<int>(std::bit_width(bits)), threads, [](std::uint64_t code) { return code; });
  codes.erase(std::unique(codes.begin(), codes.end()), codes.end());
}

std::vector<std::uint64_t> tiles_of(std::span<const std::uint64_t> bricks, int threads) {
  std::vector<std::uint64_t> tiles;
  tiles.reserve(bricks.size() * 8);
  for (const std::uint64_t brick : bricks) {
    const BrickGrid::Coordinate c = search::coordinate_of_code(brick);
    for (int k = 0; k < 8; ++k)
      tiles.push_back(morton_code_of({c[0] + k / 4, c[1] + k / 2 % 2, c[2] + k % 2}));
  }
  sort_unique(tiles, threads);
  return tiles;
}

void add_tiles_beside(const search::MortonCellTable& bricks, int threads, std::vector<std::uint64_t>& tiles) {
  search::MortonCellTable known;
  known.build(tiles);
  const auto exists = [&](const BrickGrid::Coordinate& tile) {
    for (int k = 0; k < 8; ++k) {
      const BrickGrid::Coordinate c{tile[0] - k / 4, tile[1] - k / 2 % 2, tile[2] - k % 2};
      if (*std::min_element(c.begin(), c.end()) >= 0 &&
          bricks.find(morton_code_of(c)) != search::MortonCellTable::kNone)
        return true;
    }
    return false;
  };
  const auto visit = [&](std::size_t i, std::vector<std::uint64_t>& found) {
    const BrickGrid::Coordinate tile = search::coordinate_of_code(tiles[i]);
    for (std::size_t k = 0; k < 6; ++k) {
      BrickGrid::Coordinate to = tile;
      to[k / 2] += k % 2 == 0 ? -1 : 1;
      if (to[k / 2] < 0) continue;
      const std::uint64_t code = morton_code_of(to);
      if (known.find(code) == search::MortonCellTable::kNone && exists(to)) found.push_back(code);
    }
  };
  const auto beside = parallel_list<std::uint64_t>(tiles.size(), kTilesPerChunk, threads, visit);
  tiles.insert(tiles.end(), beside.begin(), beside.end());
  sort_unique(tiles, threads);
}

int coarser_levels(const MortonPoints& points, std::span<const PointPatches> of_points) {
  if (!(points.spacing_mm() > 0.0)) return 0;
  // Runs of points with one spacing, as a cell's are: a sixth of the points.
  std::vector<std::pair<double, std::size_t>> runs;
  double area = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (of_points[i].patch[0] == PointPatches::kNone) continue;
    const double spacing = points.spacing_near(i);
    if (runs.empty() || runs.back().first != spacing) runs.push_back({spacing, 0});
    ++runs.back().second;
    area += spacing * spacing;
  }
  std::sort(runs.begin(), runs.end());
  double finer = 0.0, coarse = points.spacing_mm();
  for (auto run = runs.begin(); run != runs.end() && finer < (1.0 - kCoarseArea) * area; ++run) {
    coarse = run->first;
    for (std::size_t k = 0; k < run->second; ++k) finer += coarse * coarse;
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
  const auto visit = [&](std::size_t begin, std::size_t end, std::vector<std::uint64_t>& mine) {
    using Cubes = std::array<BrickGrid::Coordinate, 2>;  // first and last
    Cubes added{{{-1, -1, -1}, {-1, -1, -1}}};
    for (std::size_t i = begin; i < end; ++i) {
      if (of_points[i].patch[0] == PointPatches::kNone) continue;
      const Vec3 at = (points[i] - grid.low_mm) * per;
      // Points farther apart than a cube have larger ones.
      const Vec3 off = Vec3::Constant(std::min(kMargin * points.spacing_near(i) * per, 1.0));
      const Vec3 low = (at - off).cwiseMax(0.0), high = (at + off).cwiseMin(last);
      const Eigen::Vector3i first = low.cast<int>(), past = high.cast<int>();
      const Cubes cubes{{{first.x(), first.y(), first.z()}, {past.x(), past.y(), past.z()}}};
      if (cubes == added) continue;  // as for most points after the one before
      added = cubes;
      for (std::int32_t x = first.x(); x <= past.x(); ++x)
        for (std::int32_t y = first.y(); y <= past.y(); ++y)
          for (std::int32_t z = first.z(); z <= past.z(); ++z) {
            const std::uint64_t code = morton_code_of({x, y, z});
            if (wanted(code)) mine.push_back(code);
          }
    }
    std::sort(mine.begin(), mine.end());
    mine.erase(std::unique(mine.begin(), mine.end()), mine.end());
  };
  using Codes = std::vector<std::uint64_t>;
  for (const Codes& found : parallel_parts<Codes>(points.size(), kPointsPerChunk, threads, visit))
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
/// Most of a closed piece's area that seems open: cells count a slab's face along the grid up to 2.4 times as
/// often as the other, .41; of a sheet nine tenths seem so.
constexpr double kMiscounted = 0.6;
/// Closed pieces that a brick can name.
constexpr std::size_t kMaxPieces = std::numeric_limits<std::uint16_t>::max();

struct Piece {
  double cells = 0.0, beyond = 0.0;
  std::vector<geometry::AreaElement> parts;
};

/// A cube's parts that look one way, and the other.
struct CubeSums {
  struct Sum {
    Vec3 area = Vec3::Zero(), middle = Vec3::Zero();
    double weight = 0.0;
  };
  std::array<Sum, 2> way;

  void add(const geometry::AreaElement& part) {
    const Vec3 area = part.area.cast<double>();
    const double weight = area.norm();
    Sum& sum = way[area.dot(way[0].area) < 0.0 ? 1 : 0];
    sum.area += area;
    sum.middle += weight * part.middle.cast<double>();
    sum.weight += weight;
  }
  void put(std::vector<geometry::AreaElement>& out) const {
    for (const Sum& sum : way)
      if (sum.weight > 0.0)
        out.push_back({Vec3(sum.middle / sum.weight).cast<float>(), sum.area.cast<float>()});
  }
};

/// Parts of a piece that are never joined: one of so few would lose its shape in the cubes.
constexpr std::size_t kOwnParts = 1024;

/// Joins the parts of pieces with many, in cubes that grow until half of `most` are left, or no piece has
/// many. Returns how many are left.
std::size_t join_parts(std::vector<Piece>& pieces, double& edge, std::size_t most) {
  for (;; edge *= 2.0) {
    std::size_t held = 0;
    bool more = false;
    for (Piece& piece : pieces) {
      if (piece.parts.size() > kOwnParts) piece.parts = joined_in_cubes(piece.parts, edge);
      more = more || piece.parts.size() > kOwnParts;
      held += piece.parts.size();
    }
    if (!more || held <= most / 2) return held;
  }
}

/// Without a border, and no sheet so wide that its border is no share of it.
bool is_closed(const Piece& piece) {
  return piece.beyond <= std::max(kChanceShare * piece.cells, kChanceCells) &&
         geometry::opening_fraction(piece.parts) <= kMiscounted;
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

std::vector<geometry::AreaElement> joined_in_cubes(std::span<const geometry::AreaElement> parts,
                                                   double edge) {
  const double per = 1.0 / edge;
  constexpr double kLastCube = (1 << search::kMortonBits) - 1;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(parts.size());
  for (std::uint32_t i = 0; i < parts.size(); ++i) {
    std::array<std::uint32_t, 3> cube{};
    for (std::size_t a = 0; a < 3; ++a)
      cube[a] = static_cast<std::uint32_t>(std::clamp(
          static_cast<double>(parts[i].middle[static_cast<Eigen::Index>(a)]) * per, 0.0, kLastCube));
    order[i] = {search::morton_code(cube[0], cube[1], cube[2]), i};
  }
  std::sort(order.begin(), order.end());
  std::vector<geometry::AreaElement> out;
  for (std::size_t i = 0; i < order.size();) {
    CubeSums cube;
    const std::uint64_t code = order[i].first;
    for (; i < order.size() && order[i].first == code; ++i) cube.add(parts[order[i].second]);
    cube.put(out);
  }
  return out;
}

BrickSummary summary_of(const BuiltBrick& one, std::uint64_t code, int level, const BrickGrid& grid) {
  BrickSummary out;
  out.piece = one.piece;
  out.smaller = one.smaller;
  out.cells = static_cast<std::uint8_t>(std::popcount(one.brick.mask));
  out.beyond = static_cast<std::uint8_t>(std::popcount(one.beyond));
  const int count = std::popcount(one.brick.mask | one.beyond);
  if (count == 0) return out;
  const double size = 1.0 / grid.per_voxel_of(level);
  const BrickGrid::Coordinate c = search::coordinate_of_code(code);
  const Vec3 middle = (Vec3(c[0], c[1], c[2]) * kBrickCells + one.places / count) * size;
  out.part = {middle.cast<float>(), (one.normals * (kCellArea * size * size)).cast<float>()};
  return out;
}

std::vector<PieceClass> find_closed_components(BrickGrid& grid, std::size_t count,
                                               const std::function<void(const VisitSummary&)>& each_brick,
                                               bool both_sides, int threads, std::size_t most_parts) {
  std::vector<Piece> pieces(count);
  double edge = std::ldexp(grid.cube_edge(), kJoinedBits);
  std::size_t held = 0, most = most_parts;
  each_brick([&](const BrickSummary& one, int level) {
    if (one.cells + one.beyond == 0 || one.smaller) return;
    Piece& piece = pieces[one.piece];
    const double size = 1.0 / grid.per_voxel_of(level);
    piece.cells += size * size * one.cells;
    piece.beyond += size * size * one.beyond;
    piece.parts.push_back(one.part);
    if (++held < most) return;
    held = join_parts(pieces, edge, most_parts);
    // Many small pieces stay.
    most = std::max(most_parts, 2 * held);
  });
  std::vector<PieceClass> classes(count);
  for (std::size_t p = 0; p < count; ++p) {
    Piece& piece = pieces[p];
    if (!(piece.cells > 0.0) || grid.closed_components.size() == kMaxPieces) continue;
    const float side = outer_side_of(piece, both_sides, threads);
    if (side == 0.0f) continue;
    // Counted cells tell the area of a face along the grid to a tenth, which would look like a mouth.
    const double mouth = is_closed(piece) ? 0.0 : geometry::opening_fraction(piece.parts);
    grid.min_enclosed = std::min(grid.min_enclosed, 1.0 - mouth);
    classes[p].tight = mouth <= geometry::kTightOpeningFraction;
    grid.closed_components.push_back(
        {side, classes[p].tight, geometry::SurfaceParts(std::move(piece.parts))});
    classes[p].number = static_cast<std::uint16_t>(grid.closed_components.size());
  }
  return classes;
}

}  // namespace palpate::spline_sdf
