#include "toolkit/search/knn.h"

#include "toolkit/search/knn_engine.h"

namespace palpate::search {
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

}  // namespace palpate::search
