#include "toolkit/smooth/field_bricks.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/brick_cubes.h"
#include "toolkit/smooth/brick_pieces.h"
#include "toolkit/smooth/patch_field.h"
#include "toolkit/smooth/points_around.h"
#include "toolkit/smooth/spline.h"
#include "toolkit/smooth/tile_blend.h"

namespace palpate::render {
namespace {

/// The lattice begins this many bricks before the box: faces of a box that stands along the axes are often
/// flat, and lie at no wall this way.
constexpr double kLatticeShift = 1.09;
/// A part of a brick that did not follow the field is made where that says the surface is nearer than so many
/// spacings: it was off by less.
constexpr double kPartMargin = 0.5;
/// What a cubic B-spline takes of a second difference along an axis. Differences beyond so many voxels,
/// farther off than so many, are kinks half way to another sheet.
constexpr float kBlur = 1.0f / 6.0f, kKink = 0.5f, kNearSurface = 0.2f;
/// Where a spline's normal differs from the field's by more than this smaller bricks take over: 14 degrees,
/// of bricks that are smaller already 26.
constexpr std::array<double, BrickGrid::kFineLevels> kSameNormal{0.97, 0.9, -1.0};
/// Patches are one surface where they differ by no more than so many times the tolerance, or this share of
/// the noise.
constexpr double kOneSurface = 1.0, kOneSurfaceNoise = 0.6;
/// Beyond so many bricks no point tells of a node.
constexpr double kFarthestPoint = 4.0;
/// Larger cubes than the points' spacing asks for, through which so many patches go, are what smaller ones
/// are for: their own field is the mean of some.
constexpr std::size_t kMostPatches = 64;
constexpr std::size_t kTileGrain = 128, kBrickGrain = 64;

using Coordinate = BrickGrid::Coordinate;

class Builder {
 public:
  Builder(const SmoothPoints& points, std::span<const Patch> patches, std::span<const std::uint32_t> piece,
          std::span<const PointPatches> of, const FieldBuild& build, int threads, BrickGrid& grid)
      : points_(points),
        patches_(patches),
        piece_(piece),
        of_(of),
        build_(build),
        threads_(threads),
        grid_(grid) {}

  void run() {
    for (level_ = 0; level_ < last_level(); ++level_) {
      voxel_mm_ = grid_.voxel_mm / grid_.per_voxel_of(level_);
      std::vector<std::uint64_t>& codes = codes_[static_cast<std::size_t>(level_)];
      if (level_ > 0) codes = parts_of_cubes();
      if (level_ <= grid_.coarser)
        add_cubes_near_points(
            points_, of_, grid_, level_, threads_, [this](std::uint64_t code) { return has_smaller(code); },
            codes);
      if (codes.empty()) break;
      grid_.levels = level_ + 1;
      grid_.level[static_cast<std::size_t>(level_)].table.build(codes);
      sample_tiles(codes);
      make_bricks(codes);
    }
    close_pieces(grid_, made_, codes_, patches_.size(), build_.both_sides, threads_);
    collect();
  }

 private:
  /// Of a cube of this level: that around it has smaller ones.
  [[nodiscard]] bool has_smaller(std::uint64_t code) const {
    if (level_ == 0) return true;
    const auto above = static_cast<std::size_t>(level_ - 1);
    const std::uint32_t parent = grid_.level[above].table.find(code >> 3);
    return parent != CellBlocks::kNone && made_[above][parent].smaller;
  }
  [[nodiscard]] int last_level() const { return grid_.coarser + build_.levels; }
  /// Which of the fine levels this is; larger cubes are as the first.
  [[nodiscard]] int fine() const { return std::max(level_ - grid_.coarser, 0); }

  /// Of the cubes of the last level that are not followed, those of their eight parts that the surface may go
  /// through.
  std::vector<std::uint64_t> parts_of_cubes() const {
    const auto last = static_cast<std::size_t>(level_ - 1);
    const double off = 0.5 * (kHalfDiagonal + kPartMargin * points_.spacing_mm() / voxel_mm_);
    std::vector<std::uint64_t> codes;
    for (std::size_t i = 0; i < codes_[last].size(); ++i) {
      if (!made_[last][i].smaller) continue;
      for (int k = 0; k < 8; ++k) {
        BrickPlace middle;
        // Morton order: x is the lowest bit.
        middle.cell = {k % 2 * 2 + 1, k / 2 % 2 * 2 + 1, k / 4 * 2 + 1};
        middle.t = {0.0f, 0.0f, 0.0f};
        const Jet jet = spline_jet(made_[last][i].brick, middle);
        if (std::abs(static_cast<double>(jet.value)) <= off)
          codes.push_back(codes_[last][i] << 3 | static_cast<std::uint64_t>(k));
      }
    }
    return codes;
  }

  /// The field at the nodes of all bricks, and from them the coefficients. Bricks beside each other have
  /// nodes in common: tile (x, y, z) holds the nodes from 4 (x, y, z) - 1 on, once for all.
  void sample_tiles(const std::vector<std::uint64_t>& bricks) {
    std::vector<std::uint64_t> codes;
    codes.reserve(bricks.size() * 8);
    for (const std::uint64_t brick : bricks) {
      const Coordinate c = coordinate_of(brick);
      for (int k = 0; k < 8; ++k) codes.push_back(code_at({c[0] + k / 4, c[1] + k / 2 % 2, c[2] + k % 2}));
    }
    sort_unique(codes, threads_);
    tile_table_ = CellBlocks();
    tile_table_.build(codes);
    LargeVector<Tile> values(codes.size());
    plain_.assign(codes.size(), 0);
    near_ = TilePatches(patches_, grid_, tile_table_, codes, voxel_mm_, threads_);
    const double agreed = std::max(kOneSurface * build_.tolerance_mm, kOneSurfaceNoise * build_.noise_mm);
    parallel_chunks(codes.size(), kTileGrain, threads_, [&](std::size_t begin, std::size_t end) {
      PatchField field(points_, patches_, of_);
      for (std::size_t i = begin; i < end; ++i) {
        const Vec3 middle = middle_of(coordinate_of(codes[i]));
        if (is_crowded(near_.of(i)))
          (void)blend_tile(patches_, some_of(near_.of(i)), middle, voxel_mm_, agreed, values[i]);
        else if (blend_tile(patches_, near_.of(i), middle, voxel_mm_, agreed, values[i]))
          plain_[i] = 1;
        else
          sample(middle, field, values[i]);
      }
    });
    tiles_ = LargeVector<Tile>(codes.size());
    parallel_chunks(codes.size(), kTileGrain, threads_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) sharpen(coordinate_of(codes[i]), values, i);
    });
  }
  [[nodiscard]] bool is_crowded(std::span<const std::uint32_t> patches) const {
    return level_ < grid_.coarser && patches.size() > kMostPatches;
  }
  [[nodiscard]] static std::vector<std::uint32_t> some_of(std::span<const std::uint32_t> patches) {
    std::vector<std::uint32_t> some;
    for (std::size_t k = 0; k < kMostPatches; ++k) some.push_back(patches[k * patches.size() / kMostPatches]);
    return some;
  }
  [[nodiscard]] Vec3 middle_of(const Coordinate& tile) const {
    return grid_.low_mm + (Vec3(tile[0], tile[1], tile[2]) * kTileNodes + Vec3::Constant(0.5)) * voxel_mm_;
  }
  void sample(const Vec3& middle, PatchField& field, Tile& out) const {
    if (!field.begin(middle, kTileReach * voxel_mm_, kFarthestPoint * kBrickCells * voxel_mm_)) {
      out.fill(static_cast<float>(kBrickReach));
      return;
    }
    const double per = 1.0 / voxel_mm_;
    for (std::size_t i = 0; i < kTileCount; ++i) {
      const Vec3 at =
          Vec3(static_cast<double>(i / 16), static_cast<double>(i / 4 % 4), static_cast<double>(i % 4)) -
          Vec3::Constant(1.5);
      out[i] = static_cast<float>(field.at(at * voxel_mm_).distance_mm * per);
    }
  }
  /// A node less what the spline will blur.
  void sharpen(const Coordinate& tile, const LargeVector<Tile>& values, std::size_t own) {
    constexpr std::array<std::size_t, 3> kStep{16, 4, 1};
    std::array<std::array<const Tile*, 2>, 3> beside{};
    for (std::size_t a = 0; a < 3; ++a)
      for (int way = 0; way < 2; ++way) {
        Coordinate to = tile;
        to[a] += way == 0 ? -1 : 1;
        if (to[a] < 0) continue;
        const std::uint32_t found = tile_table_.find(code_at(to));
        if (found != CellBlocks::kNone) beside[a][static_cast<std::size_t>(way)] = &values[found];
      }
    for (std::size_t i = 0; i < kTileCount; ++i) {
      const float here = values[own][i];
      float sum = 0.0f;
      for (std::size_t a = 0; a < 3; ++a) {
        const std::size_t on = i / kStep[a] % 4;
        const Tile* before = on > 0 ? &values[own] : beside[a][0];
        const Tile* after = on < 3 ? &values[own] : beside[a][1];
        if (before == nullptr || after == nullptr) continue;
        const float low = (*before)[on > 0 ? i - kStep[a] : i + 3 * kStep[a]],
                    high = (*after)[on < 3 ? i + kStep[a] : i - 3 * kStep[a]];
        const float bend = low + high - 2.0f * here;
        if (std::abs(bend) < kKink || std::abs(here) < kNearSurface) sum += bend;
      }
      tiles_[own][i] = here - kBlur * sum;
    }
  }

  void make_bricks(const std::vector<std::uint64_t>& codes) {
    std::vector<Made>& made = made_[static_cast<std::size_t>(level_)];
    made.resize(codes.size());
    parallel_chunks(codes.size(), kBrickGrain, threads_, [&](std::size_t begin, std::size_t end) {
      PatchField field(points_, patches_, of_);
      PointsAround around;
      std::array<float, kBrickCoefficients> nodes;
      for (std::size_t i = begin; i < end; ++i) {
        const Coordinate cube = coordinate_of(codes[i]);
        read_nodes(cube, nodes);
        made[i].brick.put(nodes);
        look_at_cells(codes[i], field, around, made[i]);
      }
    });
  }
  void read_nodes(const Coordinate& cube, std::array<float, kBrickCoefficients>& nodes) const {
    for (int k = 0; k < 8; ++k) {
      const std::array<int, 3> on{k / 4, k / 2 % 2, k % 2};
      const Tile& tile =
          tiles_[tile_table_.find(code_at({cube[0] + on[0], cube[1] + on[1], cube[2] + on[2]}))];
      for (int x = 0; x < std::min(kBrickNodes - 4 * on[0], 4); ++x)
        for (int y = 0; y < std::min(kBrickNodes - 4 * on[1], 4); ++y)
          for (int z = 0; z < std::min(kBrickNodes - 4 * on[2], 4); ++z)
            nodes[static_cast<std::size_t>(((4 * on[0] + x) * kBrickNodes + 4 * on[1] + y) * kBrickNodes +
                                           4 * on[2] + z)] =
                tile[static_cast<std::size_t>((x * 4 + y) * 4 + z)];
    }
  }

  /// Whether no tile of a brick has patches that disagree.
  [[nodiscard]] bool is_plain(const Coordinate& cube) const {
    for (int k = 0; k < 8; ++k)
      if (plain_[tile_table_.find(code_at({cube[0] + k / 4, cube[1] + k / 2 % 2, cube[2] + k % 2}))] == 0)
        return false;
    return true;
  }

  /// Of a place in a smaller brick, in voxels from its corner: the normal as the first fine bricks round it.
  /// Beside an edge that is the mean of both faces', along which the points of either are seen beside the
  /// place.
  [[nodiscard]] Vec3 mean_normal(std::uint64_t code, const Coordinate& cube, const Vec3& at) const {
    const std::uint64_t parent = code >> (3 * fine());
    const Coordinate from = coordinate_of(parent);
    const auto first = static_cast<std::size_t>(level_ - fine());
    BrickPlace place;
    for (std::size_t a = 0; a < 3; ++a) {
      const double x = (kBrickCells * static_cast<double>(cube[a]) + at[static_cast<Eigen::Index>(a)]) /
                           static_cast<double>(1 << fine()) -
                       kBrickCells * static_cast<double>(from[a]);
      place.cell[a] = std::clamp(static_cast<int>(x), 0, kBrickCells - 1);
      place.t[a] = static_cast<float>(x - place.cell[a]);
    }
    return spline_jet(made_[first][grid_.level[first].table.find(parent)].brick, place)
        .gradient.cast<double>()
        .normalized();
  }

  /// The cells that the surface goes through: which of them lie between points, and whether the spline
  /// follows the field there.
  void look_at_cells(std::uint64_t code, PatchField& field, PointsAround& around, Made& out) const {
    const Coordinate cube = coordinate_of(code);
    const double half = 0.5 * kBrickCells;
    const Vec3 middle =
        grid_.low_mm + (Vec3(cube[0], cube[1], cube[2]) * kBrickCells + Vec3::Constant(half)) * voxel_mm_;
    const std::span<const std::uint32_t> near = near_.of(tile_table_.find(code_at(cube)));
    if (near.empty()) return;
    double spacing = 0.0, nearest = std::numeric_limits<double>::infinity();
    for (const std::uint32_t p : near) {
      spacing = std::max(spacing, patches_[p].spacing);
      const double off = (patches_[p].quadric.at - middle).squaredNorm();
      if (off < nearest) {
        nearest = off;
        out.piece = piece_[p];
      }
    }
    if (is_crowded(near)) {
      out.smaller = true;
      return;
    }
    around.begin(points_, middle, kHalfDiagonal * voxel_mm_, spacing);
    const bool may_be_smaller =
        level_ + 1 < last_level() && (level_ < grid_.coarser || !is_plain(cube)) &&
        field.begin(middle, kHalfDiagonal * voxel_mm_, kFarthestPoint * kBrickCells * voxel_mm_);
    for (int cell = 0; cell < kBrickCells * kBrickCells * kBrickCells; ++cell) {
      BrickPlace at;
      at.cell = {cell / 16, cell / 4 % 4, cell % 4};
      at.t = {0.5f, 0.5f, 0.5f};
      const Jet jet = spline_jet(out.brick, at);
      const auto slope = static_cast<double>(jet.gradient.norm());
      if (!(slope > 0.0) ||
          std::abs(static_cast<double>(jet.value)) > kCrossedCell * std::max(slope, kLeastSlope))
        continue;
      const Vec3 n = jet.gradient.cast<double>() / slope;
      const Vec3 foot = Vec3(at.cell[0] + 0.5, at.cell[1] + 0.5, at.cell[2] + 0.5) -
                        n * (static_cast<double>(jet.value) / slope);
      const Vec3 from_middle = (foot - Vec3::Constant(half)) * voxel_mm_;
      const std::uint64_t bit = std::uint64_t{1} << cell;
      if (around.are_around(from_middle, fine() == 0 ? n : mean_normal(code, cube, foot)))
        out.brick.mask |= bit;
      else
        out.beyond |= bit;
      out.normals += n;
      out.places += foot;
      if (!may_be_smaller || out.smaller) continue;
      const FieldValue value = field.at(from_middle);
      out.smaller = std::abs(value.distance_mm) > (1 + fine()) * build_.tolerance_mm ||
                    value.normal.dot(n) < kSameNormal[static_cast<std::size_t>(fine())];
    }
    if (out.beyond != 0 && out.brick.mask != 0) close_voids(out);
  }

  /// Cells between two others of the surface that points are around are no border: they are voids of chance.
  static void close_voids(Made& out) {
    const std::uint64_t mask = out.brick.mask;
    const auto has = [&](int x, int y, int z) {
      return (x | y | z) >= 0 && x < kBrickCells && y < kBrickCells && z < kBrickCells &&
             (mask >> ((x * kBrickCells + y) * kBrickCells + z) & 1u) != 0;
    };
    for (std::uint64_t left = out.beyond; left != 0; left &= left - 1) {
      const int cell = std::countr_zero(left);
      const int x = cell / 16, y = cell / 4 % 4, z = cell % 4;
      bool between = false;
      // Of the 26 cells around each pair once.
      for (int k = 0; k < 13 && !between; ++k) {
        const int dx = k / 9 - 1, dy = k / 3 % 3 - 1, dz = k % 3 - 1;
        between = has(x + dx, y + dy, z + dz) && has(x - dx, y - dy, z - dz);
      }
      if (!between) continue;
      out.brick.mask |= std::uint64_t{1} << cell;
      out.beyond &= ~(std::uint64_t{1} << cell);
    }
  }

  void collect() {
    std::size_t count = 0;
    for (const std::vector<Made>& made : made_) count += made.size();
    grid_.bricks.reserve(count);
    for (int l = 0; l < grid_.levels; ++l) {
      const auto at = static_cast<std::size_t>(l);
      BrickGrid::Level& level = grid_.level[at];
      level.brick.reserve(codes_[at].size());
      for (const Made& one : made_[at]) {
        level.brick.push_back(static_cast<std::uint32_t>(grid_.bricks.size()) |
                              (one.smaller ? BrickGrid::kSmaller : 0u));
        grid_.bricks.push_back(one.brick);
      }
    }
  }

  const SmoothPoints& points_;
  std::span<const Patch> patches_;
  std::span<const std::uint32_t> piece_;
  std::span<const PointPatches> of_;
  const FieldBuild& build_;
  int threads_;
  BrickGrid& grid_;
  int level_ = 0;
  double voxel_mm_ = 1.0;  ///< of this level
  LevelCodes codes_;
  MadeBricks made_;
  CellBlocks tile_table_;
  LargeVector<Tile> tiles_;
  TilePatches near_;
  std::vector<std::uint8_t> plain_;  ///< of each tile: its patches agree
};

}  // namespace

std::vector<BrickGrid::Place> BrickGrid::places() const {
  std::vector<Place> out(bricks.size());
  for (int l = 0; l < levels; ++l) {
    const Level& here = level[static_cast<std::size_t>(l)];
    const std::vector<std::uint64_t> codes = here.table.codes(here.brick.size());
    for (std::size_t cell = 0; cell < codes.size(); ++cell) {
      const std::uint32_t brick = here.brick[cell] & ~kSmaller;
      out[brick] = {brick, l, coordinate_of(codes[cell]), brick == here.brick[cell]};
    }
  }
  return out;
}

BrickGrid build_bricks(const SmoothPoints& points, std::span<const Patch> patches,
                       std::span<const std::uint32_t> piece, std::span<const PointPatches> of_points,
                       const FieldBuild& build, int threads) {
  BrickGrid grid;
  grid.coarser = coarser_levels(points, of_points);
  const double brick_mm = kBrickCells * std::ldexp(build.voxel_mm, grid.coarser);
  grid.voxel_mm = build.voxel_mm;
  grid.per_voxel = 1.0 / build.voxel_mm;
  grid.box_mm = points.box_mm();
  grid.low_mm = grid.box_mm.low_mm - Vec3::Constant(kLatticeShift * brick_mm);
  const double bricks = (grid.box_mm.high_mm - grid.low_mm).maxCoeff() / brick_mm + 2.0;
  // Codes of the smallest bricks, and of the tiles one beyond them, have to hold them.
  const std::int64_t most =
      (std::int64_t{1} << (partition::kMortonBits - grid.coarser - BrickGrid::kFineLevels)) - 1;
  grid.last_brick = std::min(static_cast<std::int64_t>(std::min(bricks, 1e15)), most);
  if (!patches.empty()) Builder(points, patches, piece, of_points, build, threads, grid).run();
  return grid;
}

}  // namespace palpate::render
