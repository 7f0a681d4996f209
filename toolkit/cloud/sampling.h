// Samplings besides the grid (random, blue noise, scan lines), and scanner defects: noise, outliers, shuffled
// order. Internal to cloud.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/aabb.h>
#include "toolkit/cloud/shapes.h"

namespace palpate::cloud {

enum class Sampling { kGrid, kRandom, kBlue, kLines, kScan };

/// What the options of sampling say.
struct SamplingOptions {
  Sampling way = Sampling::kGrid;
  double ratio = 8.0;     ///< lines: their distance over that of points along them
  double density = 1.0;   ///< ratio of densities for x above and below the middle
  double noise = 0.0;     ///< standard deviation along the normal, in spacings
  double outliers = 0.0;  ///< share of the points
  bool outliers_near = true;
  bool shuffle = false;
  /// Grid points at their exact places.
  [[nodiscard]] bool in_place() const { return way == Sampling::kGrid && noise == 0.0 && outliers == 0.0; }
};

struct Sampled {
  std::vector<Vec3> points_mm;
  double spacing_mm = 0.0;  ///< sqrt(area / points)
};

/// Samples the patches other than by the grid: as many points as `common` asks for, the nearest that lines
/// allow. Independent of the number of threads. O(n); blue noise takes about ten candidates a point.
[[nodiscard]] Sampled sample_patches(const std::vector<Patch>& patches, const geometry::Aabb& box,
                                     const SamplingOptions& options, const CommonOptions& common);
/// The number of points, before sampling.
[[nodiscard]] double count_patches(const std::vector<Patch>& patches, const CommonOptions& common);

/// Adds noise and outliers in place, both in units of `spacing_mm`.
void add_noise_and_outliers(const Shape& shape, double spacing_mm, const SamplingOptions& options,
                            std::uint64_t seed, std::vector<Vec3>& points_mm);

/// A uniform permutation: order[i] is the place that goes to i.
[[nodiscard]] std::vector<std::uint32_t> random_permutation(std::size_t count, std::uint64_t seed);

}  // namespace palpate::cloud
