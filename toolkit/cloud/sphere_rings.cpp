#include "toolkit/cloud/box_lattice.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::cloud {

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
