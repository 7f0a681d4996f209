// The contact of one HIP with the smooth surface: a god object that descends to the nearest place of the
// sheet that it entered, and a segment test that finds entries. Voxels throughout.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toolkit/core/lanes.h"
#include "toolkit/render/renderer.h"
#include "toolkit/smooth/newton_step.h"
#include "toolkit/smooth/smooth_without.h"
#include "toolkit/smooth/spline.h"

namespace palpate::render {

/// Bounds of one frame's work: evaluations of a sheet in contact and along the HIP's segment (of the spline,
/// 16 rows each, one for each layer of the sheet, kMostLayers at most), cubes that the segment goes through,
/// bricks at which a sheet looked at in one cube begins, entries.
inline constexpr int kMaxNewtonSteps = 24;
inline constexpr int kMaxSegmentValues = 256;
inline constexpr int kMaxSegmentCubes = 64;
inline constexpr std::uint32_t kMaxSmoothSheets = 8;
inline constexpr int kMaxSmoothEntries = 3;

/// Belongs to one thread. The grid must outlive it.
class SmoothContact {
 public:
  /// Before the first use. Allocates.
  void attach(const BrickGrid& grid) {
    grid_ = &grid;
    free_side_.assign(grid.closed_pieces.size() + 1, 0.0f);
  }
  /// A replay begins at h, on the free side of every closed piece: which that is, is found out here.
  /// Allocates nothing; O(closed pieces x extent), and O(bricks) of those with holes.
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
  /// For ablation: what of a frame is left out.
  void leave_out(const SmoothWithout& without) noexcept { without_ = without; }
  /// Steps of the god object in a frame, at most; what is left is done in the next.
  void bound_steps(int most) noexcept { most_steps_ = most; }
  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  /// In contact, local mm.
  [[nodiscard]] Vec3 god_object_mm() const noexcept { return grid_->low_mm + god_ * grid_->voxel_mm; }
  /// In contact: the unit normal there, of growing distance.
  [[nodiscard]] const Vec3& normal() const noexcept { return normal_; }
  [[nodiscard]] std::uint32_t brick() const noexcept { return brick_; }
  /// Of the god object in its brick.
  [[nodiscard]] BrickPlace place() const noexcept { return place_in(cube_, god_); }

 private:
  enum class Stay : std::uint8_t { kHeld, kOut, kPastBorder, kBound };
  using Cube = BrickGrid::Coordinate;

  [[nodiscard]] static BrickPlace place_in(const Cube& cube, const Vec3& at) noexcept;
  [[nodiscard]] static Cube cube_of(const Vec3& at) noexcept;
  /// Too far off to be counted in cubes, or not finite.
  [[nodiscard]] static bool is_far(const Vec3& at) noexcept;
  /// The brick and jet at a place of the surface held; false where it has none.
  [[nodiscard]] bool look(const Vec3& at, Cube& cube, std::uint32_t& brick, float& side,
                          Jet& jet) const noexcept;
  /// `normal`: of the sheet that is to go on.
  [[nodiscard]] bool change_brick(const Vec3& at, const Cube& to, const Vec3& normal, Cube& cube,
                                  std::uint32_t& brick, float& side, Jet& jet) const noexcept;
  [[nodiscard]] NewtonStep step_from(const Jet& jet, const Vec3& at, const Vec3& h, const Cube& cube,
                                     std::uint32_t brick, float side, double longest) const noexcept;
  [[nodiscard]] bool follow(const Vec3& h) noexcept;
  [[nodiscard]] bool follow_wide(const Vec3& h) noexcept;
  [[nodiscard]] bool follow_quickly(const Vec3& h) noexcept;
  [[nodiscard]] Stay descend(const Vec3& h, int& steps, FrameCounters& counters) noexcept;
  [[nodiscard]] bool find_clear(const Vec3& h, Vec3& clear) const noexcept;
  [[nodiscard]] bool update_slowly(const Vec3& h, FrameCounters& counters) noexcept;
  [[nodiscard]] bool find_entry(const Vec3& h, int& values, FrameCounters& counters) noexcept;
  [[nodiscard]] bool enter_in(const Cube& cube, std::uint32_t cell, const Vec3& from, const Vec3& way,
                              double begin, double end, int& values, double& at,
                              std::uint16_t piece) noexcept;
  void note_free(const Vec3& h) noexcept;
  [[nodiscard]] bool is_on(const Vec3& h, std::uint16_t piece) const noexcept;
  [[nodiscard]] float side_by_share(const Vec3& h, const ClosedPiece& closed, std::uint16_t piece) noexcept;
  [[nodiscard]] float side_seen(const Vec3& h, const Vec3& target, std::uint16_t piece) noexcept;
  template <class Visit>
  static bool along(const Vec3& from, const Vec3& way, int most, double& reached, Visit&& visit) noexcept;

  const BrickGrid* grid_ = nullptr;
  bool wide_ = wide_lanes();
  bool contact_ = false;
  int most_steps_ = kMaxNewtonSteps;
  SmoothWithout without_;
  bool bound_hit_ = false;
  // In contact.
  Vec3 god_ = Vec3::Zero();
  Vec3 moved_ = Vec3::Zero();   ///< by how much in the last frame
  Vec3 normal_ = Vec3::Zero();  ///< at the god object, of growing distance
  Cube cube_{};
  std::uint32_t brick_ = 0;
  float side_ = 1.0f;  ///< of the distance where the HIP came from
  /// Of each closed piece the sign of the distance where the HIP may be; 0: either.
  std::vector<float> free_side_;
  // Free.
  Vec3 tested_to_ = Vec3::Zero();
  Vec3 looked_at_ = Vec3::Zero();  ///< within `clear_` of there nothing is
  double clear_ = -1.0;
};

}  // namespace palpate::render
