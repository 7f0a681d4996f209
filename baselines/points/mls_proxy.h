// Implicit functions over points with individual radii. Source: Leeper, Chan and Salisbury 2012.
#pragma once

#include <cstdint>
#include <span>

#include "baselines/points/point_grid.h"

namespace palpate::baselines {

enum class ImplicitSurface : std::uint8_t {
  kSurfel,    ///< f = n . (x - a); a and n are weighted means of points and normals
  kMetaball,  ///< f = level - sum of weights: a skin around the points, the same from both sides
};
enum class ImplicitWeight : std::uint8_t {
  kWyvill,    ///< 1 - 22/9 q^2 + 17/9 q^4 - 4/9 q^6
  kWendland,  ///< (1 - q)^4 (4 q + 1)
};

struct ImplicitOptions {
  ImplicitSurface surface = ImplicitSurface::kSurfel;
  ImplicitWeight weight = ImplicitWeight::kWyvill;
  double level = 0.5;   ///< metaballs: the sum of weights on the surface
  bool across = false;  ///< points in lines: radii also reach the farthest neighbour
};

/// A point's radius, in mean distances to its three nearest.
inline constexpr double kRadiusSpacings = 3.0;
inline constexpr std::size_t kRadiusNeighbours = 3;
/// For points in lines, in distances to the farthest neighbour: radii of adjacent lines overlap by half.
inline constexpr double kAcrossShare = 1.5;
/// Search radius, in mean point radii.
inline constexpr double kActiveRadii = 3.0;

/// The function and its gradient at a place; negative inside.
struct ImplicitValue {
  bool defined = false;  ///< some point's weight reaches here
  double f = 0.0;        ///< surfels: mm; metaballs: a number
  Vec3 gradient = Vec3::Zero();
};

/// Immutable after building; thread-safe to read. Local coordinates, mm.
class ImplicitField {
 public:
  /// `neighbours` is parallel to the points. O(n).
  void build(PointGrid points, std::span<const search::Neighbours> neighbours, const ImplicitOptions& options,
             int threads);

  /// Allocates nothing. O(points within the active radius).
  [[nodiscard]] ImplicitValue at(const Vec3& place, const OutwardSide& side) const noexcept;
  /// The nearest point within the active radius, or kNoPlace.
  [[nodiscard]] std::uint32_t nearest(const Vec3& place) const noexcept;

  [[nodiscard]] double active_mm() const noexcept { return active_; }
  [[nodiscard]] double largest_radius_mm() const noexcept { return largest_; }
  [[nodiscard]] const PointGrid& points() const noexcept { return points_; }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return points_.bytes() + radius_.capacity() * sizeof(float);
  }

 private:
  PointGrid points_;
  LargePageVector<float> radius_;  ///< by place
  double active_ = 0.0, reach_ = 0.0, largest_ = 0.0;
  ImplicitOptions options_;
};

}  // namespace palpate::baselines
