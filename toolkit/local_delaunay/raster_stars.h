// Stars read from the rows and columns of a scan; doubtful parts are made as for unordered points. Internal
// to local_delaunay.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "toolkit/local_delaunay/candidate_triangulation.h"
#include "toolkit/local_delaunay/raster_cells.h"

namespace palpate::local_delaunay {

class RasterStars {
 public:
  /// None if the cloud has no raster, or so many doubtful cells that a full neighbour search costs no more.
  /// Parallel, O(n); independent of the number of threads.
  static std::optional<RasterStars> of(const cloud::Cloud& cloud, int threads);

  [[nodiscard]] const RasterGrid& grid() const noexcept { return grid_; }
  /// The cloud index of each place.
  void set_order(const std::vector<std::uint32_t>& order, int threads);

  /// True if all stars come from the raster as one piece: no hole, jump, fold or border short enough to fill.
  [[nodiscard]] bool is_whole() const noexcept { return whole_; }
  struct Side {
    VolumeEnclosure enclosure = VolumeEnclosure::kOpen;
    bool inward = false;  ///< star() must be turned
    double min_enclosed = 1.0;
  };
  /// For a whole raster. Parallel.
  [[nodiscard]] Side side_of_whole(const CandidateTriangulation& candidate) const;
  /// The star from the cells, by places, all sectors agreed; counter-clockwise along columns x rows.
  [[nodiscard]] Star star(std::uint32_t place) const noexcept;

  /// For a partial raster: makes the stars of all points and the data that make_stars() and later steps need.
  /// Returns the number of raster stars. Parallel.
  std::uint64_t fill(CandidateTriangulation& candidate) const;

 private:
  explicit RasterStars(RasterGrid grid) : grid_(std::move(grid)) {}
  void mark_all(int threads);
  [[nodiscard]] std::vector<std::uint8_t> doubled_places(const CandidateTriangulation& candidate,
                                                         const std::vector<std::uint8_t>& wanted) const;
  [[nodiscard]] Vec3f normal(std::uint32_t place) const noexcept;

  RasterGrid grid_;
  RasterCells cells_;
  std::vector<std::uint8_t> state_;  ///< by slot, see raster_stars.cpp
  std::uint64_t laid_out_ = 0;
  bool whole_ = false;
  std::vector<std::uint32_t> place_at_;  ///< by slot
  std::vector<std::uint32_t> slot_of_;   ///< by place
};

}  // namespace palpate::local_delaunay
