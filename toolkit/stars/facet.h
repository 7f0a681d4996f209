// One triangle of a star mesh, read into a frame of its own.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <array>
#include <cmath>
#include <cstdint>

#include "toolkit/core/vec.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

/// Where on a triangle: inside, on the edge from corner k to k + 1, or at corner k.
enum class Feature : std::uint8_t { kInside, kEdge0, kEdge1, kEdge2, kCorner0, kCorner1, kCorner2 };
[[nodiscard]] inline bool is_edge(Feature f) noexcept {
  return f >= Feature::kEdge0 && f <= Feature::kEdge2;
}
/// Of an edge or corner.
[[nodiscard]] inline std::uint32_t number_of(Feature f) noexcept {
  const auto n = static_cast<std::uint32_t>(f);
  return n >= static_cast<std::uint32_t>(Feature::kCorner0)
             ? n - static_cast<std::uint32_t>(Feature::kCorner0)
             : n - static_cast<std::uint32_t>(Feature::kEdge0);
}
[[nodiscard]] inline std::uint32_t corner_after(std::uint32_t k) noexcept {
  return k == 2 ? 0 : k + 1;
}

/// The point of a triangle nearest to some place.
struct Foot {
  Vec3 point = Vec3::Zero();
  double distance_sq = HUGE_VAL;
  Feature feature = Feature::kInside;
};

/// Corners counter-clockwise seen from outside.
struct Facet {
  std::array<std::uint32_t, 3> place{kNoPlace, kNoPlace, kNoPlace};
  std::array<Vec3, 3> corner;

  Facet() = default;
  Facet(const StarMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) noexcept
      : place{a, b, c}, corner{mesh.at(a), mesh.at(b), mesh.at(c)} {}

  /// Outward, twice the area long.
  [[nodiscard]] Vec3 area_normal() const noexcept {
    return (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  }
  /// Squared, of the edges neither the longest nor the shortest: how far apart points are here.
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

/// Ericson, Real-Time Collision Detection (2005), section 5.1.5. A triangle without area has no inside: the
/// nearest of its edges.
[[nodiscard]] inline Foot foot_on(const Facet& f, const Vec3& p) noexcept {
  const auto foot = [&p](const Vec3& at, Feature feature) {
    return Foot{at, (p - at).squaredNorm(), feature};
  };
  const Vec3& a = f.corner[0];
  const Vec3& b = f.corner[1];
  const Vec3& c = f.corner[2];
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return foot(a, Feature::kCorner0);
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return foot(b, Feature::kCorner1);
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return foot(a + ab * (d1 / (d1 - d3)), Feature::kEdge0);
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return foot(c, Feature::kCorner2);
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return foot(a + ac * (d2 / (d2 - d6)), Feature::kEdge2);
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0)
    return foot(b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), Feature::kEdge1);
  const double scale = 1.0 / (va + vb + vc);
  return foot(a + ab * (vb * scale) + ac * (vc * scale), Feature::kInside);
}

/// The facet on the other side of edge k; place[0] is kNoPlace where there is none.
[[nodiscard]] inline Facet across(const StarMesh& mesh, const Facet& f, std::uint32_t k) noexcept {
  const std::uint32_t a = f.place[k], b = f.place[corner_after(k)];
  const std::uint32_t c = mesh.before(a, b);
  if (c == kNoPlace) return {};
  return {mesh, a, c, b};
}

/// The four numbers that tell whether a HIP still has its foot in a facet and is behind it, all of them
/// linear: the corners' weights and the height over the plane on the touched side. Two lanes a register.
class FacetFrame {
 public:
  struct Weights {
    std::array<double, 3> corner;
    double height;  ///< mm
    /// Behind the facet, with the foot inside it.
    [[nodiscard]] bool hold() const noexcept {
      return (static_cast<int>(corner[0] >= 0.0) & static_cast<int>(corner[1] >= 0.0) &
              static_cast<int>(corner[2] >= 0.0) & static_cast<int>(height < 0.0)) != 0;
    }
    /// Behind the facet, with the foot beyond one edge alone: the corner across from that edge, else 3. The
    /// nearest point of the facet is then on that edge.
    [[nodiscard]] std::uint32_t beyond() const noexcept {
      const unsigned below = static_cast<unsigned>(corner[0] < 0.0) |
                             static_cast<unsigned>(corner[1] < 0.0) << 1 |
                             static_cast<unsigned>(corner[2] < 0.0) << 2;
      constexpr std::array<std::uint32_t, 8> kOnly = {3, 0, 1, 3, 2, 3, 3, 3};
      return height < 0.0 ? kOnly[below] : 3;
    }
  };

  FacetFrame() = default;
  /// `side`: 1 where the outer side is touched, -1 where the inner one is. A facet without area holds
  /// nothing.
  FacetFrame(const Facet& facet, double side) noexcept;

  [[nodiscard]] Weights at(const Vec3& h) const noexcept {
    const Vec3 r = h - origin_;
    const Two x = {r.x(), r.x()}, y = {r.y(), r.y()}, z = {r.z(), r.z()};
    const Two first = first_[0] * x + first_[1] * y + first_[2] * z + first_[3];
    const Two second = second_[0] * x + second_[1] * y + second_[2] * z;
    return {{first[0], first[1], second[0]}, second[1]};
  }
  /// Unit, towards the touched side; zero for a facet without area.
  [[nodiscard]] const Vec3& normal() const noexcept { return normal_; }

 private:
  using Two = double __attribute__((vector_size(16)));
  std::array<Two, 4> first_{};   ///< weights of corners 0 and 1: x, y, z, constant
  std::array<Two, 3> second_{};  ///< weight of corner 2, and the height
  Vec3 origin_ = Vec3::Zero();   ///< corner 0
  Vec3 normal_ = Vec3::Zero();
};

inline FacetFrame::FacetFrame(const Facet& f, double side) noexcept : origin_(f.corner[0]) {
  const Vec3 ab = f.corner[1] - f.corner[0], ac = f.corner[2] - f.corner[0];
  const Vec3 n = ab.cross(ac);
  const double square = n.squaredNorm();
  if (!(square > 0.0)) return;
  // Gradients of the weights of corners 1 and 2.
  const double per_square = 1.0 / square;
  const Vec3 g1 = ac.cross(n) * per_square, g2 = n.cross(ab) * per_square;
  normal_ = n * (side * std::sqrt(per_square));
  for (int axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<std::size_t>(axis);
    first_[i] = Two{-(g1[axis] + g2[axis]), g1[axis]};
    second_[i] = Two{g2[axis], normal_[axis]};
  }
  first_[3] = Two{1.0, 0.0};
}

}  // namespace palpate::stars
