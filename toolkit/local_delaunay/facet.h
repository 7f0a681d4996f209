// One triangle of the mesh, in a local frame.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <array>
#include <cmath>
#include <cstdint>

#include <palpate/vec.h>
#include "toolkit/core/simd.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"

namespace palpate::local_delaunay {

/// Part of a triangle: inside, the edge from corner k to k + 1, or corner k.
enum class Feature : std::uint8_t { kInside, kEdge0, kEdge1, kEdge2, kCorner0, kCorner1, kCorner2 };
[[nodiscard]] inline bool is_edge(Feature f) noexcept {
  return f >= Feature::kEdge0 && f <= Feature::kEdge2;
}
[[nodiscard]] constexpr Feature edge_feature(std::uint32_t k) noexcept {
  return static_cast<Feature>(static_cast<std::uint32_t>(Feature::kEdge0) + k);
}
/// The index of an edge or corner.
[[nodiscard]] inline std::uint32_t feature_index(Feature f) noexcept {
  const auto n = static_cast<std::uint32_t>(f);
  return n >= static_cast<std::uint32_t>(Feature::kCorner0)
             ? n - static_cast<std::uint32_t>(Feature::kCorner0)
             : n - static_cast<std::uint32_t>(Feature::kEdge0);
}
[[nodiscard]] inline std::uint32_t next_corner(std::uint32_t k) noexcept {
  return k == 2 ? 0 : k + 1;
}

/// A triangle's nearest point to a place.
struct ClosestPoint {
  Vec3 point = Vec3::Zero();
  double distance_sq = HUGE_VAL;
  Feature feature = Feature::kInside;
};

/// Corners counter-clockwise from outside.
struct Facet {
  std::array<std::uint32_t, 3> place{kNoPlace, kNoPlace, kNoPlace};
  std::array<Vec3, 3> corner;

  Facet() = default;
  Facet(const LocalDelaunayMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) noexcept
      : place{a, b, c}, corner{mesh.at(a), mesh.at(b), mesh.at(c)} {}

  /// Outward, twice the area long.
  [[nodiscard]] Vec3 area_normal() const noexcept {
    return (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  }
  /// Squared length of the middle edge: the local point spacing.
  [[nodiscard]] double middle_edge_sq() const noexcept {
    const double a = (corner[1] - corner[0]).squaredNorm(), b = (corner[2] - corner[1]).squaredNorm(),
                 c = (corner[0] - corner[2]).squaredNorm();
    return std::fmax(std::fmin(a, b), std::fmin(std::fmax(a, b), c));
  }
  [[nodiscard]] double longest_edge_sq() const noexcept {
    return std::fmax((corner[1] - corner[0]).squaredNorm(),
                     std::fmax((corner[2] - corner[1]).squaredNorm(), (corner[0] - corner[2]).squaredNorm()));
  }
};

/// Ericson, Real-Time Collision Detection (2005), section 5.1.5. A triangle without area gives the nearest of
/// its edges.
[[nodiscard]] inline ClosestPoint closest_point_on(const Facet& f, const Vec3& p) noexcept {
  const auto closest = [&p](const Vec3& at, Feature feature) {
    return ClosestPoint{at, (p - at).squaredNorm(), feature};
  };
  const Vec3& a = f.corner[0];
  const Vec3& b = f.corner[1];
  const Vec3& c = f.corner[2];
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return closest(a, Feature::kCorner0);
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return closest(b, Feature::kCorner1);
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return closest(a + ab * (d1 / (d1 - d3)), Feature::kEdge0);
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return closest(c, Feature::kCorner2);
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return closest(a + ac * (d2 / (d2 - d6)), Feature::kEdge2);
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0)
    return closest(b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), Feature::kEdge1);
  const double scale = 1.0 / (va + vb + vc);
  return closest(a + ab * (vb * scale) + ac * (vc * scale), Feature::kInside);
}

/// The facet across edge k; place[0] is kNoPlace if none.
[[nodiscard]] inline Facet across(const LocalDelaunayMesh& mesh, const Facet& f, std::uint32_t k) noexcept {
  const std::uint32_t a = f.place[k], b = f.place[next_corner(k)];
  const std::uint32_t c = mesh.before(a, b);
  if (c == kNoPlace) return {};
  return {mesh, a, c, b};
}

/// The product of a denormal distance and a normal may underflow and lose its sign. Zero products are
/// recomputed with this factor: the least distance 2^-1074 becomes 2^-568, whose product with a float normal
/// (at least 2^-298) is representable, and float coordinates (at most 2^129) with their normals stay finite.
inline constexpr double kDenormalScale = 0x1p506;
/// The height of r over a plane with normal n; only its sign is meaningful.
[[nodiscard]] inline double side_over(const Vec3& n, const Vec3& r) noexcept {
  const double height = n.dot(r);
  return height != 0.0 ? height : n.dot(kDenormalScale * r);
}

/// Four linear values that tell whether the HIP's projection is in the facet and the HIP behind it: the
/// corner weights and the height over the plane on the touched side. Heights are scaled by the normal's
/// length and weights by its square, so the test of the next facet needs no division.
class FacetFrame {
 public:
  struct Weights {
    std::array<double, 3> corner;  ///< scaled by the normal's squared length
    double height;                 ///< scaled by the normal's length
    /// Behind the facet, projection inside.
    [[nodiscard]] bool hold() const noexcept {
      return (static_cast<int>(corner[0] >= 0.0) & static_cast<int>(corner[1] >= 0.0) &
              static_cast<int>(corner[2] >= 0.0) & static_cast<int>(height < 0.0)) != 0;
    }
    /// If behind the facet with the projection beyond one edge only: the corner opposite that edge; else 3.
    /// The nearest point is then on that edge.
    [[nodiscard]] std::uint32_t beyond() const noexcept {
      // Two bits per combination of negative weights: 3, 0, 1, 3, 2, 3, 3, 3.
      constexpr std::uint32_t kOnly = 0b11'11'11'10'11'01'00'11;
      return height < 0.0 ? kOnly >> 2 * below() & 3u : 3;
    }
    /// If behind the facet with the projection beyond two edges: the corner opposite the edge passed farther,
    /// relative to the facet's height there; else 3.
    [[nodiscard]] std::uint32_t farther_beyond() const noexcept {
      const unsigned two = below();
      if (!(height < 0.0) || (two & (two - 1)) == 0) return 3;
      const std::uint32_t least = corner[1] < corner[0] ? 1 : 0;
      return corner[2] < corner[least] ? 2 : least;
    }

   private:
    [[nodiscard]] unsigned below() const noexcept {
      return static_cast<unsigned>(corner[0] < 0.0) | static_cast<unsigned>(corner[1] < 0.0) << 1 |
             static_cast<unsigned>(corner[2] < 0.0) << 2;
    }
  };

  FacetFrame() = default;
  /// `side`: 1 if the outer side is touched, -1 for the inner one. A facet without area holds nothing.
  FacetFrame(const Facet& facet, double side) noexcept
      : FacetFrame(facet.corner[0], facet.corner[1], facet.corner[2], side) {}
  FacetFrame(const Vec3& a, const Vec3& b, const Vec3& c, double side) noexcept;

  [[nodiscard]] Weights at(const Vec3& h) const noexcept {
    const double x = h.x() - origin_.x(), y = h.y() - origin_.y(), z = h.z() - origin_.z();
    const Double2 w = gradient_[0] * x + gradient_[1] * y + gradient_[2] * z;
    return {{square_ - w[0] - w[1], w[0], w[1]}, normal_.x() * x + normal_.y() * y + normal_.z() * z};
  }
  /// The height of h; only its sign is meaningful.
  [[nodiscard]] double side_of(const Vec3& h) const noexcept { return side_over(normal_, h - origin_); }
  /// Towards the touched side, twice the facet's area long.
  [[nodiscard]] const Vec3& normal() const noexcept { return normal_; }
  /// From a place to its projection on the plane, mm; the facet must have area.
  [[nodiscard]] Vec3 pull(const Weights& weights) const noexcept {
    return normal_ * (-weights.height * per_square_);
  }

 private:
  std::array<Double2, 3> gradient_{};  ///< x, y and z of the weights of corners 1 and 2
  Vec3 origin_ = Vec3::Zero();         ///< corner 0
  Vec3 normal_ = Vec3::Zero();         ///< towards the touched side
  double square_ = 0.0;                ///< squared length of normal_: the sum of all weights
  double per_square_ = 0.0;
};

inline FacetFrame::FacetFrame(const Vec3& a, const Vec3& b, const Vec3& c, double side) noexcept
    : origin_(a) {
  const Vec3 ab = b - a, ac = c - a;
  const Vec3 n = ab.cross(ac);
  const double square = n.squaredNorm();
  if (!(square > 0.0)) return;
  // Both sides that meet in corner 0, in lanes; n crosses each in the opposite direction.
  const Double2 x = {ac.x(), -ab.x()}, y = {ac.y(), -ab.y()}, z = {ac.z(), -ab.z()};
  gradient_ = {y * n.z() - z * n.y(), z * n.x() - x * n.z(), x * n.y() - y * n.x()};
  normal_ = side * n;
  square_ = square;
  per_square_ = 1.0 / square;
}

}  // namespace palpate::local_delaunay
