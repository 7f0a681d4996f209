#include "toolkit/smooth/cube_pairs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/cell_blocks.h"
#include "toolkit/smooth/shared_tiles.h"

namespace palpate::render {
namespace {

/// Half the diagonal of a brick's nodes, in voxels.
constexpr double kHalfNodeDiagonal = 5.1961524;
/// A surface that only just enters a cube is in it, too.
constexpr double kThroughRoom = 0.25;
/// No tile of a cube asks for a patch that is, along any axis, farther from its cells than this, in voxels,
/// and the patch's support: half the diagonal of eight tiles, half a voxel on, and the most that a foot is
/// moved.
constexpr double kPairRoom = 5.0;
/// Rounding of what a bound is compared with, and far more.
constexpr double kBoundRoom = 1.0 + 1e-9;
constexpr std::size_t kPatchGrain = 1024;
/// Pairs of so many patches are counted, and put in their places, by one thread: a count for each cube is
/// needed every time, and there are about half as many cubes as patches.
constexpr std::size_t kCountGrain = 16;  // in kPatchGrain
/// Room for so many cubes of a patch is taken at first; some 47 on a surface that bends little.
constexpr std::size_t kUsualCubes = 56;

/// A patch and a cube that it may reach; later the cube's number in place of its code.
struct Pair {
  std::uint64_t cube;
  CubePatch patch;
};
/// Cubes that are remembered, two to this power: some four times those of kPatchGrain patches.
constexpr int kLastBits = 11;
/// What a number of a patch may have: a cloud of 2^31 patches fits in no memory.
constexpr std::uint32_t kPatchBits = 0x7fffffffu;
constexpr std::uint64_t kNoCube = ~std::uint64_t{0};

/// Which cubes a patch counts for.
class Reach {
 public:
  Reach(const Patch& patch, const BrickGrid& grid) : q_(patch.quadric), per_voxel_(grid.per_voxel) {
    const double to_middle = 0.5 * grid.voxel_mm, cells = patch.support + kHalfDiagonal * grid.voxel_mm;
    const double reach = patch.support + reach_of_tiles(q_.n) * grid.voxel_mm;
    shift_a_ = to_middle * q_.u.sum();
    shift_b_ = to_middle * q_.v.sum();
    reach_sq_ = reach * reach;
    cells_sq_ = cells * cells;
    bend_ = (std::abs(q_.uu) + std::abs(q_.uv) + std::abs(q_.vv)) * grid.voxel_mm;
    // What holds() asks in the end is at most so much off, for the height and the slope are bounded where it
    // is as near along the tangent plane.
    const double most = reach + std::hypot(shift_a_, shift_b_);
    const double height = (std::max(std::abs(q_.uu), std::abs(q_.vv)) + 0.5 * std::abs(q_.uv)) * most * most;
    const double slope = q_.n.cwiseAbs().sum() +
                         q_.u.cwiseAbs().sum() * (2.0 * std::abs(q_.uu) + std::abs(q_.uv)) * most +
                         q_.v.cwiseAbs().sum() * (2.0 * std::abs(q_.vv) + std::abs(q_.uv)) * most;
    most_along_ =
        kBoundRoom *
        (height + (kHalfNodes * slope + bend_ * kHalfNodeDiagonal * kHalfNodeDiagonal) * grid.voxel_mm);
  }
  /// Whether it counts for the nodes of a cube with its middle there, along u, v and n; `through`: its
  /// surface may go through the cube's cells. Over a cube the residual changes by its gradient's components,
  /// but for curvature.
  [[nodiscard]] bool holds(const Vec3& middle, bool& through) const {
    const double a = middle[0], b = middle[1], along = middle[2];
    if (std::abs(along) > most_along_) return false;
    // The tiles' middle is half a voxel on.
    const double of_tiles_a = a + shift_a_, of_tiles_b = b + shift_b_;
    if (of_tiles_a * of_tiles_a + of_tiles_b * of_tiles_b > reach_sq_) return false;
    const double off = std::abs(along - (q_.uu * a * a + q_.uv * a * b + q_.vv * b * b)) * per_voxel_;
    const Vec3 slope = q_.n - q_.u * (2.0 * q_.uu * a + q_.uv * b) - q_.v * (2.0 * q_.vv * b + q_.uv * a);
    const double per_voxel = slope.cwiseAbs().sum();
    if (off > kHalfNodes * per_voxel + bend_ * kHalfNodeDiagonal * kHalfNodeDiagonal) return false;
    through = a * a + b * b <= cells_sq_ &&
              off <= kHalfCells * per_voxel + kThroughRoom + bend_ * kHalfDiagonal * kHalfDiagonal;
    return true;
  }

 private:
  const Quadric& q_;
  double per_voxel_, shift_a_, shift_b_, reach_sq_, cells_sq_, bend_, most_along_;
};

void pairs_of(const Patch& p, std::uint32_t index, const BrickGrid& grid, std::vector<Pair>& out) {
  const Quadric& q = p.quadric;
  const Reach reach(p, grid);
  const double brick_mm = kBrickCells * grid.voxel_mm, around = p.support + kPairRoom * grid.voxel_mm;
  std::array<std::int64_t, 3> low{}, high{};
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    const double at = q.at[axis] - grid.low_mm[axis];
    low[a] = std::max<std::int64_t>(static_cast<std::int64_t>(std::floor((at - around) / brick_mm)), 0);
    high[a] = std::min<std::int64_t>(static_cast<std::int64_t>(std::floor((at + around) / brick_mm)),
                                     grid.last_brick);
  }
  const Vec3 step(q.u.z() * brick_mm, q.v.z() * brick_mm, q.n.z() * brick_mm);
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (high[axis] < low[axis]) return;
  const std::uint64_t code_y = partition::morton_code(0, static_cast<std::uint32_t>(low[1]), 0);
  const std::uint64_t code_z = partition::morton_code(0, 0, static_cast<std::uint32_t>(low[2]));
  std::uint64_t cx = partition::morton_code(static_cast<std::uint32_t>(low[0]), 0, 0);
  for (std::int64_t x = low[0]; x <= high[0]; ++x, cx = next_code<0>(cx)) {
    std::uint64_t cy = code_y;
    for (std::int64_t y = low[1]; y <= high[1]; ++y, cy = next_code<1>(cy)) {
      const Vec3 first = grid.low_mm + Vec3(static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5,
                                            static_cast<double>(low[2]) + 0.5) *
                                           brick_mm;
      const Vec3 d = first - q.at, begin(d.dot(q.u), d.dot(q.v), d.dot(q.n));
      std::uint64_t cz = code_z;
      for (std::int64_t z = low[2]; z <= high[2]; ++z, cz = next_code<2>(cz)) {
        bool through = false;
        if (reach.holds(begin + static_cast<double>(z - low[2]) * step, through))
          out.push_back({cx | cy | cz, {index & kPatchBits, through ? 1u : 0u}});
      }
    }
  }
}

void leave_one_each(std::vector<std::uint64_t>& codes) {
  std::sort(codes.begin(), codes.end());
  codes.erase(std::unique(codes.begin(), codes.end()), codes.end());
}

/// The cubes that some surface may go through.
std::vector<std::uint64_t> cubes_through(const std::vector<std::vector<Pair>>& found, int threads) {
  std::vector<std::vector<std::uint64_t>> some(found.size());
  parallel_chunks(found.size(), 1, threads, [&](std::size_t chunk, std::size_t) {
    // Patches beside each other go through the same cubes: what was met not long ago is not kept again.
    std::vector<std::uint64_t> last(std::size_t{1} << kLastBits, kNoCube);
    for (const Pair& pair : found[chunk]) {
      if (pair.patch.through == 0) continue;
      std::uint64_t& same = last[spread_code(pair.cube) >> (64 - kLastBits)];
      if (same == pair.cube) continue;
      same = pair.cube;
      some[chunk].push_back(pair.cube);
    }
    leave_one_each(some[chunk]);
  });
  std::vector<std::uint64_t> codes;
  for (const std::vector<std::uint64_t>& s : some) codes.insert(codes.end(), s.begin(), s.end());
  leave_one_each(codes);
  return codes;
}

/// Sorts by cube, what is of none left out; of one cube pairs stay as they are, ascending by patch.
void put_by_cube(std::vector<std::vector<Pair>>& found, CubePatches& out, int threads) {
  const std::size_t cubes = out.codes.size();
  CellBlocks table;
  table.build(out.codes);
  std::vector<std::vector<std::uint32_t>> places((found.size() + kCountGrain - 1) / kCountGrain);
  parallel_chunks(found.size(), kCountGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint32_t>& count = places[begin / kCountGrain];
    count.assign(cubes, 0);
    for (std::size_t chunk = begin; chunk < end; ++chunk)
      for (Pair& pair : found[chunk]) {
        const std::uint32_t number = table.find(pair.cube);
        pair.cube = number == CellBlocks::kNone ? kNoCube : number;
        if (number != CellBlocks::kNone) ++count[number];
      }
  });
  out.begin.resize(cubes + 1);
  std::uint32_t sum = 0;
  for (std::size_t cube = 0; cube < cubes; ++cube) {
    out.begin[cube] = sum;
    for (std::vector<std::uint32_t>& count : places) sum += std::exchange(count[cube], sum);
  }
  out.begin[cubes] = sum;
  out.all.resize(sum);
  parallel_chunks(found.size(), kCountGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint32_t>& place = places[begin / kCountGrain];
    for (std::size_t chunk = begin; chunk < end; ++chunk)
      for (const Pair& pair : found[chunk])
        if (pair.cube != kNoCube) out.all[place[pair.cube]++] = pair.patch;
  });
}

}  // namespace

CubePatches find_pairs(const std::vector<Patch>& patches, std::size_t count, const BrickGrid& grid,
                       int threads) {
  std::vector<std::vector<Pair>> found((count + kPatchGrain - 1) / kPatchGrain);
  parallel_chunks(count, kPatchGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<Pair>& mine = found[begin / kPatchGrain];
    mine.reserve(kUsualCubes * (end - begin));
    for (std::size_t i = begin; i < end; ++i) pairs_of(patches[i], static_cast<std::uint32_t>(i), grid, mine);
  });
  CubePatches out;
  out.codes = cubes_through(found, threads);
  put_by_cube(found, out, threads);
  return out;
}

}  // namespace palpate::render
