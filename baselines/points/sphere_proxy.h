// A point proxy among equal balls around a cloud's points. It moves towards a goal without entering balls and
// rests at a local minimum of the distance (Ruspini et al. 1997 with balls as obstacles). Needs no tolerance,
// unlike the open haptics library: on a ball, and on the circle of two balls, the next contact has a closed
// form.
#pragma once

#include <array>
#include <cstdint>

#include "baselines/points/near_points.h"
#include "toolkit/geometry/half_space_projection.h"

namespace palpate::baselines {

/// Most moves of the proxy per frame; the rest waits. Resting in a pit takes 2 or 3, a millimetre over a
/// bumpy surface some 4 a point.
inline constexpr int kMaxBallMoves = 64;
/// Local to the cloud's origin, mm. The grid must outlive it and not move. Belongs to one thread; frame
/// functions allocate nothing.
class BallWalk {
 public:
  /// Cells of about two radii are best.
  BallWalk(const PointGrid& points, double radius_mm);

  /// If `at` is within balls, the proxy starts outside them on its side.
  void reset(const Vec3& at) noexcept;
  /// Moves the proxy towards `goal`. False at a bound.
  bool go(const Vec3& goal) noexcept;

  [[nodiscard]] const Vec3& proxy() const noexcept { return at_; }
  /// Number of balls that carry it at rest, 0 to 3.
  [[nodiscard]] int carried_by() const noexcept { return carried_by_; }
  [[nodiscard]] double reach_mm() const noexcept { return near_.reach_mm(); }
  [[nodiscard]] std::uint64_t moves() const noexcept { return moves_; }

 private:
  /// The touched balls that keep the proxy from its goal.
  struct Hold {
    Vec3 way = Vec3::Zero();  ///< the part of the pull that they leave
    std::array<Vec3, 3> centre{};
    int count = 0;
  };
  void escape() noexcept;
  [[nodiscard]] Hold hold(const Vec3& pull) const noexcept;
  void slide(const Vec3& centre, double radius, Vec3 out, Vec3 along, const Vec3& goal,
             const Hold& hold) noexcept;

  const PointGrid* points_;
  double radius_;
  Vec3 at_ = Vec3::Zero();
  NearPoints<search::UniformGrid> near_;
  int carried_by_ = 0;
  std::uint64_t moves_ = 0;
};

}  // namespace palpate::baselines
