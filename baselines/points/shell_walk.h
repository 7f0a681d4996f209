// The walk shared by `stream-proxy` and `variable-proxy`: a proxy steered by points within three shells, of
// equal radii everywhere or individual per point.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>

#include <palpate/renderer.h>
#include "baselines/points/near_points.h"
#include "baselines/points/rival.h"

namespace palpate::baselines {

/// Most proxy steps per frame; the rest waits. A contact frame takes 1 to 4.
inline constexpr int kMaxShellSteps = 32;
inline OptionSpec shell_steps_spec() {
  return option::integer("walk_steps", std::to_string(kMaxShellSteps),
                         "steps of the proxy in a frame, at most; what is left is done in the next", 4, 1024);
}
/// Largest step along the surface as a share of r1: points at least r1 away stay on their side.
inline constexpr double kShellStep = 0.5;
/// At rest below this share of pull along the surface: a twentieth of a degree.
inline constexpr double kShellRest = 1e-3;
/// Flights that enter a ball below this cosine graze it (derived in sphere_proxy.cpp).
inline constexpr double kShellGraze = 5e-6;

/// Radii in mm if equal for all points, else factors of each point's scale.
struct Shells {
  double r1 = 0.0;      ///< nearer points push the proxy out
  double r2 = 0.0;      ///< nearer points are touched; above r1
  double r3 = 0.0;      ///< nearer points give the normal; at least r2
  bool tapered = true;  ///< weights fade to zero at r3; else all are equal
};

/// Belongs to one thread. Points and scales must outlive it and not move; frame functions allocate nothing.
template <class Grid>
class ShellWalk {
 public:
  /// `scale` is parallel to the points, or empty for all 1; `least` and `most` are its extremes.
  ShellWalk(const PointsIn<Grid>& points, const Shells& shells, std::span<const float> scale = {},
            double least = 1.0, double most = 1.0)
      : points_(&points),
        shells_(shells),
        scale_(scale),
        stride_(kShellStep * shells.r1 * least),
        most_(most),
        near_(points, shells.r3, stride_, scale, most) {}

  void bound_steps(int most) noexcept { most_steps_ = most; }
  void release_contact(const Vec3& h) noexcept {
    at_ = h;
    near_.forget();
    around_ = {};
    touching_ = false;
  }
  /// The points have moved.
  void forget() noexcept { near_.forget(); }
  /// Goes on among other points, without scales; the proxy stays where it is.
  void use(const PointsIn<Grid>& points) noexcept {
    points_ = &points;
    near_.use(points);
  }
  /// Call before use() for points of a newer image: where they have passed the proxy on their way to the
  /// camera, it goes back before them. At most three flights of `reach_mm`.
  void go_before(const PointsIn<Grid>& newer, const Vec3& camera_mm, double reach_mm) noexcept {
    const Vec3 away = camera_mm - at_;
    const double distance = away.norm();
    if (!(distance > 0.0)) return;
    const Vec3 start = at_ + away * (std::min(reach_mm, distance) / distance);
    const auto met = [&](const PointsIn<Grid>& points) {
      return fly(points, shells_.r1, kShellGraze, start, at_).met;
    };
    if (met(newer) && !met(*points_)) at_ = fly(newer, kept_off(), kShellGraze, start, at_).at;
  }

  /// Steps until the proxy is free at the HIP or rests on the points. False at a bound.
  bool walk(const Vec3& h, render::FrameCounters& counters) noexcept;

  /// From the HIP to the proxy, minus the proxy's distance from the points unless that is felt.
  [[nodiscard]] RivalAnswer answer(const Vec3& h, bool finished, bool felt_offset) const noexcept {
    RivalAnswer answer;
    Vec3 pull = at_ - h;
    if (touching_ && !felt_offset) pull -= around_.normal * around_.height;
    if (touching_ && around_.normal.dot(pull) > 0.0) answer = {true, false, pull, Vec3::Zero()};
    answer.bound_hit = !finished;
    return answer;
  }
  [[nodiscard]] std::size_t bytes() const noexcept { return near_.bytes(); }
  /// For points of this scale.
  [[nodiscard]] double reach_mm(double scale) const noexcept { return near_.reach_mm(scale); }

 private:
  /// Properties of the points around a place.
  struct Around {
    Vec3 normal = Vec3::Zero();  ///< away from the points, unit; zero without points within r3
    double height = 0.0;         ///< over the points' weighted mean, along the normal
    double nearest = 0.0;        ///< distance over the point's scale; infinite without points
    double scale = 1.0;          ///< of the shells here
  };
  [[nodiscard]] Around look(const Vec3& at) const noexcept;
  [[nodiscard]] double scale_at(const Vec3& at) const noexcept;
  [[nodiscard]] double kept_off() const noexcept { return 0.5 * (shells_.r1 + shells_.r2); }
  [[nodiscard]] Flight fly_to(const Vec3& h) const noexcept;

  const PointsIn<Grid>* points_;
  Shells shells_;
  std::span<const float> scale_;
  double stride_, most_;
  NearPoints<Grid> near_;
  Vec3 at_ = Vec3::Zero();
  Around around_;
  bool touching_ = false;
  int most_steps_ = kMaxShellSteps;
};

template <class Grid>
typename ShellWalk<Grid>::Around ShellWalk<Grid>::look(const Vec3& at) const noexcept {
  Around found;
  double weights = 0.0, nearest_sq = std::numeric_limits<double>::infinity();
  Vec3 directions = Vec3::Zero(), away = Vec3::Zero();
  const double scale = scale_at(at), r3 = shells_.r3 * scale, r3_sq = r3 * r3;
  const std::span<const Vec3> points = near_.all();
  const std::span<const double> scales = near_.scales();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 d = at - points[i];
    const double sq = d.squaredNorm();
    // Each point by its own scale, as flights meet its ball.
    nearest_sq = std::min(nearest_sq, scales.empty() ? sq : sq / (scales[i] * scales[i]));
    if (sq > r3_sq) continue;
    if (!(sq > 0.0)) continue;
    const double fall = 1.0 - sq / r3_sq;
    const double weight = shells_.tapered ? fall * fall : 1.0;
    directions += d * (weight / std::sqrt(sq));
    away += weight * d;
    weights += weight;
  }
  found.nearest = std::sqrt(nearest_sq);
  found.scale = scale;
  const double size = directions.norm();
  if (size > 0.0) {
    found.normal = directions / size;
    found.height = found.normal.dot(away) / weights;
  }
  return found;
}

/// The mean of the surrounding scales, weighted as for the normal at scale 1.
template <class Grid>
double ShellWalk<Grid>::scale_at(const Vec3& at) const noexcept {
  const std::span<const Vec3> points = near_.all();
  const std::span<const double> scales = near_.scales();
  if (scales.empty()) return 1.0;
  double weights = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double r3 = shells_.r3 * scales[i], fall = 1.0 - (at - points[i]).squaredNorm() / (r3 * r3);
    if (!(fall > 0.0)) continue;
    const double weight = fall * fall;
    weights += weight;
    sum += weight * scales[i];
  }
  return weights > 0.0 ? sum / weights : most_;
}

template <class Grid>
Flight ShellWalk<Grid>::fly_to(const Vec3& h) const noexcept {
  if (scale_.empty()) return fly(*points_, kept_off(), kShellGraze, at_, h);
  const auto radius_of = [this](std::uint32_t place) {
    return kept_off() * static_cast<double>(scale_[place]);
  };
  return fly(*points_, radius_of, kept_off() * most_, kShellGraze, at_, h);
}

template <class Grid>
bool ShellWalk<Grid>::walk(const Vec3& h, render::FrameCounters& counters) noexcept {
  for (int step = 0; step < most_steps_; ++step) {
    ++counters.walk_steps;
    if (!near_.fetch(at_)) return false;
    around_ = look(at_);
    const Vec3 pull = h - at_;
    const double inwards = around_.normal.dot(pull);
    const double scale = around_.scale, stride = kShellStep * shells_.r1 * scale;
    if (around_.nearest < shells_.r1) {
      // Entrenched: moves out along the normal. Amid points with a zero normal there is no way out.
      touching_ = true;
      if (around_.normal == Vec3::Zero()) return true;
      at_ += around_.normal * std::min((kept_off() - around_.nearest) * scale, stride);
      continue;
    }
    if (around_.nearest > shells_.r2 || inwards >= 0.0) {
      // Free or leaving. With a free way the HIP is reached.
      const Flight flight = fly_to(h);
      const bool moved = flight.at != at_;
      at_ = flight.at;
      touching_ = flight.met;
      if (!flight.met) return flight.finished;
      if (moved) continue;
      if (!near_.fetch(at_)) return false;
    }
    touching_ = true;
    Vec3 along = pull - around_.normal * inwards;
    const double size = along.norm();
    if (!(size > kShellRest * pull.norm())) return true;
    if (size > stride) along *= stride / size;
    at_ += along;
  }
  return false;
}

/// Base of the rivals on a ShellWalk.
template <class Grid>
class ShellRival : public RivalModel {
 public:
  static constexpr bool kGodObject = true;
  void release_contact(const Vec3& h) noexcept {
    walk_->release_contact(h);
    state.release();
  }

 protected:
  void take_options(const Options& options) {
    felt_offset_ = is_offset_kept(options);
    walk_steps_ = static_cast<int>(options.integer("walk_steps"));
  }
  /// `scale`: by cloud index; empty: all 1. Keeps the grid's order.
  void build(const cloud::Cloud& cloud, std::span<const float> scale, int threads) {
    search::PartitionOptions grid;
    grid.cell_mm = shells_.r3;
    points_ = build_points_in<Grid>(cloud, grid, threads);
    scales_ = placed_scales(scale, points_.grid.order());
    walk_ =
        std::make_unique<ShellWalk<Grid>>(points_, shells_, scales_.by_place, scales_.least, scales_.most);
    walk_->bound_steps(walk_steps_);
  }
  [[nodiscard]] RivalAnswer walk(const Vec3& h, render::FrameCounters& counters) noexcept {
    const bool finished = walk_->walk(h, counters);
    return walk_->answer(h, finished, felt_offset_);
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return points_.bytes() + scales_.by_place.capacity() * sizeof(float) + walk_->bytes();
  }

  PointsIn<Grid> points_;
  PlacedScales scales_;  ///< of local radii, over the mean spacing
  std::unique_ptr<ShellWalk<Grid>> walk_;
  Shells shells_;  ///< at scale 1
  bool felt_offset_ = false;
  int walk_steps_ = kMaxShellSteps;
  SpacingRange range_;  ///< of the scales; this and what follows: for preparation
  Gaps gaps_;
};

}  // namespace palpate::baselines
