// One probe against one mesh: a point's contact state, without forces.
#pragma once

#include <span>

#include "baselines/proximity/segment_index.h"
#include "baselines/renderers/facet_walk.h"
#include "baselines/renderers/free_side.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::baselines {

/// Times a frame may leave one place of the surface and meet another; the rest is done in the next frame.
inline constexpr int kMaxFlights = 4;

/// Contact with sides. Free, or attached to a half-facet; attached but outside within the float margin counts
/// as no contact, so that the next segment never starts where float cannot tell the side. Everything relative
/// to the mesh's origin, mm. A piece that encloses a volume is touched from one side only, the one where
/// reset() found the HIP (FreeSide): a HIP that came in by a hole leaves freely, instead of feeling
/// everything inside out from then on. Allocates when built only. Not thread-safe; the mesh, index,
/// crossings and sides are only read.
class MeshProbe {
 public:
  MeshProbe(const SurfaceMesh& mesh, const SegmentIndex& index, const Crossings& crossings,
            const PieceSides& sides);

  /// O(facets) where a piece encloses a volume.
  void reset(const Vec3& hip) noexcept;
  /// Free at `hip`, known to be clear of the mesh and on the side that reset() found. O(1).
  void start_from(const Vec3& hip) noexcept;
  /// True in contact: god_object() is then valid.
  bool update(const Vec3& hip) noexcept;
  /// Attached to a facet, though maybe outside by less than the margin.
  [[nodiscard]] bool contact() const noexcept { return attached_; }
  /// Whether a held HIP feels anything: a point always does.
  [[nodiscard]] bool felt(const Vec3& /*hip*/) const noexcept { return true; }
  /// How far from the mesh it can be touched.
  [[nodiscard]] double reach_mm() const noexcept { return 0.0; }
  /// Held: where the body is, the point or the sphere's centre.
  [[nodiscard]] const Vec3& body_mm() const noexcept { return at_.point; }
  /// How much nearer to the HIP the felt god object is than the places that planes_near() allows.
  [[nodiscard]] double skin_mm() const noexcept { return 0.0; }

  [[nodiscard]] const SurfacePosition& god_object() const noexcept { return at_; }
  /// The frictionless god object, in contact.
  [[nodiscard]] Vec3 target(const Vec3& /*hip*/) const noexcept { return at_.point; }
  /// The same under Ruspini's shading in two passes: the HIP projected on the plane through the god object
  /// whose normal is interpolated from `vertex_normals`, and that point on the facet's own plane.
  [[nodiscard]] Vec3 shaded_target(const Vec3& hip, std::span<const Vec3f> vertex_normals) const noexcept;
  /// visit(facet, point, share): where the surface's properties are read.
  template <class Visit>
  void places(Visit&& visit) const noexcept {
    visit(facet_of(at_.half), at_.point, 1.0);
  }
  /// In contact: the planes of the facets around the local god object of `at`, world frame: one inside a
  /// facet or on a feature that is convex seen from the touched side, several in a concave one or before
  /// walls.
  void planes_near(const Vec3& at, const render::ModelPose& pose, render::JointPlanes& planes) const noexcept;

  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  [[nodiscard]] std::uint64_t moves() const noexcept { return moves_; }

 private:
  bool attach(std::uint32_t facet, const Vec3& near, const Vec3& from, const Vec3& to) noexcept;
  /// Attached at the place of `half` nearest to `near`, on the side of all walls there that `from` is on.
  void stand_on(HalfFacet half, const Vec3& near, const Vec3& from) noexcept;
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
  Vec3 anchor_ = Vec3::Zero();  ///< last point known to be clear of the surface, when free
  SurfacePosition at_;
  std::uint64_t moves_ = 0;
};

}  // namespace palpate::baselines
