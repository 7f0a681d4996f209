// The planes that hold a god object where it is: of the facets that meet there, and of other sheets.
#pragma once

#include <array>
#include <span>

#include "baselines/renderers/facet_walk.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::baselines {

/// Where there are more than one touch may give, those that lie in one plane with another go first, then
/// those that the probe violates least. Local to the mesh, mm. Allocates nothing.
class PlanesHere {
 public:
  /// One plane inside a facet or on a feature that is convex seen from the touched side, several in a concave
  /// one or before other sheets. `crossings` may be null.
  PlanesHere(const SurfaceMesh& mesh, const Crossings* crossings, const SurfacePosition& at,
             const Vec3& probe) noexcept;
  /// Unit, towards the free side; all through at.point.
  [[nodiscard]] std::span<const Vec3> normals() const noexcept { return {normal_.data(), size_}; }
  /// What the planes leave of a way that starts here.
  [[nodiscard]] Vec3 left_of(const Vec3& way) const noexcept;

 private:
  void add(const Vec3& normal) noexcept;

  Vec3 pull_;
  std::array<Vec3, render::kMaxPlanesATouch> normal_;
  std::size_t size_ = 0;
};

/// Whether another sheet stands where `at` is.
[[nodiscard]] bool stands_on_other(const SurfaceMesh& mesh, const Crossings* crossings,
                                   const SurfacePosition& at) noexcept;

}  // namespace palpate::baselines
