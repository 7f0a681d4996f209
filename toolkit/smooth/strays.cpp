#include "toolkit/smooth/strays.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/patch_cells.h"

namespace palpate::render {
namespace {

/// A patch lies off another one from so many standard deviations, or spacings, on: nearer, it is a part of
/// it. Farther than so many spacings it has nothing to do with it.
constexpr double kBesideSigmas = 3.5, kBesideSpacings = 0.5, kBesideMost = 12.0;
/// A patch of points so much sparser than those of the other one is what a wide look from a stray point shows
/// of the same surface.
constexpr double kMuchSparser = 2.0;
constexpr std::size_t kBesideGrain = 256;

bool lies_beside(const Patch& p, const Patch& sure) {
  const Quadric& q = sure.quadric;
  const double off = std::abs(q.residual(p.quadric.at));
  if (off > kBesideMost * sure.spacing) return false;
  if (p.spacing < kMuchSparser * sure.spacing &&
      off < std::max(kBesideSigmas * std::max(sure.sigma, sure.noise), kBesideSpacings * sure.spacing))
    return false;
  const Vec3 d = p.quadric.at - q.at;
  const double per = 1.0 / sure.reached;
  return sure.filled.around(d.dot(q.u) * per, d.dot(q.v) * per);
}

}  // namespace

void drop_beside_sure(std::vector<Patch>& patches, int threads) {
  if (std::all_of(patches.begin(), patches.end(), [](const Patch& p) { return p.sure; })) return;
  const PatchCells cells(patches);
  std::vector<std::uint8_t> beside(patches.size(), 0);
  parallel_chunks(patches.size(), kBesideGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Patch& p = patches[i];
      if (p.sure) continue;
      for (int s = cells.scale_of(p.support); s < kPatchScales && beside[i] == 0; ++s) {
        if (!cells.any(s)) continue;
        cells.near(p.quadric.at, s, [&](std::uint32_t j) {
          if (beside[i] == 0 && patches[j].sure && lies_beside(p, patches[j])) beside[i] = 1;
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
