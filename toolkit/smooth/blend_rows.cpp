#include "toolkit/smooth/blend_rows.h"

#include "toolkit/core/lanes.h"

namespace palpate::render {
namespace {

/// A surface bends no tighter than where this share of its radius is left between it and the node.
constexpr float kLeastBend = 0.2f, kBendFade = 5.0f;
/// By how much curvature may move a foot along the tangent plane, in voxels, beyond where nodes count.
constexpr float kFootRoom = 1.0f;
/// Nodes nearer than half a voxel to two patches of one face blend both; farther off the nearer one decides.
constexpr float kNearSquare = 0.25f;
constexpr float kHalfRow = 3.0f;
constexpr int kLengthSteps = 3;
constexpr std::array<float, kRowLanes> kAlong{-3.0f, -2.0f, -1.0f, 0.0f, 1.0f, 2.0f, 3.0f, 3.0f};

#define PALPATE_ROWS narrow
#define PALPATE_LANES 4
#define PALPATE_TARGET
#include "toolkit/smooth/blend_rows.inl"
#undef PALPATE_ROWS
#undef PALPATE_LANES
#undef PALPATE_TARGET

#if defined(__x86_64__)
#define PALPATE_ROWS wide
#define PALPATE_LANES 8
#define PALPATE_TARGET __attribute__((target("avx2")))
#include "toolkit/smooth/blend_rows.inl"
#undef PALPATE_ROWS
#undef PALPATE_LANES
#undef PALPATE_TARGET
#endif

}  // namespace

void add_to_rows(const RowPatch& patch, RowSums& sums) {
#if defined(__x86_64__)
  static const bool kWide = wide_lanes();  // asked for every row
  if (kWide) {
    wide::add(patch, sums);
    return;
  }
#endif
  narrow::add(patch, sums);
}

}  // namespace palpate::render
