#include "toolkit/smooth/tile_nodes.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "toolkit/core/lanes.h"

namespace palpate::render {
namespace {

/// A surface bends no tighter than where this share of its radius is left between it and the node.
constexpr float kLeastBend = 0.2f, kBendFade = 5.0f;
/// Nodes nearer than half a voxel to two patches of one face blend both; farther off the nearer one decides.
constexpr float kNearSquare = 0.25f;
constexpr int kLengthSteps = 3;

/// A part of a tile is two rows beside each other: the middles of the parts along x and y, and where a part's
/// nodes are from its middle along y and z.
constexpr std::size_t kTileParts = 8, kPartNodes = 8;
constexpr std::array<float, kTileParts> kPartX{-1.5f, -1.5f, -0.5f, -0.5f, 0.5f, 0.5f, 1.5f, 1.5f};
constexpr std::array<float, kTileParts> kPartY{-1.0f, 1.0f, -1.0f, 1.0f, -1.0f, 1.0f, -1.0f, 1.0f};
constexpr std::array<float, kPartNodes> kNodeY{-0.5f, -0.5f, -0.5f, -0.5f, 0.5f, 0.5f, 0.5f, 0.5f};
constexpr std::array<float, kPartNodes> kNodeZ{-1.5f, -0.5f, 0.5f, 1.5f, -1.5f, -0.5f, 0.5f, 1.5f};

/// How far a part's nodes are from its middle, square to n.
float part_radius(const std::array<float, 3>& n) {
  constexpr float kHalfSq = 0.5f * 0.5f + 1.5f * 1.5f;
  const float least_along = std::abs(0.5f * std::abs(n[1]) - 1.5f * std::abs(n[2]));
  return std::sqrt(std::max(kHalfSq - least_along * least_along, 0.0f));
}

#define PALPATE_NODES narrow
#define PALPATE_LANES 4
#define PALPATE_TARGET
#include "toolkit/smooth/tile_nodes.inl"
#undef PALPATE_NODES
#undef PALPATE_LANES
#undef PALPATE_TARGET

#if defined(__x86_64__)
#define PALPATE_NODES wide
#define PALPATE_LANES 8
#define PALPATE_TARGET __attribute__((target("avx2")))
#include "toolkit/smooth/tile_nodes.inl"
#undef PALPATE_NODES
#undef PALPATE_LANES
#undef PALPATE_TARGET
#endif

}  // namespace

void add_to_tile(const TilePatch& patch, TileSums& sums) {
#if defined(__x86_64__)
  static const bool kWide = wide_lanes();  // asked for every patch of a tile
  if (kWide) {
    wide::add(patch, sums);
    return;
  }
#endif
  narrow::add(patch, sums);
}

}  // namespace palpate::render
