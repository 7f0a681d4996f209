// Points in rings about the lowest point of a sphere, evenly spaced up to a rim. Internal to cloud.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace palpate::cloud {

/// Ring 0 is the lowest point; ring k has as many spokes as fit its circumference. Numbered ring by ring.
class Rings {
 public:
  /// `rim` is the angle of the last ring from the lowest point, in radians. O(rings).
  Rings(double radius_mm, double rim, double spacing_mm);

  struct Place {
    std::uint32_t ring = 0, spoke = 0, spokes = 1;
  };
  [[nodiscard]] std::size_t size() const noexcept { return first_.back(); }
  /// The number of the last ring.
  [[nodiscard]] std::uint32_t rings() const noexcept { return static_cast<std::uint32_t>(first_.size() - 2); }
  /// O(log rings).
  [[nodiscard]] Place place(std::size_t index) const noexcept;
  /// Between neighbouring rings, counter-clockwise from inside the sphere.
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangles() const;

 private:
  std::vector<std::size_t> first_;  ///< the first point of each ring, and the number of points
};

}  // namespace palpate::cloud
