// The generators' surfaces, each with a grid of points and patches for other samplings (random, blue noise,
// scan lines), and scanner defects: noise, outliers, shuffled order. Internal to cloud.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/aabb.h>
#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/options.h>

namespace palpate::cloud {

using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// Options of every generator; lengths already scaled.
struct CommonOptions {
  double points = 0.0;
  double spacing_mm = 0.0;  ///< 0 = from points
  double extent_mm = 0.0;
  double jitter = 0.0;
  double nonuniform = 0.0;
  std::uint64_t seed = 0;
  double scale = 1.0;
  bool mesh = true;
  std::string order;  ///< of points, if selectable
};

/// Points by index, in mm; triangles on demand.
struct Samples {
  std::size_t count = 0;
  std::function<Vec3(std::size_t)> point;
  std::function<Triangles()> triangles;
  std::optional<ScanRaster> raster;
  double spacing_mm = 0.0;
};

/// A part of a surface over [0, 1]^2. Patches of a sheet meet; different sheets may come close.
struct Patch {
  std::function<Vec3(double u, double v)> point;
  int sheet = 0;
};

struct Shape {
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< null for an unknown kind
  Samples grid;
  std::vector<Patch> patches;    ///< together the surface
  bool is_height_field = false;  ///< z at a place is cheap, the closest place is not

  /// Unit normal at a place of the surface.
  [[nodiscard]] Vec3 normal_at(const Vec3& on_surface) const {
    return is_height_field ? surface->track({on_surface, Vec3::UnitZ()}, on_surface).normal
                           : surface->closest(on_surface).normal;
  }
};

/// From a generator's name and validated options.
[[nodiscard]] Shape shape_of(const std::string& name, const Options& options, const CommonOptions& common);

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
