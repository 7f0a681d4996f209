// The contact state of one HIP with one prepared cloud: free, with the sheets of surface that are near, or in
// contact with one sheet whose outer side is known. Chapter 3's collision detection made right: the side is
// decided where the probe came from and kept along the surface, so that the state cannot stick (figure 42
// does).
#pragma once

#include <array>
#include <cstdint>

#include "toolkit/points/box_scan.h"
#include "toolkit/points/free_sides.h"
#include "toolkit/points/sheet.h"

namespace palpate::render {

/// Sheets watched while free: two faces that meet and one more that comes near.
inline constexpr std::size_t kMaxSheets = 3;

/// Moves a frame may make along an edge that the god object has not passed. At 50 mm/s over points 0.1 mm
/// apart it makes one in two frames; what is left is made in the next.
inline constexpr int kMaxFaceMoves = 4;

/// The points that moved across a HIP, the nearest to it first.
struct MovedOn {
  struct Point {
    std::uint32_t place;
    Vec3 from_mm;  ///< where the HIP came from, as seen from the point
    double distance_sq_mm2;
  };
  std::array<Point, kMaxCrossed> point;
  std::size_t count = 0;

  void keep(const Point& moved) noexcept {
    if (count == point.size() && !(moved.distance_sq_mm2 < point[--count].distance_sq_mm2)) {
      ++count;
      return;
    }
    std::size_t at = count++;
    for (; at > 0 && moved.distance_sq_mm2 < point[at - 1].distance_sq_mm2; --at) point[at] = point[at - 1];
    point[at] = moved;
  }
};

/// Everything in the model's local coordinates, mm. Belongs to one thread; the model is only read and must
/// outlive this. Work per update: kMaxWalkSteps moves and kMaxFaceMoves along an edge, kMaxRescues wider
/// looks of 64 points, kMaxBoxTests box tests, segments of kMaxSegmentCells cells; what is left is done in
/// the next.
class PointContact {
 public:
  /// Before the first use, and after the model's boxes grew. Allocates.
  void attach(const PointModel& model);
  /// Free at `h`; of each closed surface the free side is where `h` is. O(n) for closed surfaces.
  void reset(const Vec3& h) noexcept;
  /// Free at `h`, known to be clear of the model: the next update tests the way from there.
  void start_from(const Vec3& h) noexcept;
  /// The surface gave way under the god object: its plane is read again, and a search for crossed boxes that
  /// had not ended begins again.
  void gave_way() noexcept {
    scan_.running = false;
    if (contact_) near_[0].set_outward(*model_);
  }
  /// A point of the model goes from one place to another between two updates. A HIP that rests may be met by
  /// it: the HIP's way is tested as seen from the point. The case that section 3.3.2.1 gives up. After the
  /// last one: points_moved().
  void point_moved(std::uint32_t place, const Vec3& from, const Vec3& to, FrameCounters& counters) noexcept;
  /// All points are where they are now: nothing that was known of the surface's shape is kept.
  /// standing(place): the place, or one near it where its point is gone. The work of an update.
  template <class Standing>
  void points_moved(Standing&& standing, FrameCounters& counters) noexcept {
    for (std::size_t i = 0; i < sheets_; ++i) {
      near_[i].place = standing(near_[i].place);
      near_[i].set_outward(*model_);
    }
    meet(counters);
  }
  /// The HIP is now at `h`. True in contact: `end` is then what lies around the god object.
  [[nodiscard]] bool update(const Vec3& h, WalkEnd& end, FrameCounters& counters) noexcept {
    steps_ = kMaxWalkSteps;
    behind_ = false;
    const bool touching = contact_ ? stay(h, end, counters) : look(h, end, counters);
    previous_ = h;
    return touching;
  }
  /// The last update left work for the next.
  [[nodiscard]] bool bound_hit() const noexcept { return behind_ || steps_ == 0 || scan_.running; }
  [[nodiscard]] bool contact() const noexcept { return contact_; }
  /// In contact: the side of the god object's plane that is outside, unit.
  [[nodiscard]] const Vec3& outward() const noexcept { return near_[0].outward; }
  [[nodiscard]] const Sheet& sheet() const noexcept { return near_[0]; }

 private:
  /// In contact: the god object follows; the HIP is out when it is above the plane there.
  bool stay(const Vec3& h, WalkEnd& end, FrameCounters& counters) noexcept {
    Sheet& sheet = near_[0];
    const double before = height_mm_;  // of the last frame's HIP over the last frame's plane
    end = follow(*model_, sheet, h, steps_, counters);
    if (sheet.turned_from != kNoPlace) [[unlikely]]
      keep_to_face(h, end, counters);
    const double height = height_mm_ = height_mm(*model_, sheet, h);
    if (sheet.walk_cut || (height < 0.0 && !beyond_rim(sheet, h))) return true;
    contact_ = false;
    sheets_ = 1;
    // The way out crossed the plane somewhere; from there on the HIP was free, and may have met something
    // else.
    const double out = before < 0.0 && height > 0.0 ? before / (before - height) : 1.0;
    tested_to_ = previous_ + out * (h - previous_);
    return look(h, end, counters);
  }

  void meet(FrameCounters& counters) noexcept;
  bool look(const Vec3& h, WalkEnd& end, FrameCounters& counters) noexcept;
  void keep_to_face(const Vec3& h, WalkEnd& end, FrameCounters& counters) noexcept;
  void follow_sheets(FrameCounters& counters) noexcept;
  [[nodiscard]] std::size_t touched_sheet() const noexcept;
  [[nodiscard]] bool under(const Sheet& sheet, const Vec3& h) const noexcept;
  [[nodiscard]] double reach_sq(std::uint32_t place) const noexcept;
  [[nodiscard]] bool beyond_rim(const Sheet& sheet, const Vec3& h) const noexcept {
    if (surface::is_one_sided(model_->points[sheet.place].normal)) return false;  // a closed surface has none
    if (sideways_sq(*model_, sheet, h) <= reach_sq(sheet.place)) return false;
    return no_point_aside(sheet, h);
  }
  [[nodiscard]] bool no_point_aside(const Sheet& sheet, const Vec3& h) const noexcept;
  [[nodiscard]] bool is_duplicate(std::size_t i) const noexcept;
  [[nodiscard]] bool is_watched(std::uint32_t place) const noexcept;
  void watch(std::uint32_t place, const Vec3& from, FrameCounters& counters) noexcept;

  const PointModel* model_ = nullptr;
  double leave_sq_mm2_ = 0.0;
  double same_sheet_sq_mm2_ = 0.0;

  Vec3 tested_to_ = Vec3::Zero();  ///< the path has been tested up to here
  Vec3 previous_ = Vec3::Zero();   ///< the HIP of the last update
  BoxScan scan_;
  MovedOn met_;                         ///< points that moved across the HIP since the last update
  std::array<Sheet, kMaxSheets> near_;  ///< in contact: the first alone
  std::size_t sheets_ = 0;
  double height_mm_ = 0.0;  ///< in contact: the last update's HIP over its sheet's plane
  FreeSides sides_;         ///< of closed surfaces, where the HIP was when it was put there
  bool contact_ = false;
  bool behind_ = false;  ///< the path could not be tested up to the HIP
  int steps_ = 0;
};

/// How far to the side a point still carries: its local resolution, and its box where it has no neighbours.
inline double PointContact::reach_sq(std::uint32_t place) const noexcept {
  return std::max(local_resolution_sq(*model_, place), model_->half_box(place).squaredNorm());
}

}  // namespace palpate::render
