// The contact state of one HIP with one prepared cloud: free, with the near sheets, or in contact with one
// sheet of known outer side. Chapter 3's collision detection made right: the side is decided where the probe
// came from and kept along the surface, so the state cannot stick (figure 42's can).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "baselines/points/sheet.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/points/point_model.h"
#include "toolkit/points/point_walk.h"
#include "toolkit/search/orthtree.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::baselines::vertices {

using namespace render;

/// Box tests per frame: 80 us of 1 ms at 5 ns each.
inline constexpr std::uint64_t kMaxBoxTests = 16384;
/// Cells per frame: a segment of this many cells with a reach below one cell visits at most about nine times
/// as many, one look-up each.
inline constexpr double kMaxSegmentCells = 64.0;
/// Crossed boxes kept, nearest to the segment's start first.
inline constexpr std::size_t kMaxCrossed = 4;

/// The crossed boxes nearest to a segment's start, over one or more frames.
struct BoxScan {
  Vec3 from_mm = Vec3::Zero();
  Vec3 to_mm = Vec3::Zero();
  std::uint64_t tested = 0;  ///< boxes tested so far, in the fixed order of cells and places
  bool running = false;      ///< the bound was reached before the end
  std::array<std::uint32_t, kMaxCrossed> crossed{};
  std::array<double, kMaxCrossed> distance_sq_mm2{};
  std::size_t count = 0;

  void start(const Vec3& from, const Vec3& to) noexcept {
    from_mm = from;
    to_mm = to;
    tested = 0;
    count = 0;
    running = true;
  }
  void keep(std::uint32_t place, double d) noexcept {
    std::size_t at = count < kMaxCrossed ? count++ : kMaxCrossed;
    if (at == kMaxCrossed) {
      if (!(d < distance_sq_mm2[kMaxCrossed - 1])) return;
      at = kMaxCrossed - 1;
    }
    while (at > 0 && d < distance_sq_mm2[at - 1]) {
      crossed[at] = crossed[at - 1];
      distance_sq_mm2[at] = distance_sq_mm2[at - 1];
      --at;
    }
    crossed[at] = place;
    distance_sq_mm2[at] = d;
  }

  /// Tests up to kMaxBoxTests more boxes. `skip(place)` excludes crossed boxes. True when the segment is
  /// complete. Dispatches once a frame, always alike for a model.
  template <class Skip>
  bool advance(const points::PointModel& model, FrameCounters& counters, Skip&& skip) noexcept {
    // The only call of the grid's scan, so that it is inlined: a tenth less work.
    if (model.tree.index() == 0) [[likely]]
      return scan_any(model, model.grid, counters, skip);
    return points::with_tree(
        model, [&](const auto& tree) noexcept { return scan_any(model, tree, counters, skip); });
  }

  /// advance() for one partition, whose order of places is the model's.
  template <bool kSwept, search::Partition P, class Skip>
  bool scan(const points::PointModel& model, const P& partition, FrameCounters& counters,
            Skip&& skip) noexcept {
    const geometry::SegmentProbe probe(from_mm, to_mm);
    Vec3 reach = model.largest_half_box_mm;
    if constexpr (kSwept) reach += Vec3::Constant(model.sphere_mm);
    std::uint64_t seen = 0;  // boxes before this frame's first
    std::uint64_t left = kMaxBoxTests;
    running = !visit_segment_ranges(partition, from_mm, to_mm, reach, [&](search::IndexRange range) {
      ++counters.cells_visited;
      const std::uint64_t here = range.end - range.begin;
      std::uint64_t place = range.begin;
      if (seen + here <= tested) {
        seen += here;
        return true;
      }
      if (seen < tested) place += tested - seen;
      seen += place - range.begin;
      for (; place < range.end; ++place, ++seen) {
        if (left == 0) return false;
        --left;
        ++tested;
        ++counters.box_tests;
        const auto p = static_cast<std::uint32_t>(place);
        if (!touches<kSwept>(model, probe, p, counters)) continue;
        if (!skip(p)) keep(p, points::distance_sq(model.points[p], from_mm));
      }
      return true;
    });
    return !running;
  }

 private:
  template <class P, class Skip>
  bool scan_any(const points::PointModel& model, const P& partition, FrameCounters& counters,
                Skip&& skip) noexcept {
    return model.sphere_mm > 0.0 ? scan<true>(model, partition, counters, skip)
                                 : scan<false>(model, partition, counters, skip);
  }
  template <bool kSwept>
  static bool touches(const points::PointModel& model, const geometry::SegmentProbe& probe,
                      std::uint32_t place, FrameCounters& counters) noexcept {
    const Vec3 centre = model.points[place].at(), half = model.half_box(place);
    if constexpr (!kSwept) return geometry::segment_touches_box(probe, centre, half);
    if (!geometry::swept_sphere_touches_box(probe, model.sphere_mm, centre, half)) return false;
    counters.sphere_only += !geometry::segment_touches_box(probe, centre, half);
    return true;
  }
};

/// Per closed piece: the side of the HIP when last known free, outside or inside a cavity. Between two shells
/// a HIP is inside one and outside the other. Belongs to one thread.
class FreeSides {
 public:
  /// Call before use. Allocates.
  void attach(const points::PointModel& model) { sides_.assign(model.closed_components, 1.0); }
  /// The HIP is free at `h`. O(n) if the model has closed pieces; allocates nothing.
  void find(const points::PointModel& model, const Vec3& h) noexcept {
    if (!sides_.empty())
      surface::point_sides(model.points, model.neighbours, model.closed_component_of, h, sides_);
  }
  /// For a place with a one-sided normal: 1 if its piece is touched from outside, else -1.
  [[nodiscard]] double at(const points::PointModel& model, std::uint32_t place) const noexcept {
    return sides_[model.closed_component_of.empty() ? 0 : model.closed_component_of[place]];
  }

 private:
  std::vector<double> sides_;
};

/// Sheets watched while free: two meeting faces and one more.
inline constexpr std::size_t kMaxSheets = 3;

/// Moves per frame along an edge that the god object has not passed. At 50 mm/s and 0.1 mm points it makes
/// one in two frames; the rest waits.
inline constexpr int kMaxFaceMoves = 4;

/// The model's local coordinates, mm. Belongs to one thread; reads the model, which must outlive it. Work per
/// update: kMaxWalkSteps moves, kMaxFaceMoves along an edge, kMaxEscapes wider looks of 64 points,
/// kMaxBoxTests box tests, segments of kMaxSegmentCells cells; the rest waits for the next.
class PointContact {
 public:
  /// Call before use. Allocates.
  void attach(const points::PointModel& model);
  /// Free at `h`, which defines the free side of closed surfaces. O(n) if there are any.
  void reset(const Vec3& h) noexcept;
  /// Free at `h`, known to be clear: the next update tests the way from there.
  void start_from(const Vec3& h) noexcept;
  /// Moves the HIP to `h`. True in contact: `end` then describes the god object's surroundings.
  [[nodiscard]] bool update(const Vec3& h, points::WalkResult& end, FrameCounters& counters) noexcept {
    steps_ = points::kMaxWalkSteps;
    behind_ = false;
    const bool touching = contact_ ? update_in_contact(h, end, counters) : update_free(h, end, counters);
    previous_ = h;
    return touching;
  }
  /// The last update left work for the next.
  [[nodiscard]] bool bound_hit() const noexcept { return behind_ || steps_ == 0 || scan_.running; }
  [[nodiscard]] bool contact() const noexcept { return contact_; }
  /// In contact: outward normal of the god object's plane, unit.
  [[nodiscard]] const Vec3& outward() const noexcept { return near_[0].outward; }
  [[nodiscard]] const Sheet& sheet() const noexcept { return near_[0]; }

 private:
  /// In contact: the god object follows; the HIP is out when above the plane there.
  bool update_in_contact(const Vec3& h, points::WalkResult& end, FrameCounters& counters) noexcept {
    Sheet& sheet = near_[0];
    const double before = height_mm_;  // of the last frame's HIP over the last frame's plane
    end = follow(*model_, sheet, h, steps_, counters);
    if (sheet.turned_from != kNoPlace) [[unlikely]]
      stay_on_facet(h, end, counters);
    const double height = height_mm_ = height_mm(*model_, sheet, h);
    if (sheet.walk_truncated || (height < 0.0 && !beyond_rim(sheet, h))) return true;
    contact_ = false;
    sheets_ = 1;
    // The way out crossed the plane; beyond, the HIP was free and may have met something else.
    const double out = before < 0.0 && height > 0.0 ? before / (before - height) : 1.0;
    tested_to_ = previous_ + out * (h - previous_);
    return update_free(h, end, counters);
  }

  bool update_free(const Vec3& h, points::WalkResult& end, FrameCounters& counters) noexcept;
  void stay_on_facet(const Vec3& h, points::WalkResult& end, FrameCounters& counters) noexcept;
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
  void add_sheet(std::uint32_t place, const Vec3& from, FrameCounters& counters) noexcept;

  const points::PointModel* model_ = nullptr;
  double leave_sq_mm2_ = 0.0;
  double same_sheet_sq_mm2_ = 0.0;

  Vec3 tested_to_ = Vec3::Zero();  ///< end of the tested path
  Vec3 previous_ = Vec3::Zero();   ///< HIP of the last update
  BoxScan scan_;
  std::array<Sheet, kMaxSheets> near_;  ///< in contact: the first only
  std::size_t sheets_ = 0;
  double height_mm_ = 0.0;  ///< in contact: the last HIP over its sheet's plane
  FreeSides sides_;         ///< of closed surfaces, from the HIP's placement
  bool contact_ = false;
  bool behind_ = false;  ///< the path is not tested up to the HIP
  int steps_ = 0;
};

/// Sideways reach of a point: its local resolution, and its box if it has no neighbours.
inline double PointContact::reach_sq(std::uint32_t place) const noexcept {
  return std::max(local_resolution_sq(*model_, place), model_->half_box(place).squaredNorm());
}

}  // namespace palpate::baselines::vertices
