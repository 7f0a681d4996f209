#include "toolkit/cloud/box_lattice.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::cloud {

std::array<std::uint32_t, 3> BoxLattice::coordinates(std::size_t index) const noexcept {
  const std::size_t row = n_[0] + std::size_t{1};
  const std::size_t middle = (n_[2] - std::size_t{1}) * ring();
  const auto at = [](std::size_t i, std::size_t j, std::size_t k) {
    return std::array<std::uint32_t, 3>{static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j),
                                        static_cast<std::uint32_t>(k)};
  };
  if (index < full()) return at(index % row, index / row, 0);
  index -= full();
  if (index >= middle) {
    index -= middle;
    return at(index % row, index / row, n_[2]);
  }
  const std::size_t k = 1 + index / ring();
  index %= ring();
  if (index < row) return at(index, 0, k);
  index -= row;
  const std::size_t sides = 2 * (n_[1] - std::size_t{1});
  if (index < sides) return at(index % 2 == 0 ? 0 : n_[0], 1 + index / 2, k);
  return at(index - sides, n_[1], k);
}

std::uint32_t BoxLattice::index(std::uint32_t i, std::uint32_t j, std::uint32_t k) const noexcept {
  const std::size_t row = n_[0] + std::size_t{1};
  std::size_t at = 0;
  if (k == 0) {
    at = j * row + i;
  } else if (k == n_[2]) {
    at = full() + (n_[2] - std::size_t{1}) * ring() + j * row + i;
  } else {
    at = full() + (k - std::size_t{1}) * ring();
    if (j == 0) {
      at += i;
    } else if (j == n_[1]) {
      at += row + 2 * (n_[1] - std::size_t{1}) + i;
    } else {
      at += row + 2 * (j - std::size_t{1}) + (i == 0 ? 0 : 1);
    }
  }
  return static_cast<std::uint32_t>(at);
}

std::vector<std::array<std::uint32_t, 3>> BoxLattice::triangles() const {
  std::vector<std::array<std::uint32_t, 3>> found;
  const std::size_t nx = n_[0], ny = n_[1], nz = n_[2];
  found.reserve(4 * (nx * ny + ny * nz + nz * nx));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool high : {false, true})
      for (std::uint32_t b = 0; b < n_[v]; ++b)
        for (std::uint32_t a = 0; a < n_[u]; ++a) {
          const auto corner = [&](std::uint32_t da, std::uint32_t db) {
            std::array<std::uint32_t, 3> c{};
            c[axis] = high ? n_[axis] : 0;
            c[u] = a + da;
            c[v] = b + db;
            return index(c[0], c[1], c[2]);
          };
          const std::uint32_t p00 = corner(0, 0), p10 = corner(1, 0), p11 = corner(1, 1), p01 = corner(0, 1);
          if (high) {
            found.push_back({p00, p10, p11});
            found.push_back({p00, p11, p01});
          } else {
            found.push_back({p00, p11, p10});
            found.push_back({p00, p01, p11});
          }
        }
  }
  return found;
}

SphereRings::SphereRings(double radius_mm, double rim, double spacing_mm) {
  constexpr double kMinSpokes = 3.0;  // a ring of fewer encloses nothing
  const auto last = static_cast<std::size_t>(std::max(1.0, std::round(radius_mm * rim / spacing_mm)));
  first_ = {0, 1};
  for (std::size_t ring = 1; ring <= last; ++ring) {
    const double angle = rim * static_cast<double>(ring) / static_cast<double>(last);
    const double round_mm = 2.0 * std::numbers::pi * radius_mm * std::sin(angle);
    first_.push_back(first_.back() +
                     static_cast<std::size_t>(std::max(kMinSpokes, std::round(round_mm / spacing_mm))));
  }
}

SphereRings::Place SphereRings::place(std::size_t index) const noexcept {
  const auto next = std::upper_bound(first_.begin(), first_.end(), index);
  const auto ring = static_cast<std::size_t>(next - first_.begin()) - 1;
  return {static_cast<std::uint32_t>(ring), static_cast<std::uint32_t>(index - first_[ring]),
          static_cast<std::uint32_t>(first_[ring + 1] - first_[ring])};
}

std::vector<std::array<std::uint32_t, 3>> SphereRings::triangles() const {
  std::vector<std::array<std::uint32_t, 3>> found;
  for (std::size_t ring = 0; ring + 2 < first_.size(); ++ring) {
    const std::size_t inner = first_[ring + 1] - first_[ring], outer = first_[ring + 2] - first_[ring + 1];
    const auto in = [&](std::size_t i) { return static_cast<std::uint32_t>(first_[ring] + i % inner); };
    const auto out = [&](std::size_t i) { return static_cast<std::uint32_t>(first_[ring + 1] + i % outer); };
    // Walks both rings together; the one behind steps next. A ring of one point has no side.
    const std::size_t inner_steps = inner > 1 ? inner : 0;
    for (std::size_t i = 0, o = 0; i < inner_steps || o < outer;) {
      const bool step_out = i == inner_steps || (o < outer && (o + 1) * inner <= (i + 1) * outer);
      if (step_out) {
        found.push_back({in(i), out(o), out(o + 1)});
        ++o;
      } else {
        found.push_back({in(i), out(o), in(i + 1)});
        ++i;
      }
    }
  }
  return found;
}

}  // namespace palpate::cloud
