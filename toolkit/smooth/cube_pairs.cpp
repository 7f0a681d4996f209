#include "toolkit/smooth/cube_pairs.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "toolkit/core/parallel.h"
#include "toolkit/core/radix_sort.h"
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
constexpr std::size_t kPatchGrain = 1024;

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
  }
  /// Whether it counts for the nodes of a cube with its middle there, along u, v and n; `through`: its
  /// surface may go through the cube's cells. Over a cube the residual changes by its gradient's components,
  /// but for curvature.
  [[nodiscard]] bool holds(const Vec3& middle, bool& through) const {
    const double a = middle[0], b = middle[1], along = middle[2];
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
  double per_voxel_, shift_a_, shift_b_, reach_sq_, cells_sq_, bend_;
};

void pairs_of(const Patch& p, std::uint32_t index, const BrickGrid& grid, std::vector<CubePair>& out) {
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
          out.push_back({cx | cy | cz, index, through});
      }
    }
  }
}

/// Leaves only cubes that some surface goes through.
void drop_others(std::vector<CubePair>& pairs) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < pairs.size();) {
    std::size_t end = i;
    bool through = false;
    for (; end < pairs.size() && pairs[end].code == pairs[i].code; ++end) through |= pairs[end].through;
    if (through)
      kept = static_cast<std::size_t>(std::copy(pairs.begin() + static_cast<std::ptrdiff_t>(i),
                                                pairs.begin() + static_cast<std::ptrdiff_t>(end),
                                                pairs.begin() + static_cast<std::ptrdiff_t>(kept)) -
                                      pairs.begin());
    i = end;
  }
  pairs.resize(kept);
}

}  // namespace

std::vector<CubePair> find_pairs(const std::vector<Patch>& patches, std::size_t count, const BrickGrid& grid,
                                 int threads) {
  std::vector<std::vector<CubePair>> found((count + kPatchGrain - 1) / kPatchGrain);
  parallel_chunks(count, kPatchGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<CubePair>& mine = found[begin / kPatchGrain];
    for (std::size_t i = begin; i < end; ++i) pairs_of(patches[i], static_cast<std::uint32_t>(i), grid, mine);
  });
  std::size_t all = 0;
  for (const std::vector<CubePair>& f : found) all += f.size();
  std::vector<CubePair> pairs;
  pairs.reserve(all);
  for (std::vector<CubePair>& f : found) {
    pairs.insert(pairs.end(), f.begin(), f.end());
    std::vector<CubePair>().swap(f);  // sorting needs its room
  }
  // Of one cube they are in the order of their patches, and stay so.
  const int bits = 3 * static_cast<int>(std::bit_width(static_cast<std::uint64_t>(grid.last_brick)));
  radix_sort(pairs, bits, threads, [](const CubePair& pair) { return pair.code; });
  drop_others(pairs);
  return pairs;
}

}  // namespace palpate::render
