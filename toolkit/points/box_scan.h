// Vertex boxes crossed by a segment, found through any partition, with a bound on the work of one frame.
#pragma once

#include <array>
#include <cstdint>

#include "toolkit/geometry/segment_box.h"
#include "toolkit/geometry/swept_sphere.h"
#include "toolkit/partition/cell_walk.h"
#include "toolkit/partition/space_tree.h"
#include "toolkit/points/point_model.h"
#include "toolkit/points/point_walk.h"

namespace palpate::render {

/// Box tests a frame may make: at some 5 ns each, 80 us of the 1 ms a frame has.
inline constexpr std::uint64_t kMaxBoxTests = 16384;
/// Cells a frame may look at: a segment of this many cells at a reach below one cell visits at most about
/// nine times as many, each one look-up.
inline constexpr double kMaxSegmentCells = 64.0;
/// Crossed boxes kept, nearest to the segment's start first.
inline constexpr std::size_t kMaxCrossed = 4;

/// The crossed boxes nearest to the start of a segment, over one or more frames.
struct BoxScan {
  Vec3 from_mm = Vec3::Zero();
  Vec3 to_mm = Vec3::Zero();
  std::uint64_t tested = 0;  ///< boxes already tested, in the fixed order of cells and places
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

  /// Tests up to kMaxBoxTests more boxes. `skip(place)` rules out crossed boxes that are of no interest. True
  /// when all boxes of the segment have been tested. One choice a frame, always the same for a model.
  template <class Skip>
  bool advance(const PointModel& model, FrameCounters& counters, Skip&& skip) noexcept {
    // The grid's scan is called here alone: the compiler then writes it into the frame, a tenth of its work
    // less.
    if (model.tree.index() == 0) [[likely]]
      return scan_any(model, model.grid, counters, skip);
    return with_tree(model, [&](const auto& tree) noexcept { return scan_any(model, tree, counters, skip); });
  }

  /// advance() for one partition, whose order of places is the model's. A partition that moves points while
  /// the scan is running may show a box twice or not at all: start again after a move.
  template <bool kSwept, partition::Partition P, class Skip>
  bool scan(const PointModel& model, const P& partition, FrameCounters& counters, Skip&& skip) noexcept {
    const geometry::SegmentProbe probe(from_mm, to_mm);
    Vec3 reach = model.largest_half_box_mm;
    if constexpr (kSwept) reach += Vec3::Constant(model.sphere_mm);
    std::uint64_t seen = 0;  // boxes before this frame's first
    std::uint64_t left = kMaxBoxTests;
    running = !visit_ranges(partition, from_mm, to_mm, reach, [&](partition::PlaceRange range) {
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
        if (!skip(p)) keep(p, distance_sq(model.points[p], from_mm));
      }
      return true;
    });
    return !running;
  }

 private:
  template <class P, class Skip>
  bool scan_any(const PointModel& model, const P& partition, FrameCounters& counters, Skip&& skip) noexcept {
    return model.sphere_mm > 0.0 ? scan<true>(model, partition, counters, skip)
                                 : scan<false>(model, partition, counters, skip);
  }
  template <bool kSwept>
  static bool touches(const PointModel& model, const geometry::SegmentProbe& probe, std::uint32_t place,
                      FrameCounters& counters) noexcept {
    const Vec3 centre = model.points[place].at(), half = model.half_box(place);
    if constexpr (!kSwept) return geometry::segment_touches_box(probe, centre, half);
    if (!geometry::swept_sphere_touches_box(probe, model.sphere_mm, centre, half)) return false;
    counters.sphere_only += !geometry::segment_touches_box(probe, centre, half);
    return true;
  }
};

}  // namespace palpate::render
