// Passes over a stream of points: their bounds and counts, and the scattering to regions. Each batch is read
// while the one before is worked on.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <palpate/progress.h>
#include <palpate/result.h>
#include "toolkit/io/point_stream.h"
#include "toolkit/prepared/cell_lattice.h"
#include "toolkit/prepared/cell_partition.h"
#include "toolkit/prepared/scratch_files.h"

namespace palpate::prepared {

/// Findings that all passes over the same points must share.
struct PassFindings {
  std::uint64_t points = 0;
  std::uint64_t dropped = 0;
  geometry::Aabb bounds_mm;
  std::uint64_t outside = 0;  ///< points that the lattice does not reach
};

/// Reads the whole stream several times. Not thread-safe.
class PointPasses {
 public:
  PointPasses(io::PointStream& stream, double mm_per_unit, int threads, Progress& progress)
      : stream_(&stream), mm_per_unit_(mm_per_unit), threads_(threads), progress_(&progress) {}

  /// Bounds, and counts in `tree` of the points that `lattice` reaches; without a lattice bounds only.
  [[nodiscard]] Result<PassFindings> count(const std::optional<CellLattice>& lattice, CountTree& tree);
  /// Adds every point to its region. An Error if they are not the counted ones.
  [[nodiscard]] Status scatter(const CellLattice& lattice, const CountTree& tree, PointScratch& scratch);

  /// The header's bounds, mm, if they are plausible.
  [[nodiscard]] std::optional<geometry::Aabb> promised_bounds_mm() const;
  /// The header's number of points; a wrong one does no harm.
  [[nodiscard]] std::uint64_t promised_points() const noexcept { return stream_->header().points; }
  [[nodiscard]] int passes() const noexcept { return passes_; }
  /// The points differ from pass to pass.
  [[nodiscard]] static Error changed();

 private:
  struct Located {
    PackedPoint point;
    CountTree::Place place;
    bool there = false;
  };
  using Batch = std::function<Status(std::span<Vec3> points)>;
  [[nodiscard]] Status for_each_batch(std::string_view what, const Batch& work);
  /// Points in mm in place; findings are added to, and each point located.
  void locate(std::span<Vec3> points, const CellLattice* lattice, const CountTree& tree,
              std::vector<Located>& located, PassFindings& findings) const;

  io::PointStream* stream_;
  double mm_per_unit_;
  int threads_;
  Progress* progress_;
  int passes_ = 0;
};

}  // namespace palpate::prepared
