#include <algorithm>
#include <array>
#include <atomic>
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

double chebyshev(const Candidates& c, std::size_t i, const Vec3& p) noexcept {
  return std::max({std::abs(c.x[i] - p.x()), std::abs(c.y[i] - p.y()), std::abs(c.z[i] - p.z())});
}

/// The eight nearest by (distance, index) of the candidates within the block.
void store_within(double half_mm, std::uint32_t self, const Vec3& p, const Candidates& c, Neighbours& out) {
  BestEight best;
  for (std::size_t i = 0; i < c.size(); ++i) {
    if (c.index[i] == self || chebyshev(c, i, p) > half_mm) continue;
    const double dx = c.x[i] - p.x(), dy = c.y[i] - p.y(), dz = c.z[i] - p.z();
    best.offer(dx * dx + dy * dy + dz * dz, c.index[i]);
  }
  best.store(self, out);
}

}  // namespace

double mean_spacing_mm(const cloud::Cloud& cloud) {
  return KnnEngine(cloud, 1).mean_spacing_mm();
}

NeighbourTable modified_knn(const cloud::Cloud& cloud, const ModifiedKnnOptions& options, int threads,
                            ModifiedKnnReport* report) {
  const KnnEngine engine(cloud, threads);
  const Sizes sizes = sizes_of(options, engine.mean_spacing_mm());
  std::atomic<std::uint64_t> at_nine{0}, at_limit{0}, fewer{0};
  NeighbourTable table;
  engine.run(
      [&](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out) {
        // The blocks' counts follow from the nearest points in the cube metric: a block holds at least nine
        // points exactly when the eighth other point is within it.
        BestEight cube;
        constexpr std::size_t kBlock = 64;
        double distance[kBlock];
        for (std::size_t first = 0; first < c.size(); first += kBlock) {
          const std::size_t n = std::min(kBlock, c.size() - first);
          const double *x = c.x.data() + first, *y = c.y.data() + first, *z = c.z.data() + first;
          for (std::size_t i = 0; i < n; ++i)
            distance[i] =
                std::max(std::max(std::abs(x[i] - p.x()), std::abs(y[i] - p.y())), std::abs(z[i] - p.z()));
          for (std::size_t i = 0; i < n; ++i)
            if (distance[i] <= cube.worst() && c.index[first + i] != self)
              cube.offer(distance[i], c.index[first + i]);
        }
        // The smallest block with nine points or more, if any block up to the limit has them.
        const double* begin = sizes.half_mm.data();
        const double* end = begin + sizes.count;
        const double* first_below = std::lower_bound(begin, end, cube.worst(),
                                                     [](double half, double reach) { return half >= reach; });
        const bool limit_reached = first_below == begin;
        const double needed_mm = limit_reached ? begin[0] : first_below[-1];
        if (needed_mm > radius_mm) return false;
        if (limit_reached) {
          store_within(begin[0], self, p, c, out);
          at_limit.fetch_add(1, std::memory_order_relaxed);
          if (cube.count() < kNeighbours || cube.worst() > begin[0])
            fewer.fetch_add(1, std::memory_order_relaxed);
          return true;
        }
        // Those within the block, once for counting and choosing.
        BestEight near;
        std::size_t held = 1;
        for (std::size_t i = 0; i < c.size(); ++i) {
          if (!(chebyshev(c, i, p) <= needed_mm) || c.index[i] == self) continue;
          ++held;
          const double dx = c.x[i] - p.x(), dy = c.y[i] - p.y(), dz = c.z[i] - p.z();
          near.offer(dx * dx + dy * dy + dz * dz, c.index[i]);
        }
        if (held <= kAtMost) {
          at_nine.fetch_add(1, std::memory_order_relaxed);
        } else if (!options.complete_to_eight) {
          // As printed: the largest block with at most nine, which then holds fewer than nine.
          at_nine.fetch_add(1, std::memory_order_relaxed);
          fewer.fetch_add(1, std::memory_order_relaxed);
          store_within(first_below == end ? 0.0 : *first_below, self, p, c, out);
          return true;
        }
        near.store(self, out);
        return true;
      },
      table);
  if (report != nullptr) *report = {at_nine.load(), at_limit.load(), fewer.load()};
  return table;
}

}  // namespace palpate::neighbourhood
