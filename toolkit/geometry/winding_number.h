// Winding numbers: whether a piece with holes encloses a volume, and on which side of it a place is. Scans
// usually have holes, and a probe that entered through one must not be held by a wall's back on its way out.
#pragma once

#include <palpate/vec.h>
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace palpate::geometry {

/// A small part of an oriented surface. mm or any unit; `area` along the normal.
struct AreaElement {
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  Eigen::Vector3f area = Eigen::Vector3f::Zero();
};

/// The share of all directions from `at` in which the parts are seen from behind: about 1 inside a closed
/// surface with outward normals and 0 outside; -1 and 0 with inward normals. Parts within half their width
/// count less, so places that close to the surface are uncertain. O(parts).
[[nodiscard]] double winding_number(std::span<const AreaElement> parts, const Vec3& at) noexcept;

/// Parts with a tree over them, in which what is far counts by its sum (Barill et al. 2018).
class SurfaceParts {
 public:
  SurfaceParts() = default;
  /// Any order, but neighbours in space should be neighbours in it, as along a Morton curve: that makes it
  /// fast. O(parts).
  explicit SurfaceParts(std::vector<AreaElement> parts);
  [[nodiscard]] std::span<const AreaElement> elements() const noexcept { return parts_; }
  /// winding_number() to a hundredth. O(log parts) in such an order.
  [[nodiscard]] double winding_number(const Vec3& at) const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept {
    return parts_.capacity() * sizeof(AreaElement) + nodes_.capacity() * sizeof(Node);
  }

 private:
  /// Before the nodes below it.
  struct Node {
    AreaElement sum;
    float radius = 0.0f;                 ///< of the parts around the sum's middle
    std::uint32_t after = 0;             ///< the next node that is not below it
    std::uint32_t first = 0, count = 0;  ///< parts of a leaf
  };
  struct Box {
    Eigen::Vector3f low, high;
  };
  Box build(std::size_t first, std::size_t past);

  std::vector<AreaElement> parts_;
  std::vector<Node> nodes_;
};

/// 1 if the parts enclose a volume (holes allowed) with outward normals, -1 with inward ones; 0 if open, or
/// too thin or small to tell. Independent of the number of threads. O(parts).
[[nodiscard]] float normal_orientation(std::span<const AreaElement> parts, int threads = 1);

/// A piece with a wider opening resembles a vase more than a scanned body; a warning says that it is felt
/// from one side.
inline constexpr double kWideOpeningFraction = 0.05;
/// With no wider opening a piece is tight: a HIP behind it came through the surface, not a hole, and is
/// pushed out again.
inline constexpr double kTightOpeningFraction = 0.02;

/// The area vectors of a closed surface cancel (divergence theorem). The rest of an oriented piece is its
/// opening's area, returned as a share of the piece's area: 0 closed, 0.12 for a ball with an opening of 80
/// degrees, 0.5 for a half ball. Opposite openings (a pipe) cancel too and go unseen. Independent of the
/// number of threads. O(parts).
[[nodiscard]] inline double opening_fraction(std::span<const AreaElement> parts) noexcept {
  Vec3 sum = Vec3::Zero();
  double area = 0.0;
  for (const AreaElement& part : parts) {
    sum += part.area.cast<double>();
    area += part.area.cast<double>().norm();
  }
  return area > 0.0 ? sum.norm() / area : 0.0;
}

}  // namespace palpate::geometry
