// Contact state of a point against one mesh, without forces.
#pragma once

#include <span>

#include "baselines/mesh/pieces.h"
#include "baselines/proximity/segment_index.h"
#include "baselines/renderers/facet_walk.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::baselines {

/// Most flights per frame, from one place of the surface to another; the next frame continues.
inline constexpr int kMaxFlights = 4;

/// Free, or attached to a half-facet. Attached but outside within the float margin is no contact, so the next
/// segment never starts where float cannot tell the side. Relative to the mesh's origin, mm. A piece that
/// encloses a volume is touched only from the side where reset() found the HIP (FreeSide), so a HIP that came
/// in through a hole can leave. Allocates only in the constructor. Not thread-safe; mesh, index, crossings
/// and sides are only read.
class MeshProbe {
 public:
  MeshProbe(const SurfaceMesh& mesh, const SegmentIndex& index, const Crossings& crossings,
            const PieceOrientation& sides);

  /// O(facets) if a piece encloses a volume.
  void reset(const Vec3& hip) noexcept;
  /// Sets the HIP free at `hip`, known to be clear of the mesh and on the side of reset(). O(1).
  void start_from(const Vec3& hip) noexcept;
  /// The mesh has taken the place of `before`'s; both are rasters of one camera with one origin. A held god
  /// object goes on at the nearest place within `reach_mm`, on the same side; a free HIP that the surface has
  /// passed on its way to `camera_mm` is met by it. At most two Embree queries.
  void continue_from(const MeshProbe& before, const Vec3& camera_mm, double reach_mm) noexcept;
  /// True in contact: god_object() is then valid.
  bool update(const Vec3& hip) noexcept;
  /// Attached to a facet, possibly outside by less than the margin.
  [[nodiscard]] bool contact() const noexcept { return attached_; }
  /// Whether a held HIP feels force: always, for a point.
  [[nodiscard]] bool felt(const Vec3& /*hip*/) const noexcept { return true; }
  /// Distance from the mesh at which contact is possible.
  [[nodiscard]] double reach_mm() const noexcept { return 0.0; }
  /// Held: the point or the sphere's centre.
  [[nodiscard]] const Vec3& body_mm() const noexcept { return at_.point; }
  /// Distance of the felt god object from the places of planes_near(), towards the HIP.
  [[nodiscard]] double skin_mm() const noexcept { return 0.0; }

  [[nodiscard]] const SurfacePosition& god_object() const noexcept { return at_; }
  /// The frictionless god object, in contact.
  [[nodiscard]] Vec3 target(const Vec3& /*hip*/) const noexcept { return at_.point; }
  /// The same with Ruspini's two-pass shading: the HIP projected onto the plane through the god object with a
  /// normal interpolated from `vertex_normals`, then onto the facet's plane.
  [[nodiscard]] Vec3 shaded_target(const Vec3& hip, std::span<const Vec3f> vertex_normals) const noexcept;
  /// Calls visit(facet, point, share) where surface properties are read.
  template <class Visit>
  void places(Visit&& visit) const noexcept {
    visit(facet_of(at_.half), at_.point, 1.0);
  }
  /// In contact: planes around the local god object of `at`, world frame. One inside a facet or on a convex
  /// feature, several on a concave one or before walls.
  void planes_near(const Vec3& at, const render::ModelPose& pose, render::JointPlanes& planes) const noexcept;

  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  [[nodiscard]] std::uint64_t moves() const noexcept { return moves_; }

 private:
  bool attach(std::uint32_t facet, const Vec3& near, const Vec3& from, const Vec3& to) noexcept;
  /// Attaches at the place of `half` nearest to `near`, on the side of walls where `from` is.
  void attach_at(HalfFacet half, const Vec3& near, const Vec3& from) noexcept;
  bool attach_near_feature(std::uint32_t facet, const Vec3& near, const Vec3& from) noexcept;
  [[nodiscard]] bool outside(const Vec3& hip, Vec3& away) const noexcept;
  enum class Flight { kFree, kStays, kMet };
  Flight fly(const Vec3& hip, const Vec3& away) noexcept;
  [[nodiscard]] std::uint32_t first_around(const Vec3& hip, double& fraction) const noexcept;

  const SurfaceMesh* mesh_;
  const SegmentIndex* index_;
  const Crossings* crossings_;
  FreeSide free_side_;
  bool attached_ = false;
  bool bound_hit_ = false;
  Vec3 anchor_ = Vec3::Zero();  ///< last point known to be clear, while free
  SurfacePosition at_;
  std::uint64_t moves_ = 0;
};

}  // namespace palpate::baselines
