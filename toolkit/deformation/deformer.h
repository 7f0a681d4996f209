// Geometric deformation (section 3.3.2.2): the points themselves move, and with them whatever follows them,
// within the frame's budget. Dents pressed by the probe, batches computed elsewhere, undo, new points where
// the surface is stretched.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/motion.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "toolkit/deformation/deformed_local_delaunay.h"

namespace palpate::deformation {

/// Points one call may move; of a larger dent the nearest to its middle move.
inline constexpr std::size_t kMaxMovedPoints = 128;

/// A dent bears where it is so many times as deep as its radius: its walls, 1.54 times as steep at their
/// steepest by the profile (1 - r^2)^2, then stand at 57 degrees. Steeper ones fold.
inline constexpr double kMaxDepthPerRadius = 1.0;
/// A dent that bears is at least so many local resolutions wide: of fewer points it would be a spike, not a
/// surface.
inline constexpr double kMinRadiusResolutions = 1.0;

/// Sizes of a deformer's arrays for so many points.
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
  Deformer(DeformedLocalDelaunay& points, std::size_t journal_points);

  /// Changes from now on are undone together.
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
  /// The way that the surface at a place has moved since it was built, in all, mm.
  [[nodiscard]] double displacement_mm(std::uint32_t place) const noexcept;
  /// The local resolution there when it was built.
  [[nodiscard]] double initial_resolution_mm(std::uint32_t place) const noexcept {
    return points_->initial_resolution_mm(place);
  }
  /// Moves the batch's points; then what follows them does. Points that do not exist are left out.
  /// on_moved(place, from, to), mm, for each as soon as it has moved.
  template <class OnMoved>
  std::size_t apply(const render::MoveBatch& batch, OnMoved on_moved) noexcept {
    CallbackWatcher<OnMoved> watcher(on_moved);
    return apply_watched(batch, watcher);
  }
  std::size_t apply(const render::MoveBatch& batch) noexcept { return apply(batch, kNoWatcher); }
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
  /// Bytes that bytes() will give for a model of so many points, without those of the points themselves.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points, const DeformerCapacity& room) noexcept;

  /// The cloud as it is now, inferred points behind the others. Model frame.
  [[nodiscard]] Result<cloud::Cloud> edited() const;

 private:
  static constexpr auto kNoWatcher = [](std::uint32_t, const Vec3&, const Vec3&) noexcept {};

  std::size_t apply_watched(const render::MoveBatch& batch, MoveWatcher& watcher) noexcept;
  bool undo_watched(MoveWatcher& watcher) noexcept;
  void reset_watched(MoveWatcher& watcher) noexcept;
  void move(std::uint32_t place, const Vec3& to_mm, MoveWatcher& watcher) noexcept;
  void update_dependents(MoveWatcher& watcher) noexcept;
  [[nodiscard]] std::size_t collect(std::uint32_t place, const Vec3& middle, double radius_mm) noexcept;

  DeformedLocalDelaunay* points_;
  UndoJournal journal_;
  std::vector<std::uint64_t> seen_;  ///< by place: the search that saw it last
  std::uint64_t searches_ = 0;
  std::array<std::uint32_t, kMaxMovedPoints> found_{};
  std::array<MovedPoint, render::kMaxBatch> moved_{};
  std::size_t moved_count_ = 0;
  geometry::Aabb box_mm_;
  DeformCounters counters_;
};

[[nodiscard]] inline bool is_deformable(const render::ModelInput& input) noexcept {
  return input.surface.dent.any() || input.moves != nullptr;
}

/// Belongs to one thread.
class DeformationState {
 public:
  /// Before the frames. `prepared_box_mm`: local, what the broad phase knows.
  void begin(const render::ModelInput& input, std::unique_ptr<DeformedLocalDelaunay> points,
             std::size_t journal_points, const geometry::Aabb& prepared_box_mm) {
    points_ = std::move(points);
    deformer_ = std::make_unique<Deformer>(*points_, journal_points);
    dent_ = input.surface.dent;
    if (input.moves != nullptr) moves_ = input.moves->subscribe();
    prepared_box_mm_ = prepared_box_mm;
  }
  /// Null where the geometry stays.
  [[nodiscard]] Deformer* deformer() const noexcept { return deformer_.get(); }
  [[nodiscard]] bool moves_by_itself() const noexcept { return moves_ != nullptr; }
  void restart() noexcept {
    if (deformer_ != nullptr) deformer_->reset();
  }
  /// The probe touches no more: the next dent is another stroke.
  void release() noexcept { pressed_ = false; }

  /// Before a frame collides: what a slower deformer has computed is applied. on_moved() as of
  /// Deformer::apply(). True where there was something.
  template <class OnMoved>
  bool take_moves(OnMoved&& on_moved) noexcept {
    if (moves_ == nullptr) return false;
    const render::MoveBatch* batch = moves_->take();
    if (batch == nullptr) return false;
    deformer_->apply(*batch, std::forward<OnMoved>(on_moved));
    return true;
  }
  /// After a frame's force is answered at a depth: whether the surface has to give way.
  [[nodiscard]] bool must_yield(double depth_mm) noexcept {
    if (deformer_ == nullptr || !dent_.any()) return false;
    if (!pressed_) deformer_->begin_stroke();
    pressed_ = true;
    return depth_mm - dent_.yield_mm > 0.0;
  }
  /// The surface's normal as far around a place as it would give way there: a dent's own walls, however
  /// steep, add up to nothing in it, so that what is pressed again and again, or dragged along, does not
  /// fold.
  [[nodiscard]] Vec3 normal_around(std::uint32_t place, const Vec3& middle) noexcept {
    return deformer_->normal_around(place, middle, radius_mm(place));
  }
  /// It does. False where it left the box that it was prepared in.
  bool press(std::uint32_t place, const Vec3& middle, const Vec3& outward, double depth_mm,
             double dt_s) noexcept {
    const double by_mm = std::min(depth_mm - dent_.yield_mm, dent_.rate_mm_s * dt_s);
    if (deformer_->press(place, middle, outward, by_mm, radius_mm(place), kMaxDepthPerRadius) == 0)
      return true;
    const geometry::Aabb& box = deformer_->last_moved_box_mm();
    return prepared_box_mm_.contains(box.low_mm) && prepared_box_mm_.contains(box.high_mm);
  }

 private:
  [[nodiscard]] double radius_mm(std::uint32_t place) const noexcept {
    return std::max(dent_.radius_mm, kMinRadiusResolutions * deformer_->initial_resolution_mm(place));
  }

  std::unique_ptr<DeformedLocalDelaunay> points_;
  std::unique_ptr<Deformer> deformer_;
  surface::Dent dent_;
  std::shared_ptr<render::MoveReader> moves_;  ///< or null
  bool pressed_ = false;                       ///< in contact in the last frame: the stroke goes on
  geometry::Aabb prepared_box_mm_;
};

/// Called between frames, by the thread that runs them. `model` is an index into the scene's models.
class Editable {
 public:
  virtual ~Editable() = default;
  /// Takes back what one touch changed, the last one first. False where there is nothing to take back.
  virtual bool undo(std::size_t model) noexcept = 0;
  /// The model as it was prepared. O(n).
  virtual void restore(std::size_t model) noexcept = 0;
  /// The model's points as they are now. An Error where the model does not give way.
  [[nodiscard]] virtual Result<cloud::Cloud> edited(std::size_t model) const = 0;
  /// Where a point of the cloud is now, relative to the cloud's origin; nothing where the model does not give
  /// way. O(1).
  [[nodiscard]] virtual std::optional<Vec3> point_position_mm(std::size_t model,
                                                              std::uint32_t point) const noexcept = 0;
  [[nodiscard]] virtual DeformCounters deform_counters(std::size_t model) const noexcept = 0;
};

}  // namespace palpate::deformation
