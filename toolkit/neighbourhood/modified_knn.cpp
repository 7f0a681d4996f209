#include <algorithm>
#include <array>
#include <cmath>

#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/knn_engine.h"

namespace palpate::neighbourhood {
namespace {

/// Sizes a cube may take, from the growth limit down; 2^-64 of the limit divides anything a float can hold
/// apart.
constexpr std::size_t kMaxSizes = 192;
/// A block is the cube and the layer of its like around it: three edges wide, 1.5 from its middle.
constexpr double kBlockHalfPerEdge = 1.5;
/// "at most nine (eight neighbours plus the point of interest)".
constexpr std::size_t kAtMost = kNeighbours + 1;

/// The half widths of the blocks tried, largest first.
struct Sizes {
  std::array<double, kMaxSizes> half_mm{};
  std::size_t count = 0;
};

Sizes sizes_of(const ModifiedKnnOptions& options, double spacing_mm) {
  Sizes sizes;
  const double start = kBlockHalfPerEdge * options.start_size * spacing_mm;
  double largest = start;
  while (largest / options.refinement <= start * options.growth_limit) largest /= options.refinement;
  for (double half = largest; sizes.count < kMaxSizes && half > 0.0; half *= options.refinement)
    sizes.half_mm[sizes.count++] = half;
  return sizes;
}

std::size_t count_within(const std::vector<double>& key, double half_mm) noexcept {
  std::size_t count = 0;
  for (const double k : key) count += static_cast<std::size_t>(k <= half_mm);
  return count;
}

/// Sieves to the smallest block that holds nine points, as far as the candidates tell; `sizes.count` where
/// none up to `largest_mm` does (or the largest of all, when that is smaller).
std::size_t smallest_with_nine(const Sizes& sizes, const Vec3& p, const Candidates& c, double largest_mm,
                               Scratch& scratch) {
  std::size_t at = std::min(scratch.size_guess, sizes.count - 1);
  keep_cube(c, p, sizes.half_mm[at], scratch);
  while (count_within(scratch.key, sizes.half_mm[at]) < kAtMost) {
    if (at == 0 || sizes.half_mm[at - 1] > largest_mm) return sizes.count;
    --at;
    keep_cube(c, p, sizes.half_mm[at], scratch);
  }
  while (at + 1 < sizes.count && count_within(scratch.key, sizes.half_mm[at + 1]) >= kAtMost) ++at;
  return at;
}

/// The eight nearest by (distance, index) of the kept candidates in the block; their keys are cube distances
/// before, squared ones after. Returns how many the block holds.
std::size_t store_within(double half_mm, std::uint32_t self, const Vec3& p, const Candidates& c,
                         Neighbours& out, Scratch& scratch) {
  std::size_t held = 0;
  for (std::size_t k = 0; k < scratch.kept.size(); ++k) {
    const std::uint32_t i = scratch.kept[k];
    const bool in = scratch.key[k] <= half_mm;
    const double dx = static_cast<double>(c.x[i]) - p.x(), dy = static_cast<double>(c.y[i]) - p.y(),
                 dz = static_cast<double>(c.z[i]) - p.z();
    scratch.kept[held] = i;
    scratch.key[held] = dx * dx + dy * dy + dz * dz;
    held += static_cast<std::size_t>(in);
  }
  scratch.kept.resize(held);
  scratch.key.resize(held);
  choose_eight(self, c, scratch, out);
  return held;
}

/// Places in Scratch::sums.
enum Sum : std::size_t { kAtNine, kAtLimit, kFewer };

}  // namespace

double mean_spacing_mm(const cloud::Cloud& cloud) {
  return KnnEngine(cloud, 1).mean_spacing_mm();
}

NeighbourTable modified_knn(const cloud::Cloud& cloud, const ModifiedKnnOptions& options, int threads,
                            ModifiedKnnReport* report) {
  const KnnEngine engine(cloud, threads);
  const Sizes sizes = sizes_of(options, engine.mean_spacing_mm());
  NeighbourTable table;
  const auto sums = engine.run(
      [&](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
          Scratch& scratch) {
        const std::size_t size = smallest_with_nine(sizes, p, c, radius_mm, scratch);
        const bool at_limit = size == sizes.count;
        const double needed_mm = sizes.half_mm[at_limit ? 0 : size];
        if (needed_mm > radius_mm) return false;
        scratch.size_guess = at_limit ? 0 : size;
        if (!at_limit && !options.complete_to_eight && count_within(scratch.key, needed_mm) > kAtMost) {
          // As printed: the largest block with at most nine, which then holds fewer than nine.
          ++scratch.sums[kAtNine];
          ++scratch.sums[kFewer];
          const bool smallest = size + 1 == sizes.count;
          store_within(smallest ? 0.0 : sizes.half_mm[size + 1], self, p, c, out, scratch);
          return true;
        }
        const std::size_t held = store_within(needed_mm, self, p, c, out, scratch);
        if (at_limit) {
          ++scratch.sums[kAtLimit];
          scratch.sums[kFewer] += held < kAtMost;
        } else {
          scratch.sums[kAtNine] += held == kAtMost;
        }
        return true;
      },
      table);
  if (report != nullptr) *report = {sums[kAtNine], sums[kAtLimit], sums[kFewer]};
  return table;
}

}  // namespace palpate::neighbourhood
