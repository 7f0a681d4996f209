#include "toolkit/spline_sdf/orient_patches.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "toolkit/core/parallel.h"
#include "toolkit/spline_sdf/patch_hash_grid.h"

namespace palpate::render {
namespace {

/// A patch is off another if farther than this many standard deviations or spacings, and unrelated beyond the
/// largest distance.
constexpr double kBesideSigmas = 3.5, kBesideSpacings = 0.5, kBesideMost = 12.0;
/// A patch of points sparser than the other's by this factor is the same surface seen widely from a stray
/// point.
constexpr double kMuchSparser = 2.0;
constexpr std::size_t kBesideGrain = 256;

bool is_outlier_beside(const QuadricPatch& p, const QuadricPatch& reliable) {
  const Quadric& q = reliable.quadric;
  const double off = std::abs(q.residual(p.quadric.at));
  if (off > kBesideMost * reliable.spacing) return false;
  if (p.spacing < kMuchSparser * reliable.spacing &&
      off < std::max(kBesideSigmas * std::max(reliable.sigma, reliable.noise),
                     kBesideSpacings * reliable.spacing))
    return false;
  const Vec3 d = p.quadric.at - q.at;
  const double per = 1.0 / reliable.extent;
  return reliable.occupancy.around(d.dot(q.u) * per, d.dot(q.v) * per);
}

}  // namespace

void drop_outlier_patches(std::vector<QuadricPatch>& patches, int threads) {
  if (std::all_of(patches.begin(), patches.end(), [](const QuadricPatch& p) { return p.reliable; })) return;
  const PatchHashGrid cells(patches);
  std::vector<std::uint8_t> beside(patches.size(), 0);
  parallel_chunks(patches.size(), kBesideGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const QuadricPatch& p = patches[i];
      if (p.reliable) continue;
      for (int s = cells.scale_of(p.support); s < kPatchScales && beside[i] == 0; ++s) {
        if (!cells.any(s)) continue;
        cells.near(p.quadric.at, s, [&](std::uint32_t j) {
          if (beside[i] == 0 && patches[j].reliable && is_outlier_beside(p, patches[j])) beside[i] = 1;
        });
      }
    }
  });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < patches.size(); ++i)
    if (beside[i] == 0) patches[kept++] = patches[i];
  patches.resize(kept);
}

}  // namespace palpate::render
