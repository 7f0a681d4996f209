// A point proxy among balls of one radius around the points of a cloud: it moves towards a goal, never into a
// ball, and comes to rest where the distance to the goal has a local minimum (Ruspini et al. 1997 with balls
// for obstacles). No tolerance like the open haptics library's is needed: along the surface of one ball and
// along the circle where two meet, the place where the next ball is met has a closed form.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "baselines/points/point_grid.h"
#include "toolkit/geometry/half_spaces.h"

namespace palpate::baselines {

/// Moves of the proxy in a frame, at most; the rest is done in the next frame. Resting in a pit takes 2 or 3,
/// a millimetre over a bumpy surface some 4 a point.
inline constexpr int kMaxBallMoves = 64;
/// Balls around the proxy that are kept at hand, at most. Where more are in reach (clumps far denser than the
/// cloud), the proxy stays where it is and the frame says that its bound was hit.
inline constexpr std::size_t kMaxBalls = 8192;
/// Straight flights are searched in pieces of so many cells, at most so many pieces a frame.
inline constexpr double kPieceCells = 8.0;
inline constexpr int kMaxPieces = 64;

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
  [[nodiscard]] std::uint64_t moves() const noexcept { return moves_; }

 private:
  /// The balls touched whose push keeps the proxy from its goal.
  struct Hold {
    Vec3 way = Vec3::Zero();  ///< what the touched balls leave of the pull
    std::array<Vec3, 3> centre{};
    int count = 0;
  };
  void escape() noexcept;
  bool gather() noexcept;
  [[nodiscard]] Hold hold(const Vec3& pull) const noexcept;
  bool fly(const Vec3& goal) noexcept;
  [[nodiscard]] double first_ball(const Vec3& a, const Vec3& b, Vec3& centre) const noexcept;
  void slide(const Vec3& centre, double radius, Vec3 out, Vec3 along, const Vec3& goal,
             const Hold& hold) noexcept;

  const PointGrid* points_;
  double radius_;
  Vec3 at_ = Vec3::Zero();
  Vec3 gathered_at_ = Vec3::Zero();
  bool gathered_ = false;
  std::vector<Vec3> balls_;  ///< kMaxBalls places
  std::size_t ball_count_ = 0;
  int carried_by_ = 0;
  std::uint64_t moves_ = 0;
};

}  // namespace palpate::baselines
