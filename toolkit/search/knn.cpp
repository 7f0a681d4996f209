#include "toolkit/search/knn.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "toolkit/search/knn_engine.h"

namespace palpate::search {
namespace {

/// Cubes shrink from the growth limit to 2^-96 of it, which separates any distinct floats around a spacing.
constexpr double kLeastShare = 0x1.0p-96;
/// A block is the cube with one layer of equal cubes: three edges wide, 1.5 from its centre.
constexpr double kBlockHalfPerEdge = 1.5;
/// "at most nine (eight neighbours plus the point of interest)".
constexpr std::size_t kAtMost = kNeighbours + 1;

/// Half widths of the blocks, largest first.
struct Sizes {
  std::vector<double> half_mm;
  std::size_t count = 0;
};

Sizes sizes_of(const ModifiedKnnOptions& options, double spacing_mm) {
  Sizes sizes;
  const double start = kBlockHalfPerEdge * options.start_size * spacing_mm;
  double largest = start;
  while (largest / options.refinement <= start * options.growth_limit) largest /= options.refinement;
  for (double half = largest; half > kLeastShare * largest; half *= options.refinement)
    sizes.half_mm.push_back(half);
  sizes.count = sizes.half_mm.size();
  return sizes;
}

/// A block that holds nine points.
struct Block {
  std::size_t size = 0;  ///< into Sizes; Sizes::count for none
  std::size_t held = 0;  ///< points in it
};

/// Sieves to the smallest block that holds nine points, as far as the candidates tell; none if the blocks up
/// to `largest_mm` (or the largest of all) hold fewer.
Block smallest_with_nine(const Kernels& kernel, const Sizes& sizes, const Vec3& p, const Candidates& c,
                         double largest_mm, KnnScratch& scratch) {
  // Counts for a size and the next smaller; after the smallest comes an empty cube.
  const auto count = [&](std::size_t at) {
    return kernel.count_in_cubes(scratch, sizes.half_mm[at],
                                 at + 1 < sizes.count ? sizes.half_mm[at + 1] : -1.0);
  };
  std::size_t at = std::min(scratch.size_guess, sizes.count - 1);
  kernel.keep_cube(c, p, sizes.half_mm[at], scratch);
  CubeCounts held = count(at);
  while (held.outer < kAtMost) {
    if (at == 0 || sizes.half_mm[at - 1] > largest_mm) return {sizes.count, held.outer};
    --at;
    kernel.keep_cube(c, p, sizes.half_mm[at], scratch);
    held = count(at);
  }
  while (held.inner >= kAtMost) held = count(++at);
  return {at, held.outer};
}

/// The eight nearest by (distance, index) of the kept candidates in the cube.
void store_within(const Kernels& kernel, double half_mm, std::uint32_t self, Neighbours& out,
                  KnnScratch& scratch) {
  kernel.exclude_cube(scratch, half_mm);
  kernel.choose_eight(self, scratch, out);
}

/// Places in KnnScratch::sums.
enum BlockSum : std::size_t { kAtNine, kAtLimit, kFewer };

}  // namespace

double mean_spacing_mm(const cloud::Cloud& cloud) {
  return KnnEngine(cloud, 1).mean_spacing_mm();
}

NeighbourTable modified_knn(const cloud::Cloud& cloud, const ModifiedKnnOptions& options, int threads,
                            ModifiedKnnReport* report) {
  const KnnEngine engine(cloud, threads);
  const Sizes sizes = sizes_of(options, engine.mean_spacing_mm());
  const Kernels& kernel = kernels();
  NeighbourTable table;
  const auto sums = engine.run(
      [&](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
          KnnScratch& scratch) {
        const Block block = smallest_with_nine(kernel, sizes, p, c, radius_mm, scratch);
        const std::size_t size = block.size;
        const bool at_limit = size == sizes.count;
        const double needed_mm = sizes.half_mm[at_limit ? 0 : size];
        if (needed_mm > radius_mm) return false;
        scratch.size_guess = at_limit ? 0 : size;
        if (!at_limit && !options.complete_to_eight && block.held > kAtMost) {
          // As printed: the largest block with at most nine points, which may hold fewer.
          ++scratch.sums[kAtNine];
          ++scratch.sums[kFewer];
          const bool smallest = size + 1 == sizes.count;
          store_within(kernel, smallest ? 0.0 : sizes.half_mm[size + 1], self, out, scratch);
          return true;
        }
        store_within(kernel, needed_mm, self, out, scratch);
        if (at_limit) {
          ++scratch.sums[kAtLimit];
          scratch.sums[kFewer] += block.held < kAtMost;
        } else {
          scratch.sums[kAtNine] += block.held == kAtMost;
        }
        return true;
      },
      table);
  if (report != nullptr) *report = {sums[kAtNine], sums[kAtLimit], sums[kFewer]};
  return table;
}

namespace {

/// 2^(3/4), the geometric mean of sqrt(2) and 2: on a square grid exactly eight points are within it.
constexpr double kDefaultSpacings = 1.681792830507429;

/// Places in KnnScratch::sums.
enum WithinSum : std::size_t { kMoreThanEight, kFewerThanEight, kWithin };

}  // namespace

NeighbourTable fixed_distance(const cloud::Cloud& cloud, const FixedDistanceOptions& options, int threads,
                              FixedDistanceReport* report) {
  const KnnEngine engine(cloud, threads);
  const Kernels& kernel = kernels();
  const double distance_mm =
      options.distance_mm > 0.0 ? options.distance_mm : kDefaultSpacings * engine.mean_spacing_mm();
  const double limit = distance_mm * distance_mm;
  NeighbourTable table;
  const auto sums = engine.run(
      [&](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
          KnnScratch& scratch) {
        if (!(distance_mm < radius_mm) && radius_mm != kNoLimit) return false;
        kernel.keep_ball(c, p, limit, scratch);
        std::uint64_t within = 0;
        for (std::size_t k = 0; k < scratch.count; ++k) {
          // The sieve may keep points a rounding farther.
          const bool in = scratch.square[k] <= limit;
          if (!in) scratch.square[k] = kNoLimit;
          within += static_cast<std::uint64_t>(in && scratch.index[k] != self);
        }
        kernel.choose_eight(self, scratch, out);
        scratch.sums[kMoreThanEight] += within > kNeighbours;
        scratch.sums[kFewerThanEight] += within < kNeighbours;
        scratch.sums[kWithin] += within;
        return true;
      },
      table);
  if (report != nullptr) *report = {distance_mm, sums[kMoreThanEight], sums[kFewerThanEight], sums[kWithin]};
  return table;
}

NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads) {
  const KnnEngine engine(cloud, threads);
  const Kernels& kernel = kernels();
  NeighbourTable table;
  engine.run(
      [&kernel](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
                KnnScratch& scratch) {
        const double covered = radius_mm * radius_mm;
        for (double guess = scratch.guess;; guess = larger_guess(guess)) {
          const bool all = !(guess < covered);
          kernel.keep_ball(c, p, all ? kNoLimit : guess, scratch);
          const double worst = kernel.choose_eight(self, scratch, out);
          // Candidates are complete up to the guess.
          if (!all && !(worst <= guess)) continue;
          scratch.guess = kGuessMarginSq * worst;
          return worst < covered || radius_mm == kNoLimit;
        }
      },
      table);
  return table;
}

}  // namespace palpate::search
