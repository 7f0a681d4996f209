// The contact of one HIP with the smooth surface: a god object that descends to the nearest place, a segment
// test for entries, and a check of both against the field at the HIP. Units: voxels.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/renderer.h>
#include "toolkit/core/simd.h"
#include "toolkit/spline_sdf/spline.h"

namespace palpate::spline_sdf {

/// Bounds per frame: contact steps, values along the HIP's segment (one spline of 16 rows each), brick
/// look-ups along the segment, entries.
inline constexpr int kMaxNewtonSteps = 24;
inline constexpr int kMaxSegmentSamples = 256;
inline constexpr int kMaxBrickLookups = 320;
inline constexpr int kMaxEntriesPerFrame = 3;

/// What the frames of a SplineSdfContact change: a frame that found too little is undone.
class SplineSdfContactState {
  friend class SplineSdfContact;

  bool contact_ = false;
  bool bound_hit_ = false;
  int frames_unchecked_ = 0;      ///< frames since the last check of the HIP's surroundings
  bool follows_ = false;          ///< checked since the HIP was next to its god object
  Vec3 followed_ = Vec3::Zero();  ///< see geometry::check_god_object
  // In contact.
  Vec3 god_ = Vec3::Zero();
  Vec3 moved_ = Vec3::Zero();   ///< its motion in the last frame
  Vec3 normal_ = Vec3::Zero();  ///< at the god object, of growing distance
  BrickGrid::BrickRef place_;
  float side_ = 1.0f;  ///< sign of the distance on the HIP's side
  // Free: the HIP was last in front of the surface and near it since, so a surface it is behind was crossed.
  bool in_front_ = false;
  Vec3 tested_to_ = Vec3::Zero();
  Vec3 free_centre_ = Vec3::Zero();  ///< nothing is within `clear_` of this place
  double clear_ = -1.0;
};

/// Belongs to one thread. The grid must outlive it.
class SplineSdfContact : private SplineSdfContactState {
 public:
  /// Call before use. Allocates. `spacing_mm`: of the points.
  void attach(const BrickGrid& grid, double spacing_mm) {
    grid_ = &grid;
    spacing_ = spacing_mm * grid.per_voxel;
    free_side_.assign(grid.closed_components.size() + 1, 0.0f);
  }
  /// Begins a replay at h, which defines the free side of every closed piece. Allocates nothing; O(pieces log
  /// bricks).
  void restart(const Vec3& h_mm) noexcept;
  /// Free at h (local mm), clear of the surface.
  void start_from(const Vec3& h_mm) noexcept;
  /// Begins contact at the surface nearest to another one's god object (local mm), whose normal on the HIP's
  /// side is `outward`. False, and free, if none is near. Call after start_from().
  bool hold_near(const Vec3& god_object_mm, const Vec3& outward) noexcept;
  /// Begins contact if h (local mm) is behind a tight piece's surface by at most `most_mm`. Call after
  /// start_from().
  bool hold_if_inside(const Vec3& h_mm, double most_mm) noexcept;
  /// Moves the HIP to h. True in contact. Allocates nothing.
  [[nodiscard]] bool update(const Vec3& h_mm, render::FrameCounters& counters) noexcept;
  [[nodiscard]] const SplineSdfContactState& state() const noexcept { return *this; }
  /// As it was before an update().
  void restore(const SplineSdfContactState& before) noexcept {
    static_cast<SplineSdfContactState&>(*this) = before;
  }

  [[nodiscard]] bool contact() const noexcept { return contact_; }
  /// Most god-object steps in a frame; the rest waits for the next.
  void bound_steps(int most) noexcept { most_steps_ = most; }
  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  /// In contact, local mm.
  [[nodiscard]] Vec3 god_object_mm() const noexcept { return grid_->low_mm + god_ * grid_->voxel_mm; }
  /// In contact: unit normal there, of growing distance.
  [[nodiscard]] const Vec3& normal() const noexcept { return normal_; }
  /// In contact: the normal on the HIP's side.
  [[nodiscard]] Vec3 outward() const noexcept { return normal_ * static_cast<double>(side_); }
  [[nodiscard]] const BrickGrid::BrickRef& brick_ref() const noexcept { return place_; }
  [[nodiscard]] std::uint32_t brick() const noexcept { return place_.brick; }
  [[nodiscard]] int level() const noexcept { return place_.level; }
  /// The god object's place in its brick.
  [[nodiscard]] BrickPosition place() const noexcept { return place_in(place_, god_); }

 private:
  enum class Stay : std::uint8_t { kHeld, kOut, kPastBorder, kBound };
  using BrickRef = BrickGrid::BrickRef;

  [[nodiscard]] BrickPosition place_in(const BrickRef& place, const Vec3& at) const noexcept;
  [[nodiscard]] Jet jet_at(const BrickRef& place, const BrickPosition& in) const noexcept;
  [[nodiscard]] float value_at(const BrickRef& place, const BrickPosition& in) const noexcept;
  /// Brick and jet at a place of the held surface; false if it has none.
  [[nodiscard]] bool query(const Vec3& at, BrickRef& place, Jet& jet) const noexcept;
  [[nodiscard]] bool may_touch(const BrickRef& place, const Vec3& at) const noexcept;
  /// Whether the brick's piece is tight.
  [[nodiscard]] bool is_tight(const BrickRef& place) const noexcept {
    const std::size_t piece = grid_->bricks[place.brick].piece;
    return piece != 0 && grid_->closed_components[piece - 1].tight;
  }
  [[nodiscard]] bool follow(const Vec3& h) noexcept;
  [[nodiscard]] bool follow_avx2(const Vec3& h) noexcept;
  [[nodiscard]] bool follow_quickly(const Vec3& h) noexcept;
  [[nodiscard]] Stay descend(const Vec3& h, int& steps, render::FrameCounters& counters) noexcept;
  [[nodiscard]] bool find_clear(const Vec3& h, Vec3& clear) const noexcept;
  [[nodiscard]] bool update_slowly(const Vec3& h, render::FrameCounters& counters) noexcept;
  [[nodiscard]] bool find_entry(const Vec3& h, render::FrameCounters& counters) noexcept;
  [[nodiscard]] bool crossing(const Vec3& from, const Vec3& way, double low, double high, double f_low,
                              double f_high, double& at) noexcept;
  /// Begins or continues contact with the god object at a surface place.
  void hold_at(const Vec3& at, const BrickRef& place, const Jet& jet, float side) noexcept;
  void update_free_radius(const Vec3& h) noexcept;
  void hold_on_surface_above(const Vec3& h, const BrickRef& place, const Jet& jet, float side) noexcept;
  [[nodiscard]] bool hold_if_behind(const Vec3& h) noexcept;
  void check_held_position(const Vec3& h) noexcept;

  const BrickGrid* grid_ = nullptr;
  bool wide_ = has_avx2();
  int most_steps_ = kMaxNewtonSteps;
  double spacing_ = 1.0;  ///< of the points, voxels
  /// Per closed piece: the sign of the distance where the HIP may be. Entry 0, open pieces, is 0.
  std::vector<float> free_side_;
};

}  // namespace palpate::spline_sdf
