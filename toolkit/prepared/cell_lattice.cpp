#include "toolkit/prepared/cell_lattice.h"

#include <algorithm>

namespace palpate::prepared {

CellLattice CellLattice::over(const geometry::Aabb& box_mm) noexcept {
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
