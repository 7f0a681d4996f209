// Numbered surface points of box lattices and sphere rings. They sample spheres and slabs without tables.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace palpate::cloud {

/// The lattice points on the surface of nx x ny x nz cells (each at least 1), numbered layer by layer in z:
/// the lowest layer row by row, then each ring between (front row, both sides row by row, back row), then the
/// highest layer.
class BoxLattice {
 public:
  BoxLattice(std::uint32_t nx, std::uint32_t ny, std::uint32_t nz) : n_{nx, ny, nz} {}

  [[nodiscard]] std::size_t size() const noexcept { return 2 * full() + (n_[2] - 1) * ring(); }
  /// Lattice coordinates of a point, O(1).
  [[nodiscard]] std::array<std::uint32_t, 3> coordinates(std::size_t index) const noexcept;
  /// Number of a surface point, O(1).
  [[nodiscard]] std::uint32_t index(std::uint32_t i, std::uint32_t j, std::uint32_t k) const noexcept;
  /// Two triangles per cell of the six faces, counter-clockwise from outside.
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangles() const;

 private:
  [[nodiscard]] std::size_t full() const noexcept {
    return (std::size_t{n_[0]} + 1) * (std::size_t{n_[1]} + 1);
  }
  [[nodiscard]] std::size_t ring() const noexcept { return 2 * (std::size_t{n_[0]} + std::size_t{n_[1]}); }
  std::array<std::uint32_t, 3> n_;
};

/// Rings on a sphere, numbered in order: ring 0 is the lowest point, ring k has as many spokes as fit its
/// circumference.
class SphereRings {
 public:
  /// `rim`: angle of the last ring from the lowest point, radians. O(rings).
  SphereRings(double radius_mm, double rim, double spacing_mm);

  struct Place {
    std::uint32_t ring = 0, spoke = 0, spokes = 1;
  };
  [[nodiscard]] std::size_t size() const noexcept { return first_.back(); }
  /// Number of the last ring.
  [[nodiscard]] std::uint32_t rings() const noexcept { return static_cast<std::uint32_t>(first_.size() - 2); }
  /// O(log rings).
  [[nodiscard]] Place place(std::size_t index) const noexcept;
  /// Between adjacent rings, counter-clockwise from inside the sphere.
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangles() const;

 private:
  std::vector<std::size_t> first_;  ///< first point of each ring, then the number of points
};

}  // namespace palpate::cloud
