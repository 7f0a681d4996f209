// A point proxy among balls of one radius around the points of a cloud: it moves towards a goal, never into a
// ball, and comes to rest where the distance to the goal has a local minimum (Ruspini et al. 1997 with balls
// for obstacles). No tolerance like the open haptics library's is needed: along the surface of one ball and
// along the circle where two meet, the place where the next ball is met has a closed form.
#pragma once

#include <array>
#include <cstdint>

#include "baselines/points/near_points.h"
#include "toolkit/geometry/half_spaces.h"

namespace palpate::baselines {

/// Moves of the proxy in a frame, at most; the rest is done in the next frame. Resting in a pit takes 2 or 3,
/// a millimetre over a bumpy surface some 4 a point.
inline constexpr int kMaxBallMoves = 64;
/// Everything local to the cloud's origin, mm. The grid must outlive it and not move. Belongs to one thread;
/// the frame functions allocate nothing.
class BallWalk {
 public:
  /// Cells of about two radii suit it best.
  BallWalk(const PointGrid& points, double radius_mm);

  /// Within balls, the proxy starts outside of them, on the side of `at`.
  void reset(const Vec3& at) noexcept;
  /// Moves the proxy towards `goal`. Returns false where a bound was hit.
  bool go(const Vec3& goal) noexcept;

  [[nodiscard]] const Vec3& proxy() const noexcept { return at_; }
  /// Balls that carry it at rest, 0 to 3.
  [[nodiscard]] int carried_by() const noexcept { return carried_by_; }
  [[nodiscard]] double reach_mm() const noexcept { return near_.reach_mm(); }
  [[nodiscard]] std::uint64_t moves() const noexcept { return moves_; }

 private:
  /// The balls touched whose push keeps the proxy from its goal.
  struct Hold {
    Vec3 way = Vec3::Zero();  ///< what the touched balls leave of the pull
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
  NearPoints<partition::UniformGrid> near_;
  int carried_by_ = 0;
  std::uint64_t moves_ = 0;
};

}  // namespace palpate::baselines
