// Fills gaps of a height field with a fitted surface.
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>

#include "toolkit/cloud/height_field_holes.h"
#include "toolkit/core/parallel.h"

namespace palpate::cloud {
namespace {

/// Rows per chunk.
constexpr std::size_t kRowsPerChunk = 16;
/// Posts by which a fit extends beyond the reach with points in all quarters; single rows on each side of
/// missing ones do not determine the curvature across.
constexpr std::int32_t kBeyond = 2;
/// Regularisation: undetermined coefficients (points in a row or on an ellipse) become zero instead of
/// amplified noise; squares of coefficients count this share of all weights. Determined ones change by about
/// as much: less than height rounding for a slope, a ten thousandth of a curvature.
constexpr double kSlopeHeld = 0x1p-40, kCurvatureHeld = 0x1p-14;

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

struct Filled {
  float height_mm = 0.0f;
  std::size_t nearest = 0;  ///< post of the nearest point
};

class Filler {
 public:
  Filler(const HeightField& field, const Holes& holes)
      : field_(field),
        holes_(holes),
        columns_(static_cast<std::int32_t>(field.columns)),
        rows_(static_cast<std::int32_t>(field.rows)) {}

  [[nodiscard]] Filled at(std::int32_t column, std::int32_t row) const {
    const std::int32_t near = first_all_around(column, row);
    const std::int32_t reach = near + kBeyond;
    Matrix6 products = Matrix6::Zero();
    Vector6 sums = Vector6::Zero();
    Filled filled;
    std::int32_t nearest_sq = std::numeric_limits<std::int32_t>::max();
    for (std::int32_t r = std::max(row - reach, 0); r <= std::min(row + reach, rows_ - 1); ++r)
      for (std::int32_t c = std::max(column - reach, 0); c <= std::min(column + reach, columns_ - 1); ++c) {
        if (!has_point(c, r)) continue;
        const std::int32_t dx = c - column, dy = r - row, sq = dx * dx + dy * dy;
        if (sq < nearest_sq) {
          nearest_sq = sq;
          filled.nearest = post(c, r);
        }
        const double u = static_cast<double>(dx) / near, v = static_cast<double>(dy) / near;
        const double weight = 1.0 / (static_cast<double>(sq) * sq);
        const Vector6 terms(1.0, u, v, u * u, u * v, v * v);
        products += weight * terms * terms.transpose();
        sums += weight * static_cast<double>(field_.height_mm[post(c, r)]) * terms;
      }
    const double weights = products(0, 0);
    for (int i = 1; i < 3; ++i) products(i, i) += kSlopeHeld * weights;
    for (int i = 3; i < 6; ++i) products(i, i) += kCurvatureHeld * weights;
    filled.height_mm = static_cast<float>(products.ldlt().solve(sums)(0));
    return filled;
  }

 private:
  [[nodiscard]] std::size_t post(std::int32_t column, std::int32_t row) const noexcept {
    return field_.at(static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row));
  }
  [[nodiscard]] bool has_point(std::int32_t column, std::int32_t row) const noexcept {
    return holes_.of_post[post(column, row)] == PostKind::kPoint;
  }

  /// The smallest reach with a point in each quarter around a post (axes belong to both sides). Below
  /// kMaxGapPosts for a gap, by definition.
  [[nodiscard]] std::int32_t first_all_around(std::int32_t column, std::int32_t row) const noexcept {
    constexpr auto kMost = static_cast<std::int32_t>(kMaxGapPosts) - 1;
    unsigned seen = 0;
    const auto look = [&](std::int32_t dx, std::int32_t dy) {
      const std::int32_t c = column + dx, r = row + dy;
      if (c < 0 || r < 0 || c >= columns_ || r >= rows_ || !has_point(c, r)) return;
      seen |= (dx >= 0 && dy >= 0) | (dx <= 0 && dy >= 0) << 1 | (dx >= 0 && dy <= 0) << 2 |
              (dx <= 0 && dy <= 0) << 3;
    };
    for (std::int32_t reach = 1; reach < kMost; ++reach) {
      for (std::int32_t d = -reach; d <= reach; ++d) {
        look(d, -reach);
        look(d, reach);
        look(-reach, d);
        look(reach, d);
      }
      if (seen == 0xF) return reach;
    }
    return kMost;
  }

  const HeightField& field_;
  const Holes& holes_;
  std::int32_t columns_, rows_;
};

}  // namespace

void fill_gaps(HeightField& field, const Holes& holes, std::vector<std::uint32_t>* point_of_post,
               int threads) {
  if (holes.gaps == 0) return;
  const Filler filler(field, holes);
  LargePageVector<float> heights = field.height_mm;
  parallel_chunks(field.rows, kRowsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row)
      for (std::uint32_t column = 0; column < field.columns; ++column) {
        const std::size_t post = field.at(column, static_cast<std::uint32_t>(row));
        if (holes.of_post[post] != PostKind::kGap) continue;
        const Filled filled = filler.at(static_cast<std::int32_t>(column), static_cast<std::int32_t>(row));
        heights[post] = filled.height_mm;
        // Reads points and writes gaps only.
        if (point_of_post != nullptr) (*point_of_post)[post] = (*point_of_post)[filled.nearest];
      }
  });
  field.height_mm = std::move(heights);
  update_block_maxima(field);
}

}  // namespace palpate::cloud
