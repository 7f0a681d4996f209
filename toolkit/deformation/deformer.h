// Geometric deformation (section 3.3.2.2): the points themselves move, and with them whatever follows them,
// within the frame's budget. Dents pressed by the probe, batches computed elsewhere, undo, new points where
// the surface is stretched.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <palpate/aabb.h>
#include <palpate/cloud.h>
#include <palpate/motion.h>
#include <palpate/result.h>
#include "toolkit/deformation/movable_points.h"
#include "toolkit/deformation/undo_journal.h"

namespace palpate::render {

/// Points one call may move; of a larger dent the nearest to its middle move.
inline constexpr std::size_t kMaxMovedPoints = 128;

/// A dent bears where it is so many times as deep as its radius: its walls, 1.54 times as steep at their
/// steepest by the profile (1 - r^2)^2, then stand at 57 degrees. Steeper ones fold.
inline constexpr double kMaxDepthPerRadius = 1.0;
/// And it is at least so many local resolutions wide: of fewer points it would be a spike, not a surface.
inline constexpr double kMinRadiusResolutions = 1.0;

/// What a deformer of so many points is given.
struct DeformerCapacity {
  std::size_t spare_points = 0;    ///< for inferred ones
  std::size_t journal_points = 0;  ///< changes that can be undone; older strokes are forgotten
};
[[nodiscard]] DeformerCapacity deformer_capacity(std::size_t points) noexcept;

/// Changes one prepared model. Belongs to the thread that runs the frames, and is called between them: what a
/// frame has collided with stays where it is until its force is answered. All calls but the constructor,
/// edited() and reset() are noexcept, allocate nothing and are bounded by the numbers above.
class Deformer {
 public:
  /// `points` outlive this.
  Deformer(MovablePoints& points, std::size_t journal_points);

  /// What is changed from now on is undone together.
  void begin_stroke() noexcept { journal_.begin_stroke(); }
  /// Presses the surface around `middle` by `by_mm` against `outward`, less and less out to `radius_mm` along
  /// the links from `place`, which is near it. No deeper in all than `max_depth_per_radius` times the radius.
  /// Returns the number of points moved.
  std::size_t press(std::uint32_t place, const Vec3& middle, const Vec3& outward, double by_mm,
                    double radius_mm,
                    double max_depth_per_radius = std::numeric_limits<double>::infinity()) noexcept;
  /// Around the place itself.
  std::size_t press(std::uint32_t place, const Vec3& outward, double by_mm, double radius_mm,
                    double max_depth_per_radius = std::numeric_limits<double>::infinity()) noexcept {
    if (place >= points_->used()) return 0;
    return press(place, points_->at(place), outward, by_mm, radius_mm, max_depth_per_radius);
  }
  /// The mean normal of the surface that press() would move, by areas; outward or inward as the points' are.
  /// Unit, or zero where there is none.
  [[nodiscard]] Vec3 normal_around(std::uint32_t place, const Vec3& middle, double radius_mm) noexcept;
  /// How far the surface at a place has been moved since it was built, in all.
  [[nodiscard]] double displacement_mm(std::uint32_t place) const noexcept;
  /// The local resolution there when it was built.
  [[nodiscard]] double initial_resolution_mm(std::uint32_t place) const noexcept {
    return points_->initial_resolution_mm(place);
  }
  /// Moves the batch's points; then what follows them does. Points that do not exist are left out.
  /// on_moved(place, from, to), mm, for each as soon as it has moved.
  template <class OnMoved>
  std::size_t apply(const MoveBatch& batch, OnMoved on_moved) noexcept {
    CallbackWatcher<OnMoved> watcher(on_moved);
    return apply_watched(batch, watcher);
  }
  std::size_t apply(const MoveBatch& batch) noexcept { return apply(batch, kNoWatcher); }
  /// Takes back the last stroke that is remembered. False where there is none. Work: the stroke's points.
  /// on_moved() as above.
  template <class OnMoved>
  bool undo(OnMoved on_moved) noexcept {
    CallbackWatcher<OnMoved> watcher(on_moved);
    return undo_watched(watcher);
  }
  bool undo() noexcept { return undo(kNoWatcher); }
  /// Everything as it was built; on_moved() as above. O(n).
  template <class OnMoved>
  void reset(OnMoved on_moved) noexcept {
    CallbackWatcher<OnMoved> watcher(on_moved);
    reset_watched(watcher);
  }
  void reset() noexcept { reset(kNoWatcher); }
  /// Of a place whose inferred point may be gone: the place itself, or one of the surface that it was
  /// inferred in.
  [[nodiscard]] std::uint32_t standing(std::uint32_t place) const noexcept {
    return points_->standing(place, points_->used());
  }

  /// Where a point of the cloud, by its number there, is now; nothing where there is no such point.
  [[nodiscard]] std::optional<Vec3> point_mm(std::uint32_t point) const noexcept {
    if (point >= points_->built()) return std::nullopt;
    return points_->at(points_->place_of(point));
  }
  /// The points that the last call of press() or apply() moved, and where each was before.
  [[nodiscard]] std::span<const MovedPoint> last_moved() const noexcept {
    return {moved_.data(), moved_count_};
  }
  /// Around those and what was inferred between them.
  [[nodiscard]] const geometry::Aabb& last_moved_box_mm() const noexcept { return box_mm_; }
  [[nodiscard]] DeformCounters counters() const noexcept {
    DeformCounters all = counters_;
    all.forgotten = journal_.forgotten();
    return all;
  }
  [[nodiscard]] std::size_t points() const noexcept { return points_->used(); }
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// What bytes() will be for a model of so many points; what the points' own bytes() says comes on top.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points, const DeformerCapacity& room) noexcept;

  /// The cloud as it is now, inferred points behind the others. Model frame.
  [[nodiscard]] Result<cloud::Cloud> edited() const;

 private:
  static constexpr auto kNoWatcher = [](std::uint32_t, const Vec3&, const Vec3&) noexcept {};

  std::size_t apply_watched(const MoveBatch& batch, MoveWatcher& watcher) noexcept;
  bool undo_watched(MoveWatcher& watcher) noexcept;
  void reset_watched(MoveWatcher& watcher) noexcept;
  void move(std::uint32_t place, const Vec3& to_mm, MoveWatcher& watcher) noexcept;
  void update_dependents(MoveWatcher& watcher) noexcept;
  [[nodiscard]] std::size_t collect(std::uint32_t place, const Vec3& middle, double radius_mm) noexcept;

  MovablePoints* points_;
  UndoJournal journal_;
  std::vector<std::uint64_t> seen_;  ///< by place: the search that saw it last
  std::uint64_t searches_ = 0;
  std::array<std::uint32_t, kMaxMovedPoints> found_{};
  std::array<MovedPoint, kMaxBatch> moved_{};
  std::size_t moved_count_ = 0;
  geometry::Aabb box_mm_;
  DeformCounters counters_;
};

}  // namespace palpate::render
