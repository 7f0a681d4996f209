#include "toolkit/cloud/sampling.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"

namespace palpate::cloud {
namespace {

/// Cells per side of a patch, whose areas give probabilities. Places are uniform in the parameters within a
/// cell.
constexpr std::size_t kCells = 256;
/// Distance of outliers in spacings: beyond noise, near enough to be taken for the surface.
constexpr double kNearestOutlier = 2.0, kFarthestOutlier = 10.0;
/// Pieces in which a scan line's length is measured.
constexpr int kPieces = 64;

/// Cumulative probabilities of a surface's cells.
class AreaTable {
 public:
  AreaTable(const std::vector<Patch>& patches, const geometry::Aabb& box, double density)
      : patches_(patches), middle_x_(box.centre_mm().x()), density_(density) {
    up_to_.resize(patches.size() * kCells * kCells);
    std::vector<double> area(up_to_.size());
    parallel_each(patches.size() * kCells, 1, 0, [&](std::size_t row) { fill_row(row, area); });
    double sum = 0.0;
    for (std::size_t i = 0; i < area.size(); ++i) {
      area_ += area[i];
      sum += area[i] * up_to_[i];
      up_to_[i] = sum;
    }
  }
  [[nodiscard]] double area_mm2() const { return area_; }
  /// The sum of area x density.
  [[nodiscard]] double weight() const { return up_to_.back(); }
  /// Density at p relative to the largest.
  [[nodiscard]] double density_at(const Vec3& p) const { return p.x() > middle_x_ ? 1.0 : 1.0 / density_; }
  [[nodiscard]] DiskSample pick(Random& random) const {
    const double at = random.uniform() * up_to_.back();
    const auto found = std::upper_bound(up_to_.begin(), up_to_.end() - 1, at);
    const auto cell = static_cast<std::size_t>(found - up_to_.begin());
    const Patch& patch = patches_[cell / (kCells * kCells)];
    const double v = static_cast<double>(cell / kCells % kCells), u = static_cast<double>(cell % kCells);
    const double du = random.uniform(), dv = random.uniform();
    return {patch.point((u + du) / kCells, (v + dv) / kCells), patch.sheet, Vec3::Zero()};
  }

 private:
  /// Areas of a row of cells; their densities go to up_to_.
  void fill_row(std::size_t row, std::vector<double>& area) {
    const Patch& patch = patches_[row / kCells];
    const double v0 = static_cast<double>(row % kCells) / kCells,
                 v1 = static_cast<double>(row % kCells + 1) / kCells;
    Vec3 low = patch.point(0.0, v0), high = patch.point(0.0, v1);
    for (std::size_t i = 0; i < kCells; ++i) {
      const double u = static_cast<double>(i + 1) / kCells;
      const Vec3 next_low = patch.point(u, v0), next_high = patch.point(u, v1);
      area[row * kCells + i] = 0.5 * (next_high - low).cross(high - next_low).norm();
      up_to_[row * kCells + i] = density_at(0.25 * (low + high + next_low + next_high));
      low = next_low;
      high = next_high;
    }
  }

  const std::vector<Patch>& patches_;
  double middle_x_, density_;
  double area_ = 0.0;
  std::vector<double> up_to_;
};

std::vector<Vec3> random_places(const AreaTable& table, std::size_t count, std::uint64_t seed) {
  std::vector<Vec3> points(count);
  parallel_each(count, kPointsPerChunk, 0, [&](std::size_t i) {
    Random random = random_for(RandomUse::kPlace, seed, i);
    points[i] = table.pick(random).point;
  });
  return points;
}

double length_along(const Patch& patch, double fixed, bool along_u) {
  double length = 0.0;
  const auto at = [&](double s) { return along_u ? patch.point(s, fixed) : patch.point(fixed, s); };
  Vec3 last = at(0.0);
  for (int i = 1; i <= kPieces; ++i) {
    const Vec3 next = at(static_cast<double>(i) / kPieces);
    length += (next - last).norm();
    last = next;
  }
  return length;
}

/// Lines along u, evenly spaced along v, each with its own phase.
std::vector<Vec3> places_in_lines(const std::vector<Patch>& patches, double spacing_mm, double ratio,
                                  std::uint64_t seed) {
  const double along = spacing_mm / std::sqrt(ratio), across = spacing_mm * std::sqrt(ratio);
  std::vector<Vec3> points;
  std::size_t line = 0;
  for (const Patch& patch : patches) {
    const auto rows =
        static_cast<std::size_t>(std::max(1.0, std::round(length_along(patch, 0.5, false) / across)));
    for (std::size_t row = 0; row < rows; ++row) {
      const double v = (static_cast<double>(row) + 0.5) / static_cast<double>(rows);
      const auto columns =
          static_cast<std::size_t>(std::max(1.0, std::round(length_along(patch, v, true) / along)));
      Random random = random_for(RandomUse::kLine, seed, line++);
      const double phase = random.uniform();
      for (std::size_t i = 0; i < columns; ++i)
        points.push_back(patch.point((static_cast<double>(i) + phase) / static_cast<double>(columns), v));
    }
  }
  return points;
}

}  // namespace

Random random_for(RandomUse use, std::uint64_t seed, std::size_t index) {
  // Odd multiples of the squared golden number separate the uses from each other and from the jitter.
  const std::uint64_t apart = kGolden64 * kGolden64 * (2 * static_cast<std::uint64_t>(use) + 1);
  return Random((seed ^ apart) + kGolden64 * (index + 1));
}

double count_patches(const std::vector<Patch>& patches, const CommonOptions& common) {
  if (!(common.spacing_mm > 0.0)) return common.points;
  const AreaTable table(patches, {}, 1.0);
  return std::max(4.0, std::round(table.area_mm2() / (common.spacing_mm * common.spacing_mm)));
}

Sampled sample_patches(const std::vector<Patch>& patches, const geometry::Aabb& box,
                       const SamplingOptions& options, const CommonOptions& common) {
  const AreaTable table(patches, box, options.density);
  const auto count = static_cast<std::size_t>(count_patches(patches, common));
  Sampled sampled;
  sampled.spacing_mm = std::sqrt(table.area_mm2() / static_cast<double>(count));
  switch (options.way) {
    case Sampling::kLines:
      sampled.points_mm = places_in_lines(patches, sampled.spacing_mm, options.ratio, common.seed);
      break;
    case Sampling::kBlue:
      sampled.points_mm = poisson_disk_samples(table, count, box.low_mm, [&](std::size_t i) {
        return random_for(RandomUse::kPlace, common.seed, i);
      });
      break;
    default:
      sampled.points_mm = random_places(table, count, common.seed);
  }
  return sampled;
}

void add_noise_and_outliers(const Shape& shape, double spacing_mm, const SamplingOptions& options,
                            std::uint64_t seed, std::vector<Vec3>& points_mm) {
  if (options.noise == 0.0 && options.outliers == 0.0) return;
  const geometry::Aabb box = shape.surface->box_mm();
  parallel_each(points_mm.size(), kPointsPerChunk, 0, [&](std::size_t i) {
    Vec3& p = points_mm[i];
    Random chance = random_for(RandomUse::kOutlier, seed, i);
    if (options.outliers > 0.0 && chance.uniform() < options.outliers) {
      if (options.outliers_near) {
        const double side = chance.uniform() < 0.5 ? -1.0 : 1.0;
        p += side * chance.uniform(kNearestOutlier, kFarthestOutlier) * spacing_mm * shape.normal_at(p);
      } else {
        for (int axis = 0; axis < 3; ++axis) p[axis] = chance.uniform(box.low_mm[axis], box.high_mm[axis]);
      }
    } else if (options.noise > 0.0) {
      Random random = random_for(RandomUse::kNoise, seed, i);
      p += random.normal() * options.noise * spacing_mm * shape.normal_at(p);
    }
  });
}

std::vector<std::uint32_t> random_permutation(std::size_t count, std::uint64_t seed) {
  std::vector<std::uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  Random random = random_for(RandomUse::kOrder, seed, 0);
  for (std::size_t left = count; left > 1; --left) std::swap(order[left - 1], order[random.below(left)]);
  return order;
}

}  // namespace palpate::cloud
