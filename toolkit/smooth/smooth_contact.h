// The contact of one HIP with the smooth surface: a god object that descends to the nearest place of the
// surface, a segment test that finds entries, and the rule that both agree with what the field says of the
// HIP itself. Voxels throughout.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/core/lanes.h"
#include "toolkit/render/renderer.h"
#include "toolkit/smooth/newton_step.h"
#include "toolkit/smooth/spline.h"

namespace palpate::render {

/// Bounds of one frame's work: steps in contact and values along the HIP's segment (one spline each, 16
/// rows), looks for bricks along the segment, entries.
inline constexpr int kMaxNewtonSteps = 24;
inline constexpr int kMaxSegmentValues = 256;
inline constexpr int kMaxSmoothLooks = 320;
inline constexpr int kMaxSmoothEntries = 3;

/// Belongs to one thread. The grid must outlive it.
class SmoothContact {
 public:
  /// Before the first use. Allocates. `spacing_mm`: of the points.
  void attach(const BrickGrid& grid, double spacing_mm) {
    grid_ = &grid;
    spacing_ = spacing_mm * grid.per_voxel;
    free_side_.assign(grid.closed_pieces.size() + 1, 0.0f);
  }
  /// A replay begins at h, on the free side of every closed piece: which that is, is found out here.
  /// Allocates nothing; O(bricks).
  void restart(const Vec3& h_mm) noexcept;
  /// Free at h (local mm), which is clear of the surface.
  void start_from(const Vec3& h_mm) noexcept;
  /// The HIP has gone to h. True in contact. Allocates nothing.
  [[nodiscard]] bool update(const Vec3& h_mm, FrameCounters& counters) noexcept;

  /// Of a closed piece (from 1) the sign of the distance on its free side; 0: either.
  [[nodiscard]] float free_side(std::size_t piece) const noexcept {
    return piece < free_side_.size() ? free_side_[piece] : 0.0f;
  }
  [[nodiscard]] bool contact() const noexcept { return contact_; }
  /// In this frame the place held was found not to agree with what the field says of the HIP, or a HIP behind
  /// the surface was taken up, or the god object went over an edge at once: the pull without that, local mm,
  /// else null.
  [[nodiscard]] const Vec3* corrected_from() const noexcept {
    return corrected_ ? &uncorrected_mm_ : nullptr;
  }
  /// Steps of the god object in a frame, at most; what is left is done in the next.
  void bound_steps(int most) noexcept { most_steps_ = most; }
  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  /// In contact, local mm.
  [[nodiscard]] Vec3 god_object_mm() const noexcept { return grid_->low_mm + god_ * grid_->voxel_mm; }
  /// In contact: the unit normal there, of growing distance.
  [[nodiscard]] const Vec3& normal() const noexcept { return normal_; }
  [[nodiscard]] std::uint32_t brick() const noexcept { return place_.brick; }
  [[nodiscard]] int level() const noexcept { return place_.level; }
  /// Of the god object in its brick.
  [[nodiscard]] BrickPlace place() const noexcept { return place_in(place_, god_); }

 private:
  enum class Stay : std::uint8_t { kHeld, kOut, kPastBorder, kBound };
  using Place = BrickGrid::Place;

  [[nodiscard]] BrickPlace place_in(const Place& place, const Vec3& at) const noexcept;
  [[nodiscard]] Jet jet_at(const Place& place, const BrickPlace& in) const noexcept;
  /// The brick and jet at a place of the surface held; false where it has none.
  [[nodiscard]] bool look(const Vec3& at, Place& place, Jet& jet) const noexcept;
  [[nodiscard]] bool may_touch(const Place& place, const Vec3& at) const noexcept;
  /// Of the piece of a brick.
  [[nodiscard]] bool is_tight(const Place& place) const noexcept {
    const std::size_t piece = grid_->bricks[place.brick].piece;
    return piece != 0 && grid_->closed_pieces[piece - 1].tight;
  }
  [[nodiscard]] bool follow(const Vec3& h) noexcept;
  [[nodiscard]] bool follow_wide(const Vec3& h) noexcept;
  [[nodiscard]] bool follow_quickly(const Vec3& h) noexcept;
  [[nodiscard]] Stay descend(const Vec3& h, int& steps, FrameCounters& counters) noexcept;
  [[nodiscard]] bool find_clear(const Vec3& h, Vec3& clear) const noexcept;
  [[nodiscard]] bool update_slowly(const Vec3& h, FrameCounters& counters) noexcept;
  [[nodiscard]] bool find_entry(const Vec3& h, FrameCounters& counters) noexcept;
  [[nodiscard]] bool crossing(const Vec3& from, const Vec3& way, double low, double high, double f_low,
                              double f_high, double& at) noexcept;
  /// Contact begins, or goes on, with the god object at a place of the surface.
  void hold_at(const Vec3& at, const Place& place, const Jet& jet, float side) noexcept;
  void look_where_free(const Vec3& h) noexcept;
  void touch_below(const Vec3& h, const Place& place, const Jet& jet, float side) noexcept;
  [[nodiscard]] bool touch_where_behind(const Vec3& h) noexcept;
  void agree_with(const Vec3& h) noexcept;
  void note_correction(const Vec3& h) noexcept {
    corrected_ = true;
    uncorrected_mm_ = (god_ - h) * grid_->voxel_mm;
  }

  const BrickGrid* grid_ = nullptr;
  bool wide_ = wide_lanes();
  bool contact_ = false;
  int most_steps_ = kMaxNewtonSteps;
  bool bound_hit_ = false, corrected_ = false;
  Vec3 uncorrected_mm_ = Vec3::Zero();
  double spacing_ = 1.0;  ///< of the points, voxels
  Vec3 last_h_ = Vec3::Zero();
  int unlooked_ = 0;  ///< frames since the HIP's own surroundings were looked at
  // In contact.
  Vec3 god_ = Vec3::Zero();
  Vec3 moved_ = Vec3::Zero();   ///< by how much in the last frame
  Vec3 normal_ = Vec3::Zero();  ///< at the god object, of growing distance
  Place place_;
  float side_ = 1.0f;  ///< of the distance where the HIP came from
  /// Of each closed piece the sign of the distance where the HIP may be; of open ones, at 0, 0.
  std::vector<float> free_side_;
  // Free.
  /// It was in front of the surface last, and near it since: what it is behind of it went through.
  bool in_front_ = false;
  Vec3 tested_to_ = Vec3::Zero();
  Vec3 looked_at_ = Vec3::Zero();  ///< within `clear_` of there nothing is
  double clear_ = -1.0;
};

}  // namespace palpate::render
