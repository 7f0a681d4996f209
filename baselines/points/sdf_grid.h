// Signed distances to planes of points, in OpenVDB. The grid is a narrow band; the planes are local.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include <palpate/result.h>
#include "baselines/points/point_grid.h"

namespace palpate::baselines {

struct SdfOptions {
  double voxel_mm = 1.0;
  int band = 3;            ///< voxels on each side of the points
  double width_mm = 1.0;   ///< of the Gaussian weights of planes
  double beside_mm = 2.0;  ///< farther beside the nearest point a place is past a border: unknown
  double open_sign = 1.0;  ///< factor that makes normals of open pieces outward
  std::size_t most_bytes = std::size_t{1} << 30;
};

/// Positive outside. Immutable after build(), but each copy has a look-up cache and belongs to one thread.
/// The points' local coordinates, mm.
class SdfGrid {
 public:
  SdfGrid();
  ~SdfGrid();
  SdfGrid(SdfGrid&&) noexcept;
  SdfGrid& operator=(SdfGrid&&) noexcept;

  /// `tree` is over `points`. Errors: the band needs over most_bytes, or voxels are too small to index.
  /// Parallel; independent of the number of threads. O(voxels x points near each).
  [[nodiscard]] static Result<SdfGrid> build(const PointGrid& points, const SphereTree& tree,
                                             const SdfOptions& options, int threads);

  struct Value {
    bool known = false;  ///< all eight surrounding samples are in the band
    double distance = 0.0;
    Vec3 gradient = Vec3::Zero();
  };
  /// Trilinear between eight samples, with its gradient. Allocates nothing, O(1).
  [[nodiscard]] Value at(const Vec3& place) noexcept;
  /// Distance along a unit direction through unknown space: to the end of the empty node, at least a quarter
  /// voxel. O(1).
  [[nodiscard]] double empty_mm(const Vec3& place, const Vec3& way) noexcept;
  /// The part of a segment inside the known box, as shares; false if none.
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
