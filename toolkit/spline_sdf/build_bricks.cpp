#include "toolkit/spline_sdf/build_bricks.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"
#include "toolkit/spline_sdf/brick_components.h"
#include "toolkit/spline_sdf/patch_field.h"
#include "toolkit/spline_sdf/patch_lanes.h"
#include "toolkit/spline_sdf/point_interior.h"
#include "toolkit/spline_sdf/spline.h"

namespace palpate::spline_sdf {
namespace {

/// The lattice's offset before the box, in bricks: flat faces of axis-aligned boxes then avoid brick walls.
constexpr double kLatticeShift = 1.09;
/// A part of a failed brick is made where the surface may be nearer than this many spacings; its error was
/// smaller.
constexpr double kPartMargin = 0.5;
/// A cubic B-spline blurs this share of an axis's second difference. Larger differences than kKink voxels,
/// beyond kNearSurface voxels, are kinks half way to another sheet.
constexpr float kBlur = 1.0f / 6.0f, kKink = 0.5f, kNearSurface = 0.2f;
/// Smaller bricks replace one whose normal differs from the field's by more than this: 14 degrees, 26 for
/// bricks already smaller.
constexpr std::array<double, BrickGrid::kFineLevels> kSameNormal{0.97, 0.9, -1.0};
/// Patches are one surface if they differ by at most this many tolerances, or this share of the noise.
constexpr double kOneSurface = 1.0, kOneSurfaceNoise = 0.6;
/// Bricks beyond which no point informs a node.
constexpr double kFarthestPoint = 4.0;
/// Large cubes crossed by this many patches are left to smaller ones: their own field averages several.
constexpr std::size_t kMaxPatches = 64;
/// Parts of a level, at most. Nodes where two parts meet are sampled for both, a few in a hundred; those of
/// all bricks would take more memory than these.
constexpr std::size_t kPartsOfLevel = 16;
constexpr std::size_t kTileGrain = 128, kBrickGrain = 64;
/// Bricks collected before what they were in is given back: 3 MB.
constexpr std::size_t kBricksMoved = 4096;

using Coordinate = BrickGrid::Coordinate;
using TileValues = LargePageUninitializedVector<Tile>;

class BrickBuilder {
 public:
  BrickBuilder(const MortonPoints& points, std::span<const QuadricPatch> patches,
               std::span<const std::uint32_t> piece, std::span<const PointPatches> of,
               const BrickBuildOptions& build, const BrickRegion* region, int threads, SampledBricks& out)
      : points_(points),
        patches_(patches),
        piece_(piece),
        of_(of),
        build_(build),
        region_(region),
        threads_(threads),
        grid_(out.grid),
        codes_(out.codes),
        made_(out.made) {}

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
      std::vector<BuiltBrick>& made = made_[static_cast<std::size_t>(level_)];
      made.reserve(codes.size());
      const std::size_t most = std::max(build_.bricks_at_once, codes.size() / kPartsOfLevel);
      for (std::size_t first = 0; first < codes.size(); first += most) {
        const auto part =
            std::span<const std::uint64_t>(codes).subspan(first, std::min(most, codes.size() - first));
        sample_tiles(part, part.size() == codes.size());
        made.resize(first + part.size());
        make_bricks(part, std::span(made).subspan(first));
      }
    }
  }

 private:
  /// True if the cube is in the region, or smaller cubes replace the one around it.
  [[nodiscard]] bool has_smaller(std::uint64_t code) const {
    if (level_ == 0) return region_ == nullptr || region_->contains(search::coordinate_of_code(code));
    const auto above = static_cast<std::size_t>(level_ - 1);
    const std::uint32_t parent = grid_.level[above].table.find(code >> 3);
    return parent != search::MortonCellTable::kNone && made_[above][parent].smaller;
  }
  [[nodiscard]] int last_level() const { return grid_.coarser + build_.levels; }
  /// Index among the fine levels; larger cubes use the first.
  [[nodiscard]] int fine() const { return std::max(level_ - grid_.coarser, 0); }

  /// Of the last level's failed cubes: those of their eight parts that the surface may cross.
  std::vector<std::uint64_t> parts_of_cubes() const {
    const auto last = static_cast<std::size_t>(level_ - 1);
    const double off = 0.5 * (kHalfDiagonal + kPartMargin * points_.spacing_mm() / voxel_mm_);
    std::vector<std::uint64_t> codes;
    for (std::size_t i = 0; i < codes_[last].size(); ++i) {
      if (!made_[last][i].smaller) continue;
      for (int k = 0; k < 8; ++k) {
        BrickPosition middle;
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

  /// Samples the field at the nodes of some bricks of the level, or all, and computes coefficients. Adjacent
  /// bricks share nodes: tile (x, y, z) holds the nodes from 4 (x, y, z) - 1 on, once.
  void sample_tiles(std::span<const std::uint64_t> bricks, bool all) {
    release_memory(tiles_);  // the last bricks'
    near_ = {};
    std::vector<std::uint64_t> codes = tiles_of(bricks, threads_);
    if (!all) add_tiles_beside(grid_.level[static_cast<std::size_t>(level_)].table, threads_, codes);
    tile_table_ = search::MortonCellTable();
    tile_table_.build(codes);
    TileValues values(codes.size());
    plain_.assign(codes.size(), 0);
    near_ = TilePatches(patches_, grid_, tile_table_, codes, voxel_mm_, threads_);
    const double agreed = std::max(kOneSurface * build_.tolerance_mm, kOneSurfaceNoise * build_.noise_mm);
    parallel_chunks(codes.size(), kTileGrain, threads_, [&](std::size_t begin, std::size_t end) {
      PatchDistanceField field(points_, patches_, of_);
      for (std::size_t i = begin; i < end; ++i) {
        const Vec3 middle = middle_of(search::coordinate_of_code(codes[i]));
        if (is_crowded(near_.of(i)))
          (void)blend_tile(patches_, some_of(near_.of(i)), middle, voxel_mm_, agreed, values[i]);
        else if (blend_tile(patches_, near_.of(i), middle, voxel_mm_, agreed, values[i]))
          plain_[i] = 1;
        else
          sample(middle, field, values[i]);
      }
    });
    tiles_ = TileValues(codes.size());
    parallel_each(codes.size(), kTileGrain, threads_,
                  [&](std::size_t i) { sharpen(search::coordinate_of_code(codes[i]), values, i); });
  }
  [[nodiscard]] bool is_crowded(std::span<const std::uint32_t> patches) const {
    return level_ < grid_.coarser && patches.size() > kMaxPatches;
  }
  [[nodiscard]] static std::vector<std::uint32_t> some_of(std::span<const std::uint32_t> patches) {
    std::vector<std::uint32_t> some;
    for (std::size_t k = 0; k < kMaxPatches; ++k) some.push_back(patches[k * patches.size() / kMaxPatches]);
    return some;
  }
  [[nodiscard]] Vec3 middle_of(const Coordinate& tile) const {
    return grid_.low_mm + (Vec3(tile[0], tile[1], tile[2]) * kTileNodes + Vec3::Constant(0.5)) * voxel_mm_;
  }
  void sample(const Vec3& middle, PatchDistanceField& field, Tile& out) const {
    if (!field.begin(middle, kTileReach * voxel_mm_, kFarthestPoint * kBrickCells * voxel_mm_)) {
      out.fill(static_cast<float>(kMaxBrickDistance));
      return;
    }
    const auto voxel = static_cast<float>(voxel_mm_), per = static_cast<float>(1.0 / voxel_mm_);
    FieldLanes values;
    for (std::size_t i = 0; i < kTileCount / kNodesAtOnce; ++i) {
      const NodePlaces at = tile_places(i);
      field.evaluate({at.x * voxel, at.y * voxel, at.z * voxel}, values);
      for (std::size_t k = 0; k < kNodesAtOnce; ++k) out[i * kNodesAtOnce + k] = values.distance_mm[k] * per;
    }
  }
  /// Corrects a node for the spline's blur.
  void sharpen(const Coordinate& tile, const TileValues& values, std::size_t own) {
    constexpr std::array<std::size_t, 3> kStep{16, 4, 1};
    std::array<std::array<const Tile*, 2>, 3> beside{};
    for (std::size_t a = 0; a < 3; ++a)
      for (int way = 0; way < 2; ++way) {
        Coordinate to = tile;
        to[a] += way == 0 ? -1 : 1;
        if (to[a] < 0) continue;
        const std::uint32_t found = tile_table_.find(morton_code_of(to));
        if (found != search::MortonCellTable::kNone)
          beside[a][static_cast<std::size_t>(way)] = &values[found];
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

  void make_bricks(std::span<const std::uint64_t> codes, std::span<BuiltBrick> made) {
    parallel_chunks(codes.size(), kBrickGrain, threads_, [&](std::size_t begin, std::size_t end) {
      PatchDistanceField field(points_, patches_, of_);
      InteriorTest around;
      std::array<float, kBrickCoefficients> nodes;
      for (std::size_t i = begin; i < end; ++i) {
        const Coordinate cube = search::coordinate_of_code(codes[i]);
        read_nodes(cube, nodes);
        made[i].brick.put(nodes);
        mark_surface_cells(codes[i], field, around, made[i]);
      }
    });
  }
  void read_nodes(const Coordinate& cube, std::array<float, kBrickCoefficients>& nodes) const {
    for (int k = 0; k < 8; ++k) {
      const std::array<int, 3> on{k / 4, k / 2 % 2, k % 2};
      const Tile& tile =
          tiles_[tile_table_.find(morton_code_of({cube[0] + on[0], cube[1] + on[1], cube[2] + on[2]}))];
      for (int x = 0; x < std::min(kBrickNodes - 4 * on[0], 4); ++x)
        for (int y = 0; y < std::min(kBrickNodes - 4 * on[1], 4); ++y)
          for (int z = 0; z < std::min(kBrickNodes - 4 * on[2], 4); ++z)
            nodes[static_cast<std::size_t>(((4 * on[0] + x) * kBrickNodes + 4 * on[1] + y) * kBrickNodes +
                                           4 * on[2] + z)] =
                tile[static_cast<std::size_t>((x * 4 + y) * 4 + z)];
    }
  }

  /// True if the patches agree on all tiles of a brick.
  [[nodiscard]] bool is_plain(const Coordinate& cube) const {
    for (int k = 0; k < 8; ++k)
      if (plain_[tile_table_.find(morton_code_of({cube[0] + k / 4, cube[1] + k / 2 % 2, cube[2] + k % 2}))] ==
          0)
        return false;
    return true;
  }

  /// The rounded normal of the first fine bricks, at a place in a smaller brick (voxels from its corner).
  /// Beside an edge it is the mean of both faces' normals, along which either face's points are seen.
  [[nodiscard]] Vec3 mean_normal(std::uint64_t code, const Coordinate& cube, const Vec3& at) const {
    const std::uint64_t parent = code >> (3 * fine());
    const Coordinate from = search::coordinate_of_code(parent);
    const auto first = static_cast<std::size_t>(level_ - fine());
    BrickPosition place;
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

  /// Marks the cells that the surface crosses, which of them are outside the points, and whether the spline
  /// follows the field.
  void mark_surface_cells(std::uint64_t code, PatchDistanceField& field, InteriorTest& around,
                          BuiltBrick& out) const {
    const Coordinate cube = search::coordinate_of_code(code);
    const double half = 0.5 * kBrickCells;
    const Vec3 middle =
        grid_.low_mm + (Vec3(cube[0], cube[1], cube[2]) * kBrickCells + Vec3::Constant(half)) * voxel_mm_;
    const std::span<const std::uint32_t> near = near_.of(tile_table_.find(morton_code_of(cube)));
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
    Crossings crossings;
    for (int cell = 0; cell < kBrickCells * kBrickCells * kBrickCells; ++cell) {
      BrickPosition at;
      at.cell = {cell / 16, cell / 4 % 4, cell % 4};
      at.t = {0.5f, 0.5f, 0.5f};
      const Jet jet = spline_jet(out.brick, at);
      const auto slope = static_cast<double>(jet.gradient.norm());
      if (!(slope > 0.0) ||
          std::abs(static_cast<double>(jet.value)) > kCrossedCell * std::max(slope, kMinSlope))
        continue;
      const Vec3 n = jet.gradient.cast<double>() / slope;
      const Vec3 closest = Vec3(at.cell[0] + 0.5, at.cell[1] + 0.5, at.cell[2] + 0.5) -
                           n * (static_cast<double>(jet.value) / slope);
      const Vec3 from_middle = (closest - Vec3::Constant(half)) * voxel_mm_;
      const std::uint64_t bit = std::uint64_t{1} << cell;
      if (around.is_interior(from_middle, fine() == 0 ? n : mean_normal(code, cube, closest)))
        out.brick.mask |= bit;
      else
        out.beyond |= bit;
      out.normals += n;
      out.places += closest;
      crossings.add(from_middle, n);
    }
    out.smaller = may_be_smaller && !follows(crossings, field);
    if (out.beyond != 0 && out.brick.mask != 0) fill_mask_holes(out);
  }

  /// The spline's places on the surface, mm from a brick's middle, and its normals there, at most one per
  /// cell.
  struct Crossings {
    std::array<Vec3, kBrickCells * kBrickCells * kBrickCells> at, normal;
    std::size_t count = 0;
    void add(const Vec3& place, const Vec3& n) {
      at[count] = place;
      normal[count++] = n;
    }
  };
  /// True if the field agrees with the spline there.
  bool follows(const Crossings& spline, PatchDistanceField& field) const {
    const double most_off = (1 + fine()) * build_.tolerance_mm;
    FieldLanes values;
    for (std::size_t begin = 0; begin < spline.count; begin += kNodesAtOnce) {
      NodePlaces at;
      for (std::size_t k = 0; k < kNodesAtOnce; ++k) {
        const Vec3& place = spline.at[std::min(begin + k, spline.count - 1)];
        at.x[k] = static_cast<float>(place.x());
        at.y[k] = static_cast<float>(place.y());
        at.z[k] = static_cast<float>(place.z());
      }
      field.evaluate(at, values);
      for (std::size_t k = 0; k < std::min(kNodesAtOnce, spline.count - begin); ++k)
        if (std::abs(values.distance_at(k)) > most_off ||
            values.normal_at(k).dot(spline.normal[begin + k]) < kSameNormal[static_cast<std::size_t>(fine())])
          return false;
    }
    return true;
  }

  /// Cells between two surface cells that points surround are chance voids, not borders.
  static void fill_mask_holes(BuiltBrick& out) {
    const std::uint64_t mask = out.brick.mask;
    const auto has = [&](int x, int y, int z) {
      return (x | y | z) >= 0 && x < kBrickCells && y < kBrickCells && z < kBrickCells &&
             (mask >> ((x * kBrickCells + y) * kBrickCells + z) & 1u) != 0;
    };
    for (std::uint64_t left = out.beyond; left != 0; left &= left - 1) {
      const int cell = std::countr_zero(left);
      const int x = cell / 16, y = cell / 4 % 4, z = cell % 4;
      bool between = false;
      // Visits each opposite pair of the 26 neighbours once.
      for (int k = 0; k < 13 && !between; ++k) {
        const int dx = k / 9 - 1, dy = k / 3 % 3 - 1, dz = k % 3 - 1;
        between = has(x + dx, y + dy, z + dz) && has(x - dx, y - dy, z - dz);
      }
      if (!between) continue;
      out.brick.mask |= std::uint64_t{1} << cell;
      out.beyond &= ~(std::uint64_t{1} << cell);
    }
  }

  const MortonPoints& points_;
  std::span<const QuadricPatch> patches_;
  std::span<const std::uint32_t> piece_;
  std::span<const PointPatches> of_;
  const BrickBuildOptions& build_;
  const BrickRegion* region_;
  int threads_;
  BrickGrid& grid_;
  int level_ = 0;
  double voxel_mm_ = 1.0;  ///< of this level
  LevelCodes& codes_;
  BuiltBricks& made_;
  search::MortonCellTable tile_table_;
  TileValues tiles_;  ///< of those at a part's border only what its bricks read is right
  TilePatches near_;
  std::vector<std::uint8_t> plain_;  ///< per tile: its patches agree
};

}  // namespace

std::vector<BrickGrid::BrickRef> BrickGrid::places() const {
  std::vector<BrickRef> out(bricks.size());
  for (int l = 0; l < levels; ++l) {
    const Level& here = level[static_cast<std::size_t>(l)];
    const std::vector<std::uint64_t> codes = here.table.codes(here.brick.size());
    for (std::size_t cell = 0; cell < codes.size(); ++cell) {
      const std::uint32_t brick = here.brick[cell] & ~kRefined;
      out[brick] = {brick, l, search::coordinate_of_code(codes[cell]), brick == here.brick[cell]};
    }
  }
  return out;
}

BrickGrid brick_lattice(const geometry::Aabb& box_mm, double voxel_mm, int coarser) {
  BrickGrid grid;
  grid.coarser = coarser;
  const double brick_mm = kBrickCells * std::ldexp(voxel_mm, coarser);
  grid.voxel_mm = voxel_mm;
  grid.per_voxel = 1.0 / voxel_mm;
  grid.box_mm = box_mm;
  grid.low_mm = box_mm.low_mm - Vec3::Constant(kLatticeShift * brick_mm);
  const double bricks = (box_mm.high_mm - grid.low_mm).maxCoeff() / brick_mm + 2.0;
  // Codes must hold the smallest bricks and one tile beyond them.
  const std::int64_t most = (std::int64_t{1} << (search::kMortonBits - coarser - BrickGrid::kFineLevels)) - 1;
  grid.last_brick = std::min(static_cast<std::int64_t>(std::min(bricks, 1e15)), most);
  return grid;
}

geometry::Aabb BrickRegion::cubes_mm(const BrickGrid& grid) const noexcept {
  const double edge_mm = grid.cube_edge() * grid.voxel_mm;
  return {grid.low_mm + Vec3(low[0], low[1], low[2]) * edge_mm,
          grid.low_mm + Vec3(past[0], past[1], past[2]) * edge_mm};
}

void SampledBricks::collect() {
  std::size_t count = 0;
  for (const std::vector<BuiltBrick>& of : made) count += of.size();
  grid.bricks.reserve(count);
  for (int l = 0; l < grid.levels; ++l) {
    const auto at = static_cast<std::size_t>(l);
    grid.level[at].brick.reserve(codes[at].size());
    for (std::size_t i = 0; i < made[at].size(); ++i) {
      const BuiltBrick& one = made[at][i];
      grid.level[at].brick.push_back(static_cast<std::uint32_t>(grid.bricks.size()) |
                                     (one.smaller ? BrickGrid::kRefined : 0u));
      grid.bricks.push_back(one.brick);
      // Both copies of all bricks would be the most that is ever held.
      if ((i + 1) % kBricksMoved == 0)
        discard_pages(&made[at][i + 1 - kBricksMoved], kBricksMoved * sizeof(BuiltBrick));
    }
    release_memory(made[at]);
  }
}

SampledBricks sample_bricks(const MortonPoints& points, std::span<const QuadricPatch> patches,
                            std::span<const std::uint32_t> piece, std::span<const PointPatches> of_points,
                            const BrickBuildOptions& build, const BrickRegion* region, int threads) {
  SampledBricks out;
  out.grid = region != nullptr
                 ? brick_lattice(region->box_mm, build.voxel_mm, region->coarser)
                 : brick_lattice(points.box_mm(), build.voxel_mm, coarser_levels(points, of_points));
  if (!patches.empty()) BrickBuilder(points, patches, piece, of_points, build, region, threads, out).run();
  return out;
}

BrickGrid build_bricks(const MortonPoints& points, std::span<const QuadricPatch> patches,
                       std::span<const std::uint32_t> piece, std::vector<PointPatches> of_points,
                       const BrickBuildOptions& build, int threads) {
  SampledBricks out = sample_bricks(points, patches, piece, of_points, build, nullptr, threads);
  release_memory(of_points);
  const auto each_brick = [&](const auto& visit) {
    for (int l = 0; l < out.grid.levels; ++l) {
      const auto at = static_cast<std::size_t>(l);
      for (std::size_t i = 0; i < out.made[at].size(); ++i) visit(out.made[at][i], out.codes[at][i], l);
    }
  };
  const std::vector<PieceClass> classes = find_closed_components(
      out.grid, patches.size(),
      [&](const VisitSummary& visit) {
        each_brick([&](const BuiltBrick& one, std::uint64_t code, int level) {
          visit(summary_of(one, code, level, out.grid), level);
        });
      },
      build.both_sides, threads);
  each_brick([&](BuiltBrick& one, std::uint64_t, int) { classes[one.piece].put(one.brick); });
  out.collect();
  return std::move(out.grid);
}

}  // namespace palpate::spline_sdf
