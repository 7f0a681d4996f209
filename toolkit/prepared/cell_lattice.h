// The lattice of a prepared file: integer coordinates of 42 bits per axis over a cube around all points, and
// their Morton keys. Cube edges are powers of two, so a point's coordinate is exact arithmetic, and every box
// of the binary tree over the keys is the same for any division of the work.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstddef>
#include <cstdint>

#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "toolkit/search/morton_order.h"

namespace palpate::prepared {

/// Two Morton codes per point, of the upper and the lower halves of its coordinates: 2^-42 of a country is
/// below a micrometre, and 126 bits still fit two words.
inline constexpr int kAxisBits = 2 * search::kMortonBits;
inline constexpr int kCodeBits = 3 * search::kMortonBits;
inline constexpr int kKeyBits = 2 * kCodeBits;

/// Cube coordinates, each below 2^42.
using LatticePoint = std::array<std::uint64_t, 3>;

/// A lattice point in sixteen bytes.
struct PackedPoint {
  std::uint64_t first = 0;   ///< x, and the low 22 bits of y
  std::uint64_t second = 0;  ///< the high 20 bits of y, and z

  static constexpr int kRestBits = 64 - kAxisBits;         ///< of y in the first word
  static constexpr int kLeftBits = kAxisBits - kRestBits;  ///< of y in the second
  [[nodiscard]] static constexpr PackedPoint of(const LatticePoint& p) noexcept {
    return {p[0] | p[1] << kAxisBits, p[1] >> kRestBits | p[2] << kLeftBits};
  }
  [[nodiscard]] constexpr LatticePoint point() const noexcept {
    constexpr std::uint64_t kAxis = (std::uint64_t{1} << kAxisBits) - 1;
    constexpr std::uint64_t kLeft = (std::uint64_t{1} << kLeftBits) - 1;
    return {first & kAxis, first >> kAxisBits | (second & kLeft) << kRestBits, second >> kLeftBits};
  }
};

/// The Morton key of a lattice point; a node of the binary tree is a prefix of `depth` bits. The splits are
/// along z, y, x, z, ..
struct CellKey {
  std::uint64_t high = 0;  ///< code of the coordinates' upper 21 bits
  std::uint64_t low = 0;   ///< of the lower
  auto operator<=>(const CellKey&) const = default;

  /// Bit of the split below `depth`, 0 .. 125.
  [[nodiscard]] constexpr bool bit(int depth) const noexcept {
    return depth < kCodeBits ? (high >> (kCodeBits - 1 - depth) & 1u) != 0
                             : (low >> (kKeyBits - 1 - depth) & 1u) != 0;
  }
};

[[nodiscard]] inline std::uint64_t upper_code(const LatticePoint& p) noexcept {
  constexpr int kHalf = search::kMortonBits;
  return search::morton_code(static_cast<std::uint32_t>(p[0] >> kHalf),
                             static_cast<std::uint32_t>(p[1] >> kHalf),
                             static_cast<std::uint32_t>(p[2] >> kHalf));
}
[[nodiscard]] inline std::uint64_t lower_code(const LatticePoint& p) noexcept {
  constexpr std::uint64_t kHalf = (std::uint64_t{1} << search::kMortonBits) - 1;
  return search::morton_code(static_cast<std::uint32_t>(p[0] & kHalf),
                             static_cast<std::uint32_t>(p[1] & kHalf),
                             static_cast<std::uint32_t>(p[2] & kHalf));
}
[[nodiscard]] inline CellKey key_of(const LatticePoint& p) noexcept {
  return {upper_code(p), lower_code(p)};
}

/// Where the cubes lie. Equal for equal boxes, whatever the points' order.
struct CellLattice {
  std::array<double, 3> first{};  ///< cubes from coordinate 0 mm to the low corner; whole numbers
  int unit_exponent = 0;          ///< a cube's edge is 2^unit_exponent mm

  bool operator==(const CellLattice&) const = default;
  /// The smallest cube of this kind around a box of finite numbers.
  [[nodiscard]] static CellLattice over(const geometry::Aabb& box_mm) noexcept;

  [[nodiscard]] double unit_mm() const noexcept { return std::ldexp(1.0, unit_exponent); }
  /// Longest edge of a node in mm: x is split last.
  [[nodiscard]] double node_edge_mm(int depth) const noexcept {
    return std::ldexp(1.0, unit_exponent + kAxisBits - depth / 3);
  }
  /// The cube of a place, as real numbers; exact. Outside of 0 .. 2^42 - 1 the lattice does not reach.
  [[nodiscard]] std::array<double, 3> cube(const Vec3& p_mm, double per_mm) const noexcept {
    return {std::floor(p_mm.x() * per_mm) - first[0], std::floor(p_mm.y() * per_mm) - first[1],
            std::floor(p_mm.z() * per_mm) - first[2]};
  }
  /// False where the place is outside.
  [[nodiscard]] bool locate(const Vec3& p_mm, double per_mm, LatticePoint& at) const noexcept {
    constexpr double kCubes = static_cast<double>(std::uint64_t{1} << kAxisBits);
    const std::array<double, 3> c = cube(p_mm, per_mm);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!(c[axis] >= 0.0 && c[axis] < kCubes)) return false;
      at[axis] = static_cast<std::uint64_t>(c[axis]);
    }
    return true;
  }
  /// The place of a lattice coordinate, which may lie between cubes' corners.
  [[nodiscard]] Vec3 place_mm(const Vec3& coordinate) const noexcept {
    return unit_mm() * (Vec3(first[0], first[1], first[2]) + coordinate);
  }
};

inline CellLattice CellLattice::over(const geometry::Aabb& box_mm) noexcept {
  constexpr int kSteps = 6;             // the low corner stands on 1/64 of the cube: at most a 1/64 is lost
  constexpr int kFarBits = 40;          // so that 2^(40 + 6) steps from coordinate 0 are an exact double
  constexpr int kLeastExponent = -500;  // far below any length, far above where doubles end
  CellLattice lattice;
  if (box_mm.empty()) return lattice;
  const auto exponent_above = [](double x) {
    int exponent = 0;
    std::frexp(x, &exponent);
    return x > 0.0 ? exponent : kLeastExponent;
  };
  const double extent = box_mm.extent_mm().maxCoeff();
  const double far = box_mm.low_mm.cwiseAbs().cwiseMax(box_mm.high_mm.cwiseAbs()).maxCoeff();
  int edge = std::max({exponent_above(extent), exponent_above(far) - kFarBits, kLeastExponent});
  for (bool holds = false; !holds; ++edge) {
    lattice.unit_exponent = edge - kAxisBits;
    for (int axis = 0; axis < 3; ++axis) {
      const double step = std::floor(std::ldexp(box_mm.low_mm[axis], kSteps - edge));
      lattice.first[static_cast<std::size_t>(axis)] = std::ldexp(step, kAxisBits - kSteps);
    }
    LatticePoint at{};
    holds = lattice.locate(box_mm.high_mm, std::ldexp(1.0, -lattice.unit_exponent), at);
  }
  return lattice;
}

}  // namespace palpate::prepared
