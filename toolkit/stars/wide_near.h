// Internal to stars: what is asked of neighbours, four at a time where the processor has AVX2.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "toolkit/core/vec.h"
#include "toolkit/stars/places.h"
#include "toolkit/surface/least_direction.h"

namespace palpate::stars {

/// Neighbours that a plane is of.
inline constexpr std::size_t kPlaneNear = 12;

/// Neighbours that places_between() looks at.
inline constexpr unsigned kNearAtOnce = 16;

struct FourPlanes {
  std::array<surface::Symmetric, 4> covariance;  ///< times the number of points, see Moments
  std::array<Vec3, 4> normal;                    ///< as surface::least_direction()
  std::array<bool, 4> has_normal;                ///< what least_direction() returns
};

/// Each of four places and its kPlaneNear nearest, to the bit as one by one. Only where wide_lanes().
void four_planes(const Placed* point, const std::array<std::uint32_t, 4>& place,
                 const std::array<const std::uint32_t*, 4>& near, FourPlanes& out) noexcept;

/// Bit k: the place near[k], of kNearAtOnce, is farther from p than the root of `beyond_sq` and no farther
/// than that of `within_sq`. The same with lanes and without.
[[nodiscard]] unsigned places_between(const Placed* point, const std::uint32_t* near, const Vec3& p,
                                      double beyond_sq, double within_sq) noexcept;

}  // namespace palpate::stars
