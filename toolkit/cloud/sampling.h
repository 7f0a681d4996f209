// Samples surfaces: generators' formulas, and meshes.
//
// Each generator's surface has a grid of points and patches for other samplings: random, scan lines, and blue
// noise (random positions with a least distance, over any density). Defects of a scanner are noise, outliers
// and a shuffled order. A sampled mesh stays the truth and shares no vertex with the points.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"

namespace palpate::cloud {

/// Uses of random numbers, each with its own sequence.
enum class RandomUse : std::uint64_t { kPlace = 1, kLine, kNoise, kOutlier, kOrder, kView = 11, kRay };
[[nodiscard]] Random random_for(RandomUse use, std::uint64_t seed, std::size_t index);

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

/// Values of the options of sampling.
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

/// Least distance of blue noise over the mean spacing. Random disks cover at most 0.547 of the plane, which
/// is 0.83 spacings; at 0.7 about ten candidates a point suffice.
inline constexpr double kPoissonDiskDistance = 0.7;
/// After this many candidates a point the distance shrinks: remaining openings are too small to find.
inline constexpr double kCandidatesPerPoint = 16.0;
inline constexpr double kDistanceShrink = 0.95;

struct DiskSample {
  Vec3 point = Vec3::Zero();
  int sheet = 0;
  Vec3 facing = Vec3::Zero();  ///< outward, any length; zero: unknown
};

/// Accepted places in a hash of cubes; places on one sheet (not facing apart) keep the distance.
class AcceptedSamples {
 public:
  AcceptedSamples(std::size_t most, double cell_mm, const Vec3& low) : cell_(cell_mm), low_(low) {
    std::size_t size = 1;
    while (size < 2 * most) size *= 2;
    first_.assign(size, kNone);
  }
  [[nodiscard]] bool far_from_all(const DiskSample& pick, double distance) const {
    const auto cell = cell_of(pick.point);
    for (std::int64_t x = -1; x <= 1; ++x)
      for (std::int64_t y = -1; y <= 1; ++y)
        for (std::int64_t z = -1; z <= 1; ++z)
          for (std::uint32_t i = first_[slot(cell[0] + x, cell[1] + y, cell[2] + z)]; i != kNone;
               i = next_[i])
            if (sheets_[i] == pick.sheet && (facing_.empty() || facing_[i].dot(pick.facing) >= 0.0) &&
                (points_[i] - pick.point).squaredNorm() < distance * distance)
              return false;
    return true;
  }
  void add(const DiskSample& pick) {
    const auto cell = cell_of(pick.point);
    std::uint32_t& first = first_[slot(cell[0], cell[1], cell[2])];
    next_.push_back(first);
    first = static_cast<std::uint32_t>(points_.size());
    points_.push_back(pick.point);
    sheets_.push_back(pick.sheet);
    if (!pick.facing.isZero()) facing_.push_back(pick.facing);
  }
  [[nodiscard]] std::size_t size() const { return points_.size(); }
  [[nodiscard]] std::vector<Vec3>& points() { return points_; }
  [[nodiscard]] std::vector<Vec3>& facing() { return facing_; }

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  [[nodiscard]] std::array<std::int64_t, 3> cell_of(const Vec3& p) const {
    const Vec3 at = ((p - low_) / cell_).array().floor();
    return {static_cast<std::int64_t>(at.x()), static_cast<std::int64_t>(at.y()),
            static_cast<std::int64_t>(at.z())};
  }
  [[nodiscard]] std::size_t slot(std::int64_t x, std::int64_t y, std::int64_t z) const {
    auto key = static_cast<std::uint64_t>(x);
    for (const std::int64_t next : {y, z})
      key = (key ^ (key >> 32)) * kGolden64 + static_cast<std::uint64_t>(next);
    key = (key ^ (key >> 32)) * kGolden64;
    return static_cast<std::size_t>(key >> 20) & (first_.size() - 1);
  }

  double cell_;
  Vec3 low_;
  std::vector<std::uint32_t> first_, next_;
  std::vector<Vec3> points_;
  std::vector<int> sheets_;
  std::vector<Vec3> facing_;  ///< empty: unknown
};

/// Dart throwing: keeps candidates far enough from earlier ones. `Table`: DiskSample pick(Random&), double
/// weight() (sum of area x density), double density_at(point), at most 1. `random_of(i)`: candidate i's
/// random sequence. Independent of the number of threads. `facing`: per place, if the table has it.
template <class Table, class RandomOf>
[[nodiscard]] std::vector<Vec3> poisson_disk_samples(const Table& table, std::size_t count, const Vec3& low,
                                                     const RandomOf& random_of,
                                                     std::vector<Vec3>* facing = nullptr) {
  // Points per area at the densest; the distance follows the local density.
  const double densest = static_cast<double>(count) / table.weight();
  const double sparsest = densest * table.density_at(low);
  double distance = kPoissonDiskDistance;
  AcceptedSamples kept(count, kPoissonDiskDistance / std::sqrt(sparsest), low);
  std::vector<DiskSample> candidates(kPointsPerChunk);
  double tried = 0.0;
  for (std::size_t block = 0; kept.size() < count; ++block) {
    parallel_each(candidates.size(), kPointsPerChunk / 16, 0, [&](std::size_t i) {
      Random random = random_of(block * candidates.size() + i);
      candidates[i] = table.pick(random);
    });
    for (const DiskSample& pick : candidates) {
      if (kept.size() == count) break;
      const double spacing = 1.0 / std::sqrt(densest * table.density_at(pick.point));
      if (kept.far_from_all(pick, distance * spacing)) kept.add(pick);
      if (++tried < kCandidatesPerPoint * static_cast<double>(count)) continue;
      tried = 0.0;
      distance *= kDistanceShrink;
    }
  }
  if (facing != nullptr) *facing = std::move(kept.facing());
  return std::move(kept.points());
}

struct MeshSampling {
  std::string name;
  std::string summary;
  std::vector<OptionSpec> options;
};

/// random: uniform by area. blue: the same with a least distance of 0.7 spacings. scan: a simulated scanner's
/// rays (scanner.h).
[[nodiscard]] const std::vector<MeshSampling>& mesh_samplings();
[[nodiscard]] const MeshSampling* find_mesh_sampling(std::string_view name);

/// `given` completed by the sampling's defaults.
[[nodiscard]] Result<Options> complete_sampling(const NamedOptions& given);

struct MeshSamples {
  Cloud cloud;                                          ///< without a raster
  std::shared_ptr<const geometry::TriangleMesh> truth;  ///< the sampled mesh or its subdivision
  std::string spec;                                     ///< the sampling with every option
  double spacing_mm = 0.0;  ///< sqrt(area / points); for a scan the distance of rays
  double edge_mm = 0.0;     ///< median edge of `truth`
};

/// Options of all: `points`, or `spacing` in median edges of the truth (default 1); `subdivide`: rounds of
/// Loop subdivision first; `noise` in spacings (along the facet's normal, or a scan's ray); `seed`.
/// Independent of the number of threads. Errors: a mesh without area, unknown names and options, too many
/// points.
[[nodiscard]] Result<MeshSamples> sample_mesh(std::shared_ptr<const geometry::TriangleMesh> mesh,
                                              const NamedOptions& spec);

}  // namespace palpate::cloud
