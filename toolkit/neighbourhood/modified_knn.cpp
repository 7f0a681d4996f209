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

void chebyshev_distances(const Candidates& c, const Vec3& p, Scratch& scratch) {
  scratch.key.resize(c.size());
  const double *x = c.x.data(), *y = c.y.data(), *z = c.z.data();
  const double px = p.x(), py = p.y(), pz = p.z();
  double* key = scratch.key.data();
  const std::size_t n = c.size();
  for (std::size_t i = 0; i < n; ++i) {
    const double xy = std::max(std::abs(x[i] - px), std::abs(y[i] - py));
    key[i] = std::max(xy, std::abs(z[i] - pz));
  }
}

std::size_t count_within(const std::vector<double>& key, double half_mm) noexcept {
  std::size_t count = 0;
  for (const double k : key) count += static_cast<std::size_t>(k <= half_mm);
  return count;
}

/// The smallest block that holds nine points, as far as the candidates tell; `sizes.count` where none does.
std::size_t smallest_with_nine(const Sizes& sizes, const std::vector<double>& key,
                               std::size_t guess) noexcept {
  std::size_t at = std::min(guess, sizes.count - 1);
  while (count_within(key, sizes.half_mm[at]) < kAtMost) {
    if (at == 0) return sizes.count;
    --at;
  }
  while (at + 1 < sizes.count && count_within(key, sizes.half_mm[at + 1]) >= kAtMost) ++at;
  return at;
}

/// The eight nearest by (distance, index) of the candidates in the block, whose keys are cube distances.
/// Returns how many the block holds.
std::size_t store_within(double half_mm, std::uint32_t self, const Vec3& p, const Candidates& c,
                         Neighbours& out, Scratch& scratch) {
  keep_within(half_mm, scratch);
  for (const std::uint32_t i : scratch.kept) {
    const double dx = c.x[i] - p.x(), dy = c.y[i] - p.y(), dz = c.z[i] - p.z();
    scratch.key[i] = dx * dx + dy * dy + dz * dz;
  }
  choose_eight(self, c, scratch.key, scratch.kept, out);
  return scratch.kept.size();
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
        chebyshev_distances(c, p, scratch);
        const std::size_t size = smallest_with_nine(sizes, scratch.key, scratch.size_guess);
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
