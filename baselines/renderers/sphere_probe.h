// A sphere that stays outside a mesh: Ruspini's proxy. It moves as near to the HIP as it can (Ruspini,
// Kolarov and Khatib 1997, sections 3 and 4). It needs no sides and no contact state: a body cannot change
// sides.
//
// The centre moves straight to its goal until the sphere touches a facet. The tangent plane there joins the
// constraints, and the new goal is the place nearest to the HIP that up to three of them allow; this repeats
// until the sphere rests. Two properties make it exact:
//  - Only a blocking facet is a constraint, with the normal from its nearest point to the centre. These are
//    the first-order conditions of "stay a radius away", so a rest is a local minimum of the distance to the
//    HIP on facets, edges and corners, and nearly coplanar facets form no false corners.
//  - The distance to a facet is convex along the way, so Newton's steps from the free side never pass the
//    touch: no tolerance is wider than rounding.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "baselines/proximity/segment_index.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::baselines {

/// Most moves of the sphere per frame; the next frame continues.
inline constexpr int kMaxSphereMoves = 256;
/// Most facets tested per frame against the sphere's way, repetitions included (plus one list).
inline constexpr std::size_t kMaxSphereTests = 65'536;
/// Most facets listed around the sphere; if more are near, the reach shrinks.
inline constexpr std::size_t kMaxNearFacets = 1024;
/// Most facets touched at once: three hold a sphere, the rest allows for flat places.
inline constexpr std::size_t kMaxSphereContacts = 8;

struct SphereContact {
  std::uint32_t facet = kNoFacet;
  FacetPoint place;            ///< of the facet, nearest to the centre
  Vec3 normal = Vec3::Zero();  ///< from the place to the centre, unit
  double gap = 0.0;            ///< between sphere and facet
  double push = 0.0;           ///< share of the way HIP -> centre along the normal
};

/// The point of the sphere that follows the device.
enum class SphereTip : std::uint8_t {
  kSkin,   ///< its skin: force begins where the HIP reaches the surface. The god object is the skin's point
           ///< nearest to the HIP, on a smooth surface its closest point
  kCentre  ///< its centre, as in the paper: force begins a radius before the surface
};

/// One sphere and one mesh; mesh and index must outlive it. Relative to the mesh's origin, mm. Allocates only
/// in the constructor. For one thread.
class SphereProbe {
 public:
  /// `radius_mm` above least_radius_mm(); `spacing_mm`: a typical edge, which only sets the reach of facet
  /// lists.
  SphereProbe(const SurfaceMesh& mesh, const SegmentIndex& index, double radius_mm, double spacing_mm,
              SphereTip tip);
  /// Smaller spheres are rounding.
  [[nodiscard]] static double least_radius_mm(const SurfaceMesh& mesh) noexcept;

  /// Puts the sphere's centre at `hip`. Near a facet the sphere starts smaller and grows as room allows.
  void reset(const Vec3& hip) noexcept;
  /// The same in the middle of a path.
  void start_from(const Vec3& hip) noexcept { place(hip); }
  /// True if something keeps the centre from the HIP. At most kMaxSphereMoves and kMaxSphereTests.
  bool update(const Vec3& hip) noexcept;
  [[nodiscard]] bool contact() const noexcept { return count_ > 0; }
  /// Whether a held HIP feels force: with kSkin only if the HIP is under the surface.
  [[nodiscard]] bool felt(const Vec3& hip) const noexcept {
    return tip_ == SphereTip::kCentre || (hip - centre_).norm() > size_;
  }
  /// Distance from the mesh at which contact is possible.
  [[nodiscard]] double reach_mm() const noexcept { return radius_; }
  /// Held: the point or the sphere's centre.
  [[nodiscard]] const Vec3& body_mm() const noexcept { return centre_; }
  /// Distance of the felt god object from the places of planes_near(), towards the HIP.
  [[nodiscard]] double skin_mm() const noexcept { return tip_ == SphereTip::kCentre ? 0.0 : size_; }

  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  [[nodiscard]] std::uint64_t moves() const noexcept { return moves_; }
  [[nodiscard]] const Vec3& centre() const noexcept { return centre_; }
  [[nodiscard]] double size_mm() const noexcept { return size_; }
  [[nodiscard]] std::span<const SphereContact> contacts() const noexcept {
    return {contacts_.data(), count_};
  }
  /// visit(facet, point, share): where the surface's properties are read, with shares by push.
  template <class Visit>
  void places(Visit&& visit) const noexcept {
    double sum = 0.0;
    for (const SphereContact& contact : contacts()) sum += contact.push;
    for (const SphereContact& contact : contacts())
      if (contact.push > 0.0) visit(contact.facet, contact.place.point, contact.push / sum);
  }
  /// Held: planes that keep the centre where it would rest for a HIP at `at`; if it reaches `at`, the plane
  /// before the nearest facet. World frame.
  void planes_near(const Vec3& at, const render::ModelPose& pose, render::JointPlanes& planes) noexcept;
  /// The last update's frictionless god object.
  [[nodiscard]] Vec3 target(const Vec3& hip) const noexcept { return at_tip(centre_, hip); }
  /// The same with Ruspini's two-pass shading: the goal on planes with normals interpolated from
  /// `vertex_normals` (for side 0 of each vertex's first facet), then on the true planes, as far as the
  /// sphere can go.
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
  double skin_;  ///< thickness of the contact layer

  Vec3 centre_ = Vec3::Zero();
  double size_ = 0.0;  ///< present radius of the sphere
  std::array<SphereContact, kMaxSphereContacts> contacts_;
  std::size_t count_ = 0;
  /// All facets within size_ + reach_ of list_centre_. `distance` minus the travelled way bounds a facet's
  /// distance from below, so most facets are skipped for many frames.
  std::vector<NearFacet> near_;
  /// For each facet the plane through its closest point at the last look, across the way there. Distances are
  /// convex: the height above the plane is a lower bound too.
  std::vector<geometry::HalfSpace> planes_;
  std::size_t listed_ = 0;
  Vec3 list_centre_ = Vec3::Zero();
  double reach_ = -1.0;     ///< negative: no list
  double travelled_ = 0.0;  ///< since the list was made
  std::size_t tests_ = 0;
  bool bound_hit_ = false;
  bool touched_ = false;  ///< at any time in this update or at its start
  std::uint64_t moves_ = 0;
};

}  // namespace palpate::baselines
