#include "toolkit/smooth/tile_blend.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "toolkit/core/lanes.h"
#include "toolkit/core/parallel.h"
#include "toolkit/smooth/patch_field.h"

namespace palpate::render {
namespace {

/// Nodes of bricks that a surface goes through are at most so many voxels off it.
constexpr double kFarthestNode = 8.0;
/// Newton steps to the foot of a node: patches that agree are flat across a tile, or nearly.
constexpr int kNodeFootSteps = 2;
/// See PatchField: below this determinant a node is at a centre of curvature.
constexpr float kLeastNodeDeterminant = 0.1f;
/// Beyond its support a patch counts so little that it does only where no other has a say.
constexpr float kBeyond = 1e-6f;
/// A patch tells of no node whose foot is so many supports off, squared.
constexpr float kFarthestShare = 100.0f;
constexpr std::size_t kScatterGrain = 256;

/// A patch relative to the middle of a tile, in voxels.
struct Form {
  float ax, ay, az, ux, uy, uz, vx, vy, vz, nx, ny, nz, uu, uv, vv, per_support_sq, weight;
};

Form form_of(const Patch& p, const Vec3& middle, double voxel_mm) {
  const double per = 1.0 / voxel_mm;
  const Quadric& q = p.quadric;
  const Vec3 at = (q.at - middle) * per;
  const auto f = [](double x) { return static_cast<float>(x); };
  return {f(at.x()),          f(at.y()),
          f(at.z()),          f(q.u.x()),
          f(q.u.y()),         f(q.u.z()),
          f(q.v.x()),         f(q.v.y()),
          f(q.v.z()),         f(q.n.x()),
          f(q.n.y()),         f(q.n.z()),
          f(q.uu * voxel_mm), f(q.uv * voxel_mm),
          f(q.vv * voxel_mm), f(voxel_mm * voxel_mm / (p.support * p.support)),
          f(p.trust)};
}

/// Eight nodes at a time, elementwise; every target rounds them alike.
constexpr std::size_t kNodesAtOnce = 8;
using NodeLanes = float __attribute__((vector_size(kNodesAtOnce * sizeof(float))));
using NodeBits = std::int32_t __attribute__((vector_size(kNodesAtOnce * sizeof(float))));
using TileLanes = std::array<NodeLanes, kTileCount / kNodesAtOnce>;

/// Sums of weights, and of distances and their squares by weight.
struct Sums {
  TileLanes weight{}, distance{}, square{};
};

/// x becomes one over its root. By reference: vectors of eight in registers are another calling convention.
[[gnu::always_inline]] inline void one_over_root(NodeLanes& x) noexcept {
  // A first guess by the bits of the exponent (to 4 %), and Newton steps that square its error.
  const auto bits = reinterpret_cast<NodeBits>(x);
  auto y = reinterpret_cast<NodeLanes>(0x5f3759df - (bits >> 1));
  for (int step = 0; step < 3; ++step) y *= 1.5f - 0.5f * x * y * y;
  x = y;
}

/// Adds a patch's say at all nodes.
[[gnu::always_inline]] inline void add_patch(const Form& p, Sums& sums) noexcept {
  constexpr NodeLanes kZ{-1.5f, -0.5f, 0.5f, 1.5f, -1.5f, -0.5f, 0.5f, 1.5f};
  constexpr NodeLanes kY{-1.5f, -1.5f, -1.5f, -1.5f, -0.5f, -0.5f, -0.5f, -0.5f};
  for (std::size_t i = 0; i < sums.weight.size(); ++i) {
    const float x = static_cast<float>(i / 2) - 1.5f - p.ax;
    const NodeLanes y = kY + (static_cast<float>(2 * (i % 2)) - p.ay), z = kZ - p.az;
    const NodeLanes a = x * p.ux + y * p.uy + z * p.uz, b = x * p.vx + y * p.vy + z * p.vz,
                    h = x * p.nx + y * p.ny + z * p.nz;
    NodeLanes u = a, v = b;
    for (int step = 0; step < kNodeFootSteps; ++step) {
      const NodeLanes off = h - (p.uu * u * u + p.uv * u * v + p.vv * v * v);
      const NodeLanes gu = 2.0f * p.uu * u + p.uv * v, gv = 2.0f * p.vv * v + p.uv * u;
      const NodeLanes ru = a - u + off * gu, rv = b - v + off * gv;
      const NodeLanes uu = 1.0f + gu * gu - 2.0f * off * p.uu, uv = gu * gv - off * p.uv,
                      vv = 1.0f + gv * gv - 2.0f * off * p.vv;
      const NodeLanes determinant = uu * vv - uv * uv,
                      least = determinant - determinant + kLeastNodeDeterminant;
      const NodeLanes per = 1.0f / (determinant > least ? determinant : least);
      u += (vv * ru - uv * rv) * per;
      v += (uu * rv - uv * ru) * per;
    }
    const NodeLanes off = h - (p.uu * u * u + p.uv * u * v + p.vv * v * v);
    const NodeLanes gu = 2.0f * p.uu * u + p.uv * v, gv = 2.0f * p.vv * v + p.uv * u;
    NodeLanes per_slope = 1.0f + gu * gu + gv * gv;
    one_over_root(per_slope);
    const NodeLanes distance = (off - gu * (a - u) - gv * (b - v)) * per_slope;
    const NodeLanes share = (u * u + v * v) * p.per_support_sq, left = 1.0f - share, none{};
    const NodeLanes rest = left > none ? left : none;
    // Beyond its centre of curvature a foot may be anywhere, or no number: such a patch has no say there.
    const auto told = share < none + kFarthestShare;
    const NodeLanes weight =
        told ? p.weight * (rest * rest * rest + kBeyond / ((1.0f + share) * (1.0f + share))) : none;
    const NodeLanes known = told ? distance : none;
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

TilePatches::TilePatches(std::span<const Patch> patches, const BrickGrid& grid, const CellBlocks& tiles,
                         std::span<const std::uint64_t> codes, double voxel_mm, int threads) {
  const std::size_t count = codes.size();
  using Pair = std::pair<std::uint32_t, std::uint32_t>;  // tile, patch
  std::vector<std::vector<Pair>> found((patches.size() + kScatterGrain - 1) / kScatterGrain);
  const double per = 1.0 / voxel_mm;
  parallel_chunks(patches.size(), kScatterGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const Patch& p = patches[k];
      const Vec3 at = (p.quadric.at - grid.low_mm) * per;
      const double reach = p.support * per + kTileReach, high = kFarthestNode + kTileReach;
      Vec3 low, past;
      for (Eigen::Index a = 0; a < 3; ++a) {
        const double n = p.quadric.n[a];
        const double extent = reach * std::sqrt(std::max(1.0 - n * n, 0.0)) + high * std::abs(n);
        // The middle of tile t is at 4 t + 0.5.
        low[a] = std::max(std::ceil((at[a] - extent - 0.5) / kTileNodes), 0.0);
        past[a] = std::floor((at[a] + extent - 0.5) / kTileNodes);
      }
      const auto reaches = [&](const Vec3& tile) {
        const Vec3 d = tile * kTileNodes + Vec3::Constant(0.5) - at;
        const double h = d.dot(p.quadric.n);
        return !(std::abs(h) > high || d.squaredNorm() - h * h > reach * reach);
      };
      std::vector<Pair>& mine = found[begin / kScatterGrain];
      // A patch of coarse points reaches over more tiles than there are small ones.
      if ((past - low + Vec3::Ones()).cwiseMax(0.0).prod() > static_cast<double>(count)) {
        for (std::uint32_t tile = 0; tile < count; ++tile) {
          const BrickGrid::Coordinate c = coordinate_of(codes[tile]);
          if (reaches(Vec3(c[0], c[1], c[2]))) mine.push_back({tile, static_cast<std::uint32_t>(k)});
        }
        continue;
      }
      for (auto x = static_cast<std::int32_t>(low.x()); x <= static_cast<std::int32_t>(past.x()); ++x)
        for (auto y = static_cast<std::int32_t>(low.y()); y <= static_cast<std::int32_t>(past.y()); ++y)
          for (auto z = static_cast<std::int32_t>(low.z()); z <= static_cast<std::int32_t>(past.z()); ++z) {
            if (!reaches(Vec3(x, y, z))) continue;
            const std::uint32_t tile = tiles.find(partition::morton_code(
                static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), static_cast<std::uint32_t>(z)));
            if (tile != CellBlocks::kNone) mine.push_back({tile, static_cast<std::uint32_t>(k)});
          }
    }
  });
  begin_.assign(count + 1, 0);
  for (const std::vector<Pair>& chunk : found)
    for (const Pair& pair : chunk) ++begin_[pair.first + 1];
  for (std::size_t i = 0; i < count; ++i) begin_[i + 1] += begin_[i];
  patch_.resize(begin_.back());
  std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
  for (const std::vector<Pair>& chunk : found)
    for (const Pair& pair : chunk) patch_[next[pair.first]++] = pair.second;
}

bool blend_tile(std::span<const Patch> patches, std::span<const std::uint32_t> here, const Vec3& middle,
                double voxel_mm, double tolerance_mm, Tile& out) {
  if (here.empty()) return false;
  Sums sums;
  const auto add = wide_lanes() ? &add_wide : &add_narrow;
  for (const std::uint32_t k : here) add(form_of(patches[k], middle, voxel_mm), sums);
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

}  // namespace palpate::render
