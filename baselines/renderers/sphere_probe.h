// A sphere that stays outside of a mesh and goes as near to the HIP as it can: Ruspini's proxy (Ruspini,
// Kolarov and Khatib 1997, sections 3 and 4), without sides and without a state of contact, since a body
// cannot change sides.
//
// The centre moves straight to its goal until the sphere touches a facet; the plane tangent there joins the
// constraints, and the new goal is the place nearest to the HIP that up to three of them hold; repeated
// until it rests. Two things make this exact:
//   - Only what really blocks is a constraint, each with the normal from the facet's nearest point to the
//     centre. Those are the first-order conditions of "stay a radius away", so a rest is a local minimum of
//     the distance to the HIP, on facets, edges and corners alike, and nearly coplanar facets form no false
//     corners.
//   - The distance to a facet is a convex function along the way, so Newton's steps from the free side
//     approach the touch without ever passing it: no tolerance is wider than rounding.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "baselines/proximity/segment_index.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::baselines {

/// Moves of the sphere a frame, at most; the rest is done in the next.
inline constexpr int kMaxSphereMoves = 256;
/// Facets that a frame tests against the sphere's way, repetitions counted, at most (and one list more).
inline constexpr std::size_t kMaxSphereTests = 65'536;
/// Facets kept at hand around the sphere. Where more are near, fewer are taken from less far.
inline constexpr std::size_t kMaxNearFacets = 1024;
/// Facets touched at once: three hold a sphere, the rest leaves room for flat places.
inline constexpr std::size_t kMaxSphereContacts = 8;

struct SphereContact {
  std::uint32_t facet = kNoFacet;
  FacetPoint place;            ///< of the facet, nearest to the centre
  Vec3 normal = Vec3::Zero();  ///< from there to the centre, unit
  double gap = 0.0;            ///< between sphere and facet
  double push = 0.0;           ///< share of the way HIP -> centre along the normal
};

/// Which point of the sphere follows the device.
enum class SphereTip : std::uint8_t {
  kSkin,   ///< its skin: force begins where the HIP reaches the surface; the god object is the skin's point
           ///< nearest to the HIP, on a smooth surface the surface's own closest point
  kCentre  ///< its centre, as printed: force begins a radius before the surface
};

/// One sphere and one mesh, which must outlive it, as must the index. Relative to the mesh's origin, mm.
/// Allocates when built only. Belongs to one thread.
class SphereProbe {
 public:
  /// `radius_mm` > 0 and above rounding (see least_radius_mm); `spacing_mm`: a typical edge, it only decides
  /// how far facets are kept at hand.
  SphereProbe(const SurfaceMesh& mesh, const SegmentIndex& index, double radius_mm, double spacing_mm,
              SphereTip tip);
  /// Spheres below this are rounding.
  [[nodiscard]] static double least_radius_mm(const SurfaceMesh& mesh) noexcept;

  /// The sphere's centre is at `hip`. Where a facet is nearer than the radius, the sphere begins smaller and
  /// grows as it gets room.
  void reset(const Vec3& hip) noexcept;
  /// As reset(), in the middle of a path.
  void start_from(const Vec3& hip) noexcept { place(hip); }
  /// True where something keeps the centre from the HIP. At most kMaxSphereMoves and kMaxSphereTests.
  bool update(const Vec3& hip) noexcept;
  [[nodiscard]] bool contact() const noexcept { return count_ > 0; }
  /// Whether a held HIP feels that: a skin only where the HIP is under the surface.
  [[nodiscard]] bool felt(const Vec3& hip) const noexcept {
    return tip_ == SphereTip::kCentre || (hip - centre_).norm() > size_;
  }
  /// How far from the mesh it can be touched.
  [[nodiscard]] double reach_mm() const noexcept { return radius_; }
  /// Held: where the body is, the point or the sphere's centre.
  [[nodiscard]] const Vec3& body_mm() const noexcept { return centre_; }
  /// How much nearer to the HIP the felt god object is than the places that planes_near() allows.
  [[nodiscard]] double skin_mm() const noexcept { return tip_ == SphereTip::kCentre ? 0.0 : size_; }

  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  [[nodiscard]] std::uint64_t moves() const noexcept { return moves_; }
  [[nodiscard]] const Vec3& centre() const noexcept { return centre_; }
  [[nodiscard]] double size_mm() const noexcept { return size_; }
  [[nodiscard]] std::span<const SphereContact> contacts() const noexcept {
    return {contacts_.data(), count_};
  }
  /// visit(facet, point, share): where the surface's properties are read, shares by push.
  template <class Visit>
  void places(Visit&& visit) const noexcept {
    double sum = 0.0;
    for (const SphereContact& contact : contacts()) sum += contact.push;
    for (const SphereContact& contact : contacts())
      if (contact.push > 0.0) visit(contact.facet, contact.place.point, contact.push / sum);
  }
  /// Held: the planes that keep the centre where it would rest for a HIP at `at`; where it gets there, that
  /// before the nearest facet. World frame.
  void planes_near(const Vec3& at, const render::ModelPose& pose, render::JointPlanes& planes) noexcept;
  /// The frictionless god object of the last update.
  [[nodiscard]] Vec3 target(const Vec3& hip) const noexcept { return at_tip(centre_, hip); }
  /// The same under Ruspini's shading in two passes: the goal on the planes with normals interpolated from
  /// `vertex_normals` (per vertex, for side 0 of its first facet), then that goal on the true planes, no
  /// further than the sphere can go.
  [[nodiscard]] Vec3 shaded_target(const Vec3& hip, std::span<const Vec3f> vertex_normals) noexcept;

 private:
  struct Touch {
    std::uint32_t facet = kNoFacet;
    double fraction = 1.0;
  };

  void place(const Vec3& hip) noexcept;
  bool settle(const Vec3& hip, int moves, double& rest) noexcept;
  [[nodiscard]] Vec3 at_tip(const Vec3& centre, const Vec3& hip) const noexcept;
  void grow() noexcept;
  void refresh() noexcept;
  [[nodiscard]] bool measure(SphereContact& contact) const noexcept;
  [[nodiscard]] Vec3 way_to(const Vec3& hip, double slack) noexcept;
  [[nodiscard]] bool advance(const Vec3& way, double length, double rest) noexcept;
  void list_near() noexcept;
  [[nodiscard]] double clearance(double most) const noexcept;
  [[nodiscard]] Touch first_touch(const Vec3& way, double length, double limit) noexcept;
  [[nodiscard]] double touch_fraction(std::size_t i, const Vec3& way, double limit) noexcept;
  void move(const Vec3& way, double length, double fraction) noexcept;
  void remember(std::uint32_t facet) noexcept;

  const SurfaceMesh* mesh_;
  const SegmentIndex* index_;
  SphereTip tip_;
  double radius_;
  double most_reach_;
  double skin_;  ///< thickness of "touching"

  Vec3 centre_ = Vec3::Zero();
  double size_ = 0.0;  ///< the sphere's radius now
  std::array<SphereContact, kMaxSphereContacts> contacts_;
  std::size_t count_ = 0;
  /// Every facet within size_ + reach_ of list_centre_. `distance` minus the way travelled since bounds a
  /// facet's distance from below: most facets need no look for many frames.
  std::vector<NearFacet> near_;
  /// The plane through each one's place that was nearest when it was last looked at, across the way to there:
  /// distances are convex, so the height over it bounds them from below, too.
  std::vector<geometry::HalfSpace> planes_;
  std::size_t listed_ = 0;
  Vec3 list_centre_ = Vec3::Zero();
  double reach_ = -1.0;     ///< below 0: no list
  double travelled_ = 0.0;  ///< since the list was made
  std::size_t tests_ = 0;
  bool bound_hit_ = false;
  bool touched_ = false;  ///< anything in this update, or at its beginning
  std::uint64_t moves_ = 0;
};

}  // namespace palpate::baselines
