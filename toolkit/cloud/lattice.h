// The surface of a box-shaped lattice, numbered without a table: what the sphere and the slab are sampled on.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace palpate::cloud {

/// The lattice points on the surface of nx x ny x nz cells (each at least 1). They are numbered layer by
/// layer in z: the lowest layer row by row, then the ring of every layer between (front row, the two sides
/// row by row, back row), then the highest.
class BoxLattice {
 public:
  BoxLattice(std::uint32_t nx, std::uint32_t ny, std::uint32_t nz) : n_{nx, ny, nz} {}

  [[nodiscard]] std::size_t size() const noexcept { return 2 * full() + (n_[2] - 1) * ring(); }
  /// Lattice coordinates of a point, O(1).
  [[nodiscard]] std::array<std::uint32_t, 3> coordinates(std::size_t index) const noexcept;
  /// Number of a point of the surface, O(1).
  [[nodiscard]] std::uint32_t index(std::uint32_t i, std::uint32_t j, std::uint32_t k) const noexcept;
  /// Two triangles a cell of each of the six faces, counter-clockwise from outside.
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangles() const;

 private:
  [[nodiscard]] std::size_t full() const noexcept {
    return (std::size_t{n_[0]} + 1) * (std::size_t{n_[1]} + 1);
  }
  [[nodiscard]] std::size_t ring() const noexcept { return 2 * (std::size_t{n_[0]} + std::size_t{n_[1]}); }
  std::array<std::uint32_t, 3> n_;
};

}  // namespace palpate::cloud
