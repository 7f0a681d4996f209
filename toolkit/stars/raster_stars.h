// Internal to stars: stars that are read from the rows and columns of a scan. Where its cells may be no
// surface they are laid out as of any points.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "toolkit/stars/draft.h"
#include "toolkit/stars/raster_cells.h"
#include "toolkit/stars/raster_grid.h"
#include "toolkit/stars/turn.h"

namespace palpate::stars {

class RasterStars {
 public:
  /// None where the cloud's points stand in no raster, or where so many of its cells are doubtful that a
  /// search of all neighbours costs no more. Parallel, O(n); the same for any number of threads.
  static std::optional<RasterStars> of(const cloud::Cloud& cloud, int threads);

  [[nodiscard]] const RasterGrid& grid() const noexcept { return grid_; }
  /// Of each place its index in the cloud.
  void set_order(const std::vector<std::uint32_t>& order, int threads);

  /// Whether all stars are the raster's, in one piece: the whole raster without a hole, a jump or a fold, and
  /// with no border that is short enough to be filled.
  [[nodiscard]] bool is_whole() const noexcept { return whole_; }
  struct Side {
    Enclosure enclosure = Enclosure::kOpen;
    bool inward = false;  ///< star() is to be turned
    double least_enclosed = 1.0;
  };
  /// Of a whole raster. Parallel.
  [[nodiscard]] Side side_of_whole(const Draft& draft) const;
  /// As the cells have it, by places, all sectors agreed; counter-clockwise along columns x rows.
  [[nodiscard]] Star star(std::uint32_t place) const noexcept;

  /// Where it is not whole: the stars of all points, and what make_stars() and those after it ask of a draft.
  /// Returns how many are the raster's. Parallel.
  std::uint64_t fill(Draft& draft) const;

 private:
  explicit RasterStars(RasterGrid grid) : grid_(std::move(grid)) {}
  void mark_all(int threads);
  [[nodiscard]] std::vector<std::uint8_t> doubled_places(const Draft& draft,
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

}  // namespace palpate::stars
