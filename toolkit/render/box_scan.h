// Vertex boxes crossed by a segment, found through the grid, with a bound on the work of one frame.
#pragma once

#include <array>
#include <cstdint>

#include "toolkit/geometry/segment_box.h"
#include "toolkit/partition/cell_walk.h"
#include "toolkit/render/point_model.h"
#include "toolkit/render/point_walk.h"

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
  /// when all boxes of the segment have been tested.
  template <class Skip>
  bool advance(const PointModel& model, FrameCounters& counters, Skip&& skip) noexcept {
    const geometry::SegmentProbe probe(from_mm, to_mm);
    std::uint64_t seen = 0;  // boxes before this frame's first
    std::uint64_t left = kMaxBoxTests;
    running =
        !visit_cells(model.grid, from_mm, to_mm, model.largest_half_box_mm, [&](const partition::Cell& cell) {
          ++counters.cells_visited;
          const partition::PlaceRange range = model.grid.find(cell);
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
            if (!geometry::segment_touches_box(probe, model.points[p].at(), model.half_box(p))) continue;
            if (!skip(p)) keep(p, distance_sq(model.points[p], from_mm));
          }
          return true;
        });
    return !running;
  }
};

}  // namespace palpate::render
