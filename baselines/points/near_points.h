// Caches the points around a proxy for many moves; thins locally dense clouds until the cache holds them;
// straight flights among balls around points.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "baselines/points/point_grid.h"

namespace palpate::baselines {

/// Most cached points. Locally dense clouds are thinned (thinned.h); if moved points still exceed it, the
/// proxy stays and the frame reports its bound.
inline constexpr std::size_t kMaxNear = 16384;
/// Flights are searched in pieces of this many cells, and at most this many pieces a frame.
inline constexpr double kPieceCells = 8.0;
inline constexpr int kMaxPieces = 64;

/// Belongs to one thread; the points must outlive it. fetch() allocates nothing.
template <class Grid>
class NearPoints {
 public:
  /// With scales (parallel to the points, at most `most`) each point's reach is its own share.
  NearPoints(const PointsIn<Grid>& points, double reach_mm, double stride_mm,
             std::span<const float> scale = {}, double most = 1.0)
      : points_(&points),
        scale_(scale),
        reach_(reach_mm),
        most_(most),
        stride_(stride_mm),
        at_hand_(kMaxNear),
        scale_at_hand_(scale.empty() ? 0 : kMaxNear) {}

  void forget() noexcept { fetched_ = false; }
  void use(const PointsIn<Grid>& points) noexcept {
    points_ = &points;
    fetched_ = false;
  }
  /// Makes all() hold at least every point within reach of any place within a stride of `at`; no work within
  /// a stride of the last fetch. False for more than kMaxNear.
  bool fetch(const Vec3& at) noexcept {
    if (fetched_ && (at - fetched_at_).squaredNorm() <= stride_ * stride_) return true;
    count_ = 0;
    bool room = true;
    points_->within(at, reach_mm(), [&](std::uint32_t place, double sq) {
      if (!scale_.empty()) {
        const double scale = static_cast<double>(scale_[place]), own = reach_ * scale + 2.0 * stride_;
        if (sq > own * own) return;
        if (count_ < kMaxNear) scale_at_hand_[count_] = scale;
      }
      if (count_ == kMaxNear)
        room = false;
      else
        at_hand_[count_++] = points_->points[place].at();
    });
    fetched_ = room;
    fetched_at_ = at;
    return room;
  }
  [[nodiscard]] std::span<const Vec3> all() const noexcept { return {at_hand_.data(), count_}; }
  /// Parallel to all(); empty without scales.
  [[nodiscard]] std::span<const double> scales() const noexcept {
    return {scale_at_hand_.data(), scale_.empty() ? 0 : count_};
  }
  /// Search distance from the place of fetch().
  [[nodiscard]] double reach_mm() const noexcept { return reach_mm(most_); }
  /// Largest distance of points of this scale.
  [[nodiscard]] double reach_mm(double scale) const noexcept { return reach_ * scale + 2.0 * stride_; }
  static constexpr std::size_t bytes_for(bool scaled) noexcept {
    return kMaxNear * (sizeof(Vec3) + (scaled ? sizeof(double) : 0));
  }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_for(!scale_.empty()); }

 private:
  const PointsIn<Grid>* points_;
  std::span<const float> scale_;
  double reach_, most_, stride_;
  std::vector<Vec3> at_hand_;  ///< kMaxNear places
  std::vector<double> scale_at_hand_;
  std::size_t count_ = 0;
  bool fetched_ = false;
  Vec3 fetched_at_ = Vec3::Zero();
};

/// The end of a straight flight.
struct Flight {
  Vec3 at = Vec3::Zero();
  bool met = false;      ///< a ball is in the way; `at` is on it
  bool finished = true;  ///< false: too long for one frame; `at` is the searched end
};

/// The ball that stops a flight.
struct InTheWay {
  double share = 1.0;  ///< free share of the way; 1 if all
  Vec3 centre = Vec3::Zero();
  double radius = 0.0;
};

/// The free part of a -> b among balls of radius_of(place), at most `largest`. Ignores balls that the way
/// enters at its start by less than `graze` (a cosine).
template <class Grid, class RadiusOf>
[[nodiscard]] InTheWay first_in_the_way(const PointsIn<Grid>& points, const RadiusOf& radius_of,
                                        double largest, double graze, const Vec3& a, const Vec3& b) noexcept {
  const Vec3 d = b - a;
  const double length_sq = d.squaredNorm();
  InTheWay found;
  if (!(length_sq > 0.0)) return found;
  const double length = std::sqrt(length_sq);
  visit_segment_ranges(points.grid, a, b, Vec3::Constant(largest), [&](search::IndexRange range) {
    for (std::uint32_t place = range.begin; place < range.end; ++place) {
      const Vec3 to = points.points[place].at() - a;
      const double along = to.dot(d);
      const double radius = radius_of(place);
      // Behind, or touched and left or grazed.
      if (!(along > graze * radius * length)) continue;
      const double root_sq = along * along - length_sq * (to.squaredNorm() - radius * radius);
      if (!(root_sq > 0.0)) continue;
      const double t = std::max(0.0, (along - std::sqrt(root_sq)) / length_sq);
      if (t >= found.share) continue;
      found = {t, a + to, radius};
    }
    return true;
  });
  return found;
}

/// Straight from `from` to `goal`, up to the first ball of radius_of(place), at most `largest`. Passes
/// through nothing at any length.
template <class Grid, class RadiusOf>
[[nodiscard]] Flight fly(const PointsIn<Grid>& points, const RadiusOf& radius_of, double largest,
                         double graze, const Vec3& from, const Vec3& goal) noexcept {
  const Vec3 way = goal - from;
  const double length = stable_norm(way);
  const double piece = kPieceCells * points.cell_mm();
  const double pieces = std::ceil(length / piece);
  const bool whole = pieces <= kMaxPieces;
  const int count = whole ? std::max(1, static_cast<int>(pieces)) : kMaxPieces;
  const double share = whole ? 1.0 / count : piece / length;
  Flight flight{from, false, whole};
  for (int i = 1; i <= count; ++i) {
    const Vec3 end = whole && i == count ? goal : Vec3(from + way * (share * i));
    const InTheWay ball = first_in_the_way(points, radius_of, largest, graze, flight.at, end);
    if (ball.share < 1.0) {
      flight.at += (end - flight.at) * ball.share;
      const Vec3 out = flight.at - ball.centre;
      const double size = out.norm();
      if (size > 0.0) flight.at = ball.centre + out * (ball.radius / size);
      return {flight.at, true, true};
    }
    flight.at = end;
  }
  return flight;
}

/// The same for balls of one radius.
template <class Grid>
[[nodiscard]] Flight fly(const PointsIn<Grid>& points, double radius, double graze, const Vec3& from,
                         const Vec3& goal) noexcept {
  return fly(
      points, [radius](std::uint32_t) { return radius; }, radius, graze, from, goal);
}

/// The cloud that a proxy walks on.
struct Thinned {
  /// The given cloud if at most kMaxNear points are within reach anywhere.
  std::shared_ptr<const cloud::Cloud> cloud;
  double cell_mm = 0.0;  ///< edge of the cells with one point each; 0: not thinned
};

/// False if this many points per cell can never put more than kMaxNear within reach.
[[nodiscard]] bool may_be_too_many(std::size_t most_in_cell, double cell_mm, double reach_mm) noexcept;

/// Keeps the point nearest to each cell's centre. Cells are a sixteenth of the radius, doubled as needed. A
/// dropped point has a kept one within the cell's diagonal: along the surface of a ball of the radius, under
/// 0.6 % of the radius in height. Independent of the points' order except for ties. Drops properties and
/// raster. O(n log n) for dense points, else O(n).
[[nodiscard]] Thinned thinned_to_reach(std::shared_ptr<const cloud::Cloud> cloud, double radius_mm,
                                       double reach_mm, render::PrepareReport& report);

}  // namespace palpate::baselines
