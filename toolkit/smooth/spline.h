// A brick's uniform cubic B-spline: its value at a place, its gradient and its second derivatives.
#pragma once

#include <array>

#include "toolkit/core/vec.h"
#include "toolkit/smooth/brick_grid.h"

namespace palpate::render {

/// What a spline tells at a place, in voxels.
struct Jet {
  float value = 0.0f;
  Eigen::Vector3f gradient = Eigen::Vector3f::Zero();
  /// xx, yy, zz, xy, xz, yz
  std::array<float, 6> second{};
};

/// A place in a brick: cell and share of it.
struct BrickPlace {
  std::array<int, 3> cell{};
  std::array<float, 3> t{};
};

/// 16 rows of four coefficients. Eight floats at a time where the processor has AVX2 (wide_lanes()), with the
/// same bits where it has not. Thread-safe.
[[nodiscard]] Jet spline_jet(const Brick& brick, const BrickPlace& at) noexcept;
/// The value alone: as jet.value, to the bit.
[[nodiscard]] float spline_value(const Brick& brick, const BrickPlace& at) noexcept;

/// The same by fours, for tests.
[[nodiscard]] Jet narrow_spline_jet(const Brick& brick, const BrickPlace& at) noexcept;
[[nodiscard]] float narrow_spline_value(const Brick& brick, const BrickPlace& at) noexcept;

}  // namespace palpate::render
