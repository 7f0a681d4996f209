#include "toolkit/local_delaunay/raster_cells.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/parallel.h"

namespace palpate::local_delaunay {
namespace {

/// An edge over twice as long as the next in its row or column, or as the opposite one of the cell, is a
/// jump. Between two sheets seen straight on it turns by over 60 degrees, like a fold.
constexpr double kMaxStretchSq = 4.0;
/// Planes turned by more than 60 degrees from the local mean are folded.
constexpr double kMinCosineSq = 0.25;
/// Largest squared ratio of row to column distance: allows scan lines of 8:1 with reliable facet directions.
constexpr double kMaxAspectSq = 256.0;
/// Largest angle of a triangle's corner, 120 degrees, as squared double cosine. Beyond it Delaunay stars
/// differ, and are better where a raster is steep in both directions.
constexpr double kWideCornerSq = 1.0;
constexpr std::size_t kSlotsPerChunk = 16384;

/// `one` and `other` are squared lengths.
bool jumps(double one, double other) noexcept {
  return std::max(one, other) > kMaxStretchSq * std::min(one, other);
}
bool turns(const Vec3& one, const Vec3& mean) noexcept {
  const double along = one.dot(mean);
  return !(along > 0.0 && along * along >= kMinCosineSq * one.squaredNorm() * mean.squaredNorm());
}
/// Takes squared lengths. True for a corner of 120 degrees or sides much longer than others.
bool is_poor(double a, double b, double c) noexcept {
  const double longest = std::max({a, b, c}), shortest = std::min({a, b, c});
  const double middle = a + b + c - longest - shortest;
  const double beyond = longest - shortest - middle;
  if (beyond > 0.0 && beyond * beyond > kWideCornerSq * shortest * middle) return true;
  return !(shortest > 0.0 && longest <= kMaxAspectSq * shortest);
}

/// A cell with three corners; `middle` is opposite the missing one.
RasterCell half_cell(const Vec3& middle, const Vec3& next, const Vec3& last, std::uint32_t form) noexcept {
  RasterCell cell;
  const Vec3 a = next - middle, b = last - middle;
  cell.area = a.cross(b).cast<float>();
  cell.form = form;
  if (is_poor(a.squaredNorm(), b.squaredNorm(), (b - a).squaredNorm())) cell.form |= RasterCell::kDoubtful;
  return cell;
}

}  // namespace

RasterCell raster_cell(const std::array<const Vec3*, 4>& at) noexcept {
  constexpr std::uint32_t kDown = RasterCell::kDown, kFirst = RasterCell::kFirst,
                          kSecond = RasterCell::kSecond;
  const auto& [a, b, c, d] = at;  // 00, 01, 10, 11
  const int present = (a != nullptr) + (b != nullptr) + (c != nullptr) + (d != nullptr);
  if (present < 3) return {};
  if (d == nullptr) return half_cell(*a, *b, *c, kFirst);
  if (a == nullptr) return half_cell(*d, *c, *b, kSecond);
  if (c == nullptr) return half_cell(*b, *d, *a, kDown | kFirst);
  if (b == nullptr) return half_cell(*c, *a, *d, kDown | kSecond);
  const Vec3 above = *b - *a, left = *c - *a, below = *d - *c, right = *d - *b;
  const Vec3 down = *d - *a, up = *b - *c;
  const double above_sq = above.squaredNorm(), left_sq = left.squaredNorm(), below_sq = below.squaredNorm(),
               right_sq = right.squaredNorm(), down_sq = down.squaredNorm(), up_sq = up.squaredNorm();
  const bool is_down = down_sq <= up_sq;
  const Vec3 first = is_down ? above.cross(down) : above.cross(left);
  const Vec3 second = is_down ? down.cross(left) : below.cross(right);
  const Vec3 area = first + second;
  RasterCell cell;
  cell.area = area.cast<float>();
  cell.form = (is_down ? kDown : 0u) | kFirst | kSecond;
  const bool poor = is_down ? is_poor(above_sq, right_sq, down_sq) || is_poor(below_sq, left_sq, down_sq)
                            : is_poor(above_sq, left_sq, up_sq) || is_poor(below_sq, right_sq, up_sq);
  if (poor || turns(first, area) || turns(second, area) || jumps(above_sq, below_sq) ||
      jumps(left_sq, right_sq))
    cell.form |= RasterCell::kDoubtful;
  return cell;
}

namespace {

class CellMaker {
 public:
  CellMaker(const cloud::Cloud& cloud, const RasterGrid& grid) : cloud_(cloud), grid_(grid) {
    cells_.cell.resize(grid.slots());
    cells_.doubtful.assign(grid.slots(), 0);
  }
  RasterCells run(int threads) {
    const std::size_t rows = std::max<std::size_t>(1, kSlotsPerChunk / grid_.columns());
    parallel_chunks(grid_.rows(), rows, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t row = begin; row < end; ++row) make_row(static_cast<std::uint32_t>(row));
    });
    parallel_chunks(grid_.rows(), rows, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t row = begin; row < end; ++row) judge_row(static_cast<std::uint32_t>(row));
    });
    return std::move(cells_);
  }

 private:
  struct Corner {
    Vec3 at;
    bool is_there = false;
    [[nodiscard]] const Vec3* get() const noexcept { return is_there ? &at : nullptr; }
  };
  [[nodiscard]] Corner corner(std::uint32_t row, std::uint32_t column) const noexcept {
    const std::uint32_t i = grid_.point(row, column);
    return i == kNoPlace ? Corner{Vec3::Zero(), false} : Corner{cloud_.local_mm(i), true};
  }
  [[nodiscard]] std::size_t slot(std::uint32_t row, std::uint32_t column) const noexcept {
    return std::size_t{row} * grid_.columns() + column;
  }
  void make_row(std::uint32_t row) noexcept {
    const std::uint32_t below = grid_.row_beside(row, 1);
    if (below == kNoPlace) return;
    Corner a = corner(row, 0), c = corner(below, 0);
    for (std::uint32_t column = 0; column < grid_.columns(); ++column) {
      const std::uint32_t beside = grid_.column_beside(column, 1);
      if (beside == kNoPlace) return;
      const Corner b = corner(row, beside), d = corner(below, beside);
      cells_.cell[slot(row, column)] = raster_cell({a.get(), b.get(), c.get(), d.get()});
      a = b;
      c = d;
    }
  }
  /// True if one of the edges to both neighbours is a jump.
  [[nodiscard]] static bool jump_at(const Corner& here, const Corner& before, const Corner& behind) noexcept {
    return before.is_there && behind.is_there &&
           jumps((before.at - here.at).squaredNorm(), (behind.at - here.at).squaredNorm());
  }
  void judge_row(std::uint32_t row) noexcept {
    const std::uint32_t above = grid_.row_beside(row, -1), below = grid_.row_beside(row, 1);
    const RasterCell none;
    const auto cell = [&](std::uint32_t r, std::uint32_t c) -> const RasterCell& {
      return r == kNoPlace || c == kNoPlace ? none : cells_.at(grid_, r, c);
    };
    const auto at = [&](std::uint32_t r, std::uint32_t c) {
      return r == kNoPlace || c == kNoPlace ? Corner{Vec3::Zero(), false} : corner(r, c);
    };
    Corner left = at(row, grid_.column_beside(0, -1)), here = corner(row, 0);
    for (std::uint32_t column = 0; column < grid_.columns(); ++column) {
      const std::uint32_t before = grid_.column_beside(column, -1), beside = grid_.column_beside(column, 1);
      const Corner right = at(row, beside);
      if (here.is_there) {
        const std::array<const RasterCell*, 4> around = {&cell(row, column), &cell(row, before),
                                                         &cell(above, before), &cell(above, column)};
        bool doubtful = (around[0]->form | around[1]->form | around[2]->form | around[3]->form) == 0;
        Vec3 mean = Vec3::Zero();
        for (const RasterCell* of : around) {
          doubtful = doubtful || of->has(RasterCell::kDoubtful);
          mean += of->area.cast<double>();
        }
        for (const RasterCell* of : around)
          doubtful = doubtful || (of->form != 0 && turns(of->area.cast<double>(), mean));
        doubtful =
            doubtful || jump_at(here, left, right) || jump_at(here, at(above, column), at(below, column));
        cells_.doubtful[slot(row, column)] = static_cast<std::uint8_t>(doubtful);
      }
      left = here;
      here = right;
    }
  }

  const cloud::Cloud& cloud_;
  const RasterGrid& grid_;
  RasterCells cells_;
};

}  // namespace

RasterCells cells_of(const cloud::Cloud& cloud, const RasterGrid& grid, int threads) {
  return CellMaker(cloud, grid).run(threads);
}

}  // namespace palpate::local_delaunay
