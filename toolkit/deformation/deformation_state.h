// What drives the deformer of a model that gives way: the probe that presses deeper than the surface bears,
// and batches from outside. The same for every surface.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include <palpate/aabb.h>
#include <palpate/renderer.h>
#include "toolkit/deformation/deformer.h"

namespace palpate::render {

[[nodiscard]] inline bool is_deformable(const ModelInput& input) noexcept {
  return input.surface.dent.any() || input.moves != nullptr;
}

/// Belongs to one thread.
class DeformationState {
 public:
  /// Before the frames. `prepared_box_mm`: local, what the broad phase knows.
  void begin(const ModelInput& input, std::unique_ptr<MovablePoints> points, std::size_t journal_points,
             const geometry::Aabb& prepared_box_mm) {
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
    const MoveBatch* batch = moves_->take();
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

  std::unique_ptr<MovablePoints> points_;
  std::unique_ptr<Deformer> deformer_;
  surface::Dent dent_;
  std::shared_ptr<MoveReader> moves_;  ///< or null
  bool pressed_ = false;               ///< in contact in the last frame: the stroke goes on
  geometry::Aabb prepared_box_mm_;
};

}  // namespace palpate::render
