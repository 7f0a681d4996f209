// Neighbour computations with AVX2, four points at a time. Internal to local_delaunay.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <palpate/vec.h>
#include "toolkit/local_delaunay/spatial_sort.h"
#include "toolkit/surface/smallest_eigenvector.h"

namespace palpate::local_delaunay {

/// Neighbours in a plane fit.
inline constexpr std::size_t kPlaneNear = 12;

/// Neighbours that points_between() tests.
inline constexpr unsigned kNearAtOnce = 16;

struct PlaneBatch {
  std::array<surface::SymmetricMatrix3, 4> covariance;  ///< times the number of points, see Moments
  std::array<Vec3, 4> normal;                           ///< as surface::smallest_eigenvector()
  std::array<bool, 4> has_normal;                       ///< smallest_eigenvector()'s return values
};

/// Fits four places with their kPlaneNear nearest; bit-identical to the scalar form. Requires has_avx2().
void fit_four_planes(const SortedPoint* point, const std::array<std::uint32_t, 4>& place,
                     const std::array<const std::uint32_t*, 4>& near, PlaneBatch& out) noexcept;

/// Bit k: near[k], of kNearAtOnce places, is farther from p than sqrt(beyond_sq) and at most sqrt(within_sq).
/// The same with and without vector code.
[[nodiscard]] unsigned points_between(const SortedPoint* point, const std::uint32_t* near, const Vec3& p,
                                      double beyond_sq, double within_sq) noexcept;

}  // namespace palpate::local_delaunay
