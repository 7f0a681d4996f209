// A narrow band of signed distances to the local planes of points, in an OpenVDB grid.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "baselines/points/point_grid.h"
#include "baselines/points/sphere_tree.h"
#include "toolkit/core/result.h"

namespace palpate::baselines {

struct SdfOptions {
  double voxel_mm = 1.0;
  int band = 3;            ///< voxels on each side of the points
  double width_mm = 1.0;   ///< of the Gaussian by which the planes of points are weighted
  double beside_mm = 2.0;  ///< a place farther than this beside the nearest point is past a border: not known
  double open_sign = 1.0;  ///< what normals of pieces that enclose nothing are multiplied by to point out
  std::size_t most_bytes = std::size_t{1} << 30;
};

/// Positive outside. Immutable after build(), but each copy of a look-up's cache belongs to one thread: so
/// does the grid. Local coordinates of the points, mm.
class SdfGrid {
 public:
  SdfGrid();
  ~SdfGrid();
  SdfGrid(SdfGrid&&) noexcept;
  SdfGrid& operator=(SdfGrid&&) noexcept;

  /// `tree` is over `points`. An Error where the band needs more than most_bytes, or where voxels are too
  /// small to be counted. Parallel; the same for any number of threads. O(voxels x points near each).
  [[nodiscard]] static Result<SdfGrid> build(const PointGrid& points, const SphereTree& tree,
                                             const SdfOptions& options, int threads);

  struct Value {
    bool known = false;  ///< all eight samples around are in the band
    double distance = 0.0;
    Vec3 gradient = Vec3::Zero();
  };
  /// Trilinear between the eight samples around, with its gradient. Allocates nothing, O(1).
  [[nodiscard]] Value at(const Vec3& place) noexcept;
  /// How far from a place that is not known nothing else is known either, along a unit direction: to the end
  /// of the empty node there, at least a quarter of a voxel. O(1).
  [[nodiscard]] double empty_mm(const Vec3& place, const Vec3& way) noexcept;
  /// The part of a segment that is in the box of what is known, as shares; false where none is.
  [[nodiscard]] bool clip(const Vec3& from, const Vec3& to, double& first, double& last) const noexcept;

  [[nodiscard]] double voxel_mm() const noexcept { return voxel_; }
  [[nodiscard]] std::uint64_t voxels() const noexcept { return voxels_; }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }

 private:
  struct Band;
  std::unique_ptr<Band> band_;
  double voxel_ = 1.0, per_voxel_ = 1.0;
  geometry::Aabb box_;
  std::uint64_t voxels_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace palpate::baselines
