// The pantograph of Haply's 2DIY: two motors side by side, two arms of two bars that meet in the grip. Plane:
// x from the first motor's axis to the second's, y away from them. Lengths mm, angles rad from x.
// Source: the maker's published kinematics; derived anew here.
#pragma once

#include <Eigen/Core>

#include <array>
#include <optional>

#include "toolkit/core/vec.h"

namespace palpate::device {

struct PantographGeometry {
  double crank_mm = 70.0, bar_mm = 90.0;
  double between_mm = 0.0;  ///< the motors' axes: 0 where one is above the other
};

struct PantographPose {
  Eigen::Vector2d position_mm = Eigen::Vector2d::Zero();
  Eigen::Matrix2d mm_per_rad = Eigen::Matrix2d::Zero();  ///< column i: what motor i alone moves
};

/// Nothing where the bars do not reach each other, or lie so nearly in line that the grip's place is not told
/// by the cranks. Of the two ways on it takes the one with the grip away from the motors.
[[nodiscard]] std::optional<PantographPose> pantograph_pose(const PantographGeometry& geometry,
                                                            const std::array<double, 2>& angles) noexcept;
/// The angles of a place; nothing where it is out of reach.
[[nodiscard]] std::optional<std::array<double, 2>> pantograph_angles(
    const PantographGeometry& geometry, const Eigen::Vector2d& place_mm) noexcept;

}  // namespace palpate::device
