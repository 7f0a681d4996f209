#include "toolkit/spline_sdf/patch_lanes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/core/simd.h"
#include "toolkit/spline_sdf/brick_components.h"

namespace palpate::spline_sdf {
namespace {

/// Largest distance from the surface to nodes of bricks that it crosses, voxels.
constexpr double kFarthestNode = 8.0;
/// Newton steps to a node's closest point: agreeing patches are nearly flat across a tile.
constexpr int kNodeClosestSteps = 2;
/// Below this determinant a node is at a centre of curvature (see PatchDistanceField).
constexpr float kMinNodeDeterminant = 0.1f;
/// Weight of a patch beyond its support: it counts only where no other does.
constexpr float kBeyondSupport = 1e-6f;
/// A patch gives no node a value if its closest point is this many supports off, squared.
constexpr float kFarthestShare = 100.0f;
constexpr std::size_t kScatterGrain = 256;
/// Tiles along a block's edge: about as many as a patch reaches at the level of its points.
constexpr int kTileBlockBits = 3, kTileBlockEdge = 1 << kTileBlockBits;

/// A patch relative to a tile's middle, in voxels.
struct Form {
  Form(const QuadricPatch& p, const Vec3& middle, double voxel_mm)
      : quadric(p.quadric, middle, voxel_mm),
        per_support_sq(static_cast<float>(voxel_mm * voxel_mm / (p.support * p.support))),
        weight(static_cast<float>(p.trust)) {}
  QuadricLanes quadric;
  float per_support_sq, weight;
};

using TileLanes = std::array<NodeLanes, kTileCount / kNodesAtOnce>;

/// Sums of weights, weighted distances and their squares.
struct alignas(kLanesAlignment) Sums {
  TileLanes weight{}, distance{}, square{};
};

/// Adds a patch's contribution at all nodes.
[[gnu::always_inline]] inline void add_patch(const Form& p, Sums& sums) noexcept {
  for (std::size_t i = 0; i < sums.weight.size(); ++i) {
    QuadricClosest closest;
    find_closest(p.quadric, tile_places(i), kNodeClosestSteps, kMinNodeDeterminant, closest);
    const NodeLanes share = (closest.u * closest.u + closest.v * closest.v) * p.per_support_sq,
                    left = 1.0f - share, none{};
    const NodeLanes rest = left > none ? left : none;
    // Beyond its centre of curvature a closest point is arbitrary or NaN: the patch does not contribute.
    const auto told = share < none + kFarthestShare;
    const NodeLanes weight =
        told ? p.weight * (rest * rest * rest + kBeyondSupport / ((1.0f + share) * (1.0f + share))) : none;
    const NodeLanes known = told ? closest.distance : none;
    sums.distance[i] += weight * known;
    sums.square[i] += weight * known * known;
    sums.weight[i] += weight;
  }
}
void add_narrow(const Form& p, Sums& sums) noexcept {
  add_patch(p, sums);
}
#if defined(__x86_64__)
PALPATE_AVX2 void add_wide(const Form& p, Sums& sums) noexcept {
  add_patch(p, sums);
}
#endif

}  // namespace

TilePatches::TilePatches(std::span<const QuadricPatch> patches, const BrickGrid& grid,
                         const search::MortonCellTable& tiles, std::span<const std::uint64_t> codes,
                         double voxel_mm, int threads) {
  const std::size_t count = codes.size();
  using Pair = std::pair<std::uint32_t, std::uint32_t>;  // tile, patch
  const double per = 1.0 / voxel_mm;
  std::vector<std::uint64_t> block_codes;
  geometry::Aabb all;  // of the tiles' coordinates: of part of a level most patches are elsewhere
  for (const std::uint64_t code : codes) {
    const BrickGrid::Coordinate c = search::coordinate_of_code(code);
    all.add(Vec3(c[0], c[1], c[2]));
    if (block_codes.empty() || block_codes.back() != code >> (3 * kTileBlockBits))
      block_codes.push_back(code >> (3 * kTileBlockBits));
  }
  search::MortonCellTable blocks;
  blocks.build(block_codes);
  const auto scatter = [&](std::size_t k, std::vector<Pair>& mine) {
    const QuadricPatch& p = patches[k];
    const Vec3 at = (p.quadric.at - grid.low_mm) * per;
    const double reach = p.support * per + kTileReach, high = kFarthestNode + kTileReach;
    Vec3 low, past;
    for (Eigen::Index a = 0; a < 3; ++a) {
      const double n = p.quadric.n[a];
      const double extent = reach * std::sqrt(std::max(1.0 - n * n, 0.0)) + high * std::abs(n);
      // The middle of tile t is at 4 t + 0.5.
      low[a] = std::max(std::ceil((at[a] - extent - 0.5) / kTileNodes), all.low_mm[a]);
      past[a] = std::min(std::floor((at[a] + extent - 0.5) / kTileNodes), all.high_mm[a]);
      if (low[a] > past[a]) return;
    }
    const auto reaches = [&](const Vec3& tile) {
      const Vec3 d = tile * kTileNodes + Vec3::Constant(0.5) - at;
      const double h = d.dot(p.quadric.n);
      return !(std::abs(h) > high || d.squaredNorm() - h * h > reach * reach);
    };
    // A patch of coarse points may reach more blocks than there are tiles.
    const Vec3 low_block = (low / kTileBlockEdge).array().floor(),
               past_block = (past / kTileBlockEdge).array().floor();
    if ((past_block - low_block + Vec3::Ones()).cwiseMax(0.0).prod() > static_cast<double>(count)) {
      for (std::uint32_t tile = 0; tile < count; ++tile) {
        const BrickGrid::Coordinate c = search::coordinate_of_code(codes[tile]);
        if (reaches(Vec3(c[0], c[1], c[2]))) mine.push_back({tile, static_cast<std::uint32_t>(k)});
      }
      return;
    }
    const Eigen::Vector3i first = low.cast<int>(), last = past.cast<int>();
    const auto visit_tiles_of = [&](const Eigen::Vector3i& block) {
      // Few of smaller bricks' tiles exist.
      if (blocks.find(morton_code_of({block.x(), block.y(), block.z()})) == search::MortonCellTable::kNone)
        return;
      const Eigen::Vector3i corner = block * kTileBlockEdge, from = first.cwiseMax(corner),
                            to = last.cwiseMin(corner + Eigen::Vector3i::Constant(kTileBlockEdge - 1));
      for (int x = from.x(); x <= to.x(); ++x)
        for (int y = from.y(); y <= to.y(); ++y)
          for (int z = from.z(); z <= to.z(); ++z) {
            if (!reaches(Vec3(x, y, z))) continue;
            const std::uint32_t tile = tiles.find(morton_code_of({x, y, z}));
            if (tile != search::MortonCellTable::kNone) mine.push_back({tile, static_cast<std::uint32_t>(k)});
          }
    };
    for (int x = first.x() / kTileBlockEdge; x <= last.x() / kTileBlockEdge; ++x)
      for (int y = first.y() / kTileBlockEdge; y <= last.y() / kTileBlockEdge; ++y)
        for (int z = first.z() / kTileBlockEdge; z <= last.z() / kTileBlockEdge; ++z)
          visit_tiles_of({x, y, z});
  };
  const auto found = parallel_parts<std::vector<Pair>>(patches.size(), kScatterGrain, threads, scatter);
  begin_.assign(count + 1, 0);
  for (const std::vector<Pair>& chunk : found)
    for (const Pair& pair : chunk) ++begin_[pair.first + 1];
  for (std::size_t i = 0; i < count; ++i) begin_[i + 1] += begin_[i];
  patch_.resize(begin_.back());
  std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
  for (const std::vector<Pair>& chunk : found)
    for (const Pair& pair : chunk) patch_[next[pair.first]++] = pair.second;
}

bool blend_tile(std::span<const QuadricPatch> patches, std::span<const std::uint32_t> here,
                const Vec3& middle, double voxel_mm, double tolerance_mm, Tile& out) {
  if (here.empty()) return false;
  Sums sums;
  const auto add = has_avx2() ? &add_wide : &add_narrow;
  for (const std::uint32_t k : here) add(Form(patches[k], middle, voxel_mm), sums);
  const auto tolerance = static_cast<float>(tolerance_mm / voxel_mm);
  bool agreed = true;
  for (std::size_t i = 0; i < kTileCount; ++i) {
    const std::size_t row = i / kNodesAtOnce, lane = i % kNodesAtOnce;
    const float per = 1.0f / sums.weight[row][lane];
    out[i] = sums.distance[row][lane] * per;
    agreed = agreed && sums.square[row][lane] * per - out[i] * out[i] <= tolerance * tolerance;
  }
  return agreed;
}

}  // namespace palpate::spline_sdf
