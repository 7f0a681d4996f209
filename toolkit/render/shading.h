// Force shading over three points (section 3.4): as printed, and corrected; and friction as printed
// (section 3.5.2).
#pragma once

#include <palpate/decision.h>
#include <palpate/options.h>
#include <palpate/vec.h>
#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>

namespace palpate::render {

enum class Shading : std::uint8_t {
  kNone,
  kAreaRaw,        ///< opposite areas, formed with the HIP itself
  kAreaProjected,  ///< areas formed with the HIP's projection onto the triangle's plane
  kFacet,  ///< signed areas in the points' plane; exact on a plane wherever the projection falls (ours)
  kLengthPrinted,     ///< lengths as printed: the weights sum to 2
  kLengthNormalised,  ///< the same, divided by 2
};

/// The option `shading` of renderers that shade over three points. Each renderer resolves its first choice,
/// auto.
[[nodiscard]] inline OptionSpec shading_spec(std::string help) {
  return {"shading",
          OptionKind::kChoice,
          "auto",
          std::move(help),
          {"auto", "none", "area-raw", "area-projected", "facet", "length-printed", "length-normalised"}};
}
/// Parses a choice other than auto.
[[nodiscard]] inline Shading parse_shading(std::string_view name) noexcept {
  if (name == "area-raw") return Shading::kAreaRaw;
  if (name == "area-projected") return Shading::kAreaProjected;
  if (name == "facet") return Shading::kFacet;
  if (name == "length-printed") return Shading::kLengthPrinted;
  if (name == "length-normalised") return Shading::kLengthNormalised;
  return Shading::kNone;
}

/// A triangle with doubled area below this share of its longest edge squared has no usable plane: moving a
/// point by a hundredth of the edge would turn its normal by more than a degree (1/64).
inline constexpr double kSliverShare = 1.0 / 64.0;

/// The plane through three points.
struct FacetPlane {
  Vec3 scaled_normal = Vec3::Zero();  ///< (b - a) x (c - a)
  double area_sq = 0.0;               ///< squared length of scaled_normal
  bool usable = false;                ///< false: a sliver
};
[[nodiscard, gnu::always_inline]] inline FacetPlane facet_plane(const Vec3& a, const Vec3& b,
                                                                const Vec3& c) noexcept {
  const Vec3 ab = b - a, ac = c - a;
  FacetPlane plane;
  plane.scaled_normal = ab.cross(ac);
  plane.area_sq = plane.scaled_normal.squaredNorm();
  const double longest = std::max({ab.squaredNorm(), ac.squaredNorm(), (c - b).squaredNorm()});
  plane.usable = plane.area_sq > (kSliverShare * longest) * (kSliverShare * longest);
  return plane;
}

/// The shaded vector from the HIP `h` to the surface, through the god object `a` and its two neighbours `b`,
/// `c` nearest to the HIP. Slivers give a - h (no shading). Scale-free; allocates nothing.
[[nodiscard]] inline Vec3 shaded_vector(Shading shading, const Vec3& h, const Vec3& a, const Vec3& b,
                                        const Vec3& c) noexcept {
  const Vec3 fa = a - h, fb = b - h, fc = c - h;
  if (shading == Shading::kNone) return fa;
  if (shading == Shading::kLengthPrinted || shading == Shading::kLengthNormalised) {
    const double la = fa.norm(), lb = fb.norm(), lc = fc.norm();
    const double sum = la + lb + lc;
    if (!(sum > 0.0)) return fa;
    const double divisor = shading == Shading::kLengthPrinted ? sum : 2.0 * sum;
    return ((sum - la) * fa + (sum - lb) * fb + (sum - lc) * fc) / divisor;
  }
  const FacetPlane plane = facet_plane(a, b, c);
  if (!plane.usable) return fa;
  if (shading == Shading::kFacet) return (fa.dot(plane.scaled_normal) / plane.area_sq) * plane.scaled_normal;
  const Vec3 normal = plane.scaled_normal / std::sqrt(plane.area_sq);
  double wa, wb, wc;
  if (shading == Shading::kAreaRaw) {
    wa = fb.cross(fc).norm();
    wb = fc.cross(fa).norm();
    wc = fa.cross(fb).norm();
  } else {
    // Removes the normal part, which gives vectors from the projection.
    const Vec3 off = fa.dot(normal) * normal;
    const Vec3 pa = fa - off, pb = fb - off, pc = fc - off;
    wa = pb.cross(pc).norm();
    wb = pc.cross(pa).norm();
    wc = pa.cross(pb).norm();
  }
  const double sum = wa + wb + wc;
  if (!(sum > 0.0)) return fa;
  return (wa * fa + wb * fb + wc * fc) / sum;
}

/// Friction as printed (section 3.5.2), shared by the literal forms: moves the god object back along the
/// surface towards its last place. Walks from place to place by at most coefficient times depth, the friction
/// cone (the distance is not printed). A per-point coefficient is read at the previous god object, as
/// printed. at(place): its position; around(place, use): calls use(neighbour). At most `steps` moves;
/// allocates nothing.
template <class Place, class At, class Around>
[[nodiscard]] Place roll_back_friction(const Place& god, const Place& held, const Vec3& hip,
                                       double coefficient, int steps, At&& at, Around&& around) noexcept {
  const Vec3 g = at(god), aim = at(held);
  const double most_sq = coefficient * coefficient * (g - hip).squaredNorm();
  Place place = god;
  double left_sq = (aim - g).squaredNorm();
  for (; steps > 0; --steps) {
    Place next = place;
    around(place, [&](const Place& other) {
      const double sq = (at(other) - aim).squaredNorm();
      if (!(sq < left_sq)) return;
      left_sq = sq;
      next = other;
    });
    if (next == place || !((at(next) - g).squaredNorm() <= most_sq)) break;
    place = next;
  }
  return place;
}

struct ShadingDecision {
  Shading shading = Shading::kNone;
  Decision explanation;
};

/// The decision for a choice other than `auto`.
[[nodiscard]] ShadingDecision given_shading(const std::string& choice);

/// As printed (section 3.4): by area above a resolution of 0.2 mm.
[[nodiscard]] ShadingDecision decide_literal_shading(const std::string& choice, double resolution_mm);

}  // namespace palpate::render
