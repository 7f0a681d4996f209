#include "toolkit/cloud/height_field.h"

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include <algorithm>
#include <array>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"

namespace palpate::cloud {
namespace {

/// Surroundings of a point: the largest gap's width, nine posts each way.
constexpr std::size_t kThinWindow = kMaxGapPosts;

struct Grid {
  std::size_t columns = 0, rows = 0;
  [[nodiscard]] std::size_t size() const noexcept { return columns * rows; }
  /// The windows of `side` posts that touch the grid, indexed by their last post.
  [[nodiscard]] Grid windows(std::size_t side) const noexcept {
    return {columns + side - 1, rows + side - 1};
  }
};

/// Marked posts in every window of side x side posts that touches the grid.
std::vector<std::uint16_t> window_sums(const std::vector<std::uint8_t>& marked, const Grid& grid,
                                       std::size_t side) {
  const Grid windows = grid.windows(side);
  std::vector<std::uint16_t> in_row(grid.rows * windows.columns);
  for (std::size_t row = 0; row < grid.rows; ++row) {
    const std::uint8_t* const from = &marked[row * grid.columns];
    unsigned sum = 0;
    for (std::size_t column = 0; column < windows.columns; ++column) {
      if (column < grid.columns) sum += from[column];
      if (column >= side) sum -= from[column - side];
      in_row[row * windows.columns + column] = static_cast<std::uint16_t>(sum);
    }
  }
  std::vector<std::uint16_t> sums(windows.size());
  std::vector<unsigned> sum(windows.columns, 0);
  for (std::size_t row = 0; row < windows.rows; ++row)
    for (std::size_t column = 0; column < windows.columns; ++column) {
      if (row < grid.rows) sum[column] += in_row[row * windows.columns + column];
      if (row >= side) sum[column] -= in_row[(row - side) * windows.columns + column];
      sums[row * windows.columns + column] = static_cast<std::uint16_t>(sum[column]);
    }
  return sums;
}

/// Posts from column and row up to, excluding, the ends.
struct PostBox {
  std::size_t column, row, end_column, end_row;
  void add(std::size_t at_column, std::size_t at_row) noexcept {
    column = std::min(column, at_column);
    row = std::min(row, at_row);
    end_column = std::max(end_column, at_column + 1);
    end_row = std::max(end_row, at_row + 1);
  }
  void grow(std::size_t by, std::size_t columns, std::size_t rows) noexcept {
    column -= std::min(column, by);
    row -= std::min(row, by);
    end_column = std::min(end_column + by, columns);
    end_row = std::min(end_row + by, rows);
  }
};

/// Side of the smallest empty square that is not chance when this share of posts has points. Computed by
/// products, which are the same on all machines.
std::uint32_t chance_side(double share) noexcept {
  double all_missing = 1.0;
  for (std::uint32_t side = 1; side < kMaxGapPosts; ++side) {
    for (std::uint32_t post = 0; post < 2 * side - 1; ++post) all_missing *= 1.0 - share;
    if (all_missing < kFalseVoidProbability) return side;
  }
  return kMaxGapPosts;
}

std::vector<std::uint8_t> with_point(const HeightField& field) {
  std::vector<std::uint8_t> has(field.posts());
  for (std::size_t post = 0; post < has.size(); ++post) has[post] = std::isfinite(field.height_mm[post]);
  return has;
}

/// Classifies points, gaps, and voids including outside.
std::vector<PostKind> gaps_and_voids(const HeightField& field, const Grid& grid) {
  const std::vector<std::uint8_t> has = with_point(field);
  std::vector<std::uint8_t> is_empty;
  for (const std::uint16_t points : window_sums(has, grid, kGapPosts)) is_empty.push_back(points == 0);
  const Grid squares = grid.windows(kGapPosts), pairs = squares.windows(kGapPosts);
  // Squares that cover a post end at it or up to 7 posts later: the window of squares that ends there.
  const std::vector<std::uint16_t> covering = window_sums(is_empty, squares, kGapPosts);
  std::vector<PostKind> of_post(grid.size(), PostKind::kPoint);
  for (std::size_t row = 0; row < grid.rows; ++row)
    for (std::size_t column = 0; column < grid.columns; ++column) {
      const std::size_t post = row * grid.columns + column;
      const std::size_t window = (row + kGapPosts - 1) * pairs.columns + column + kGapPosts - 1;
      if (has[post] == 0) of_post[post] = covering[window] == 0 ? PostKind::kGap : PostKind::kVoid;
    }
  return of_post;
}

/// Calls visit(post) for a post's neighbours along rows and columns.
template <class Visit>
void beside(const Grid& grid, std::size_t post, const Visit& visit) {
  const std::size_t column = post % grid.columns;
  if (column > 0) visit(post - 1);
  if (column + 1 < grid.columns) visit(post + 1);
  if (post >= grid.columns) visit(post - grid.columns);
  if (post + grid.columns < grid.size()) visit(post + grid.columns);
}

/// Marks voids connected to the border, post by post, as outside.
void mark_outside(std::vector<PostKind>& of_post, const Grid& grid) {
  std::vector<std::size_t> open;
  const auto visit = [&](std::size_t post) {
    if (of_post[post] != PostKind::kVoid) return;
    of_post[post] = PostKind::kOutside;
    open.push_back(post);
  };
  for (std::size_t column = 0; column < grid.columns; ++column) {
    visit(column);
    visit(grid.size() - 1 - column);
  }
  for (std::size_t row = 0; row < grid.rows; ++row) {
    visit(row * grid.columns);
    visit(row * grid.columns + grid.columns - 1);
  }
  while (!open.empty()) {
    const std::size_t post = open.back();
    open.pop_back();
    beside(grid, post, visit);
  }
}

/// Per post: the side of the largest square of gaps and voids that ends there, one more than the smallest of
/// the left, lower and diagonal ones.
std::vector<std::uint32_t> squares_of(const std::vector<PostKind>& of_post, const Grid& grid) {
  std::vector<std::uint32_t> side(grid.size(), 0);
  for (std::size_t post = 0; post < side.size(); ++post) {
    if (of_post[post] != PostKind::kGap && of_post[post] != PostKind::kVoid) continue;
    const bool first = post < grid.columns || post % grid.columns == 0;
    side[post] =
        first ? 1 : std::min({side[post - 1], side[post - grid.columns], side[post - grid.columns - 1]}) + 1;
  }
  return side;
}

/// Counts posts of a kind in boxes in O(1).
class BoxCounts {
 public:
  BoxCounts(const std::vector<PostKind>& of_post, const Grid& grid, PostKind kind)
      : columns_(grid.columns + 1), below_((grid.columns + 1) * (grid.rows + 1), 0) {
    for (std::size_t row = 0; row < grid.rows; ++row)
      for (std::size_t column = 0; column < grid.columns; ++column)
        below_[(row + 1) * columns_ + column + 1] =
            below_[row * columns_ + column + 1] + below_[(row + 1) * columns_ + column] -
            below_[row * columns_ + column] + (of_post[row * grid.columns + column] == kind ? 1 : 0);
  }
  [[nodiscard]] std::uint32_t in(const PostBox& box) const noexcept {
    const auto at = [&](std::size_t column, std::size_t row) { return below_[row * columns_ + column]; };
    return at(box.end_column, box.end_row) - at(box.column, box.end_row) - at(box.end_column, box.row) +
           at(box.column, box.row);
  }

 private:
  std::size_t columns_;
  std::vector<std::uint32_t> below_;  ///< modulo 2^32, as are their differences
};

/// Turns voids that chance may have left, given few points around, into gaps.
void close_chance_voids(std::vector<PostKind>& of_post, const Grid& grid) {
  const std::vector<std::uint32_t> side = squares_of(of_post, grid);
  const BoxCounts points(of_post, grid, PostKind::kPoint), gaps(of_post, grid, PostKind::kGap);
  std::vector<bool> seen(grid.size(), false);
  std::vector<std::size_t> all;
  for (std::size_t first = 0; first < grid.size(); ++first) {
    if (of_post[first] != PostKind::kVoid || seen[first]) continue;
    all.assign(1, first);
    seen[first] = true;
    std::uint32_t widest = 0;
    PostBox box{grid.columns, grid.rows, 0, 0};
    for (std::size_t i = 0; i < all.size(); ++i) {
      widest = std::max(widest, side[all[i]]);
      box.add(all[i] % grid.columns, all[i] / grid.columns);
      beside(grid, all[i], [&](std::size_t post) {
        if (of_post[post] != PostKind::kVoid || seen[post]) return;
        seen[post] = true;
        all.push_back(post);
      });
    }
    box.grow(kGapPosts, grid.columns, grid.rows);
    const auto found = static_cast<double>(points.in(box)), missing = static_cast<double>(gaps.in(box));
    if (widest < chance_side(found / (found + missing)))
      for (const std::size_t post : all) of_post[post] = PostKind::kGap;
  }
}

}  // namespace

Holes find_holes(const HeightField& field) {
  Holes holes;
  holes.missing = field.holes;
  if (holes.missing == 0) return holes;
  const Grid grid{field.columns, field.rows};
  holes.of_post = gaps_and_voids(field, grid);
  mark_outside(holes.of_post, grid);
  if (std::find(holes.of_post.begin(), holes.of_post.end(), PostKind::kVoid) != holes.of_post.end())
    close_chance_voids(holes.of_post, grid);
  const auto count = [&](PostKind kind) {
    return static_cast<std::size_t>(std::count(holes.of_post.begin(), holes.of_post.end(), kind));
  };
  holes.gaps = count(PostKind::kGap);
  holes.voids = count(PostKind::kVoid);
  holes.outside = count(PostKind::kOutside);
  const std::vector<std::uint32_t> squares = squares_of(holes.of_post, grid);
  holes.widest = *std::max_element(squares.begin(), squares.end());
  return holes;
}

std::string describe(const HeightField& field, const Holes& holes, bool filled) {
  std::string text = fmt::format("a lattice of {} x {} posts, ", field.columns, field.rows);
  if (holes.missing == 0) return text + "each with its point";
  text += fmt::format("{} of them without a point ({:.3g} %)", holes.missing,
                      100.0 * static_cast<double>(holes.missing) / static_cast<double>(field.posts()));
  if (holes.widest > 0)
    text += fmt::format(", the widest hole {} post{}", holes.widest, holes.widest == 1 ? "" : "s");
  const char* before = ": ";
  const auto add = [&](std::size_t posts, const std::string& what) {
    if (posts == 0) return;
    text += before + (posts == holes.missing ? "all" : fmt::format("{}", posts)) + " " + what;
    before = ", ";
  };
  add(holes.gaps, filled ? "filled from the points around" : "left open");
  add(holes.voids, fmt::format("in holes at least {} posts wide, open", kGapPosts));
  add(holes.outside, "beside the points");
  return text;
}

double sparse_fraction(const HeightField& field) {
  if (field.holes == 0) return 0.0;
  const Grid grid{field.columns, field.rows}, windows = grid.windows(kThinWindow);
  constexpr std::size_t kReach = kThinWindow / 2;
  const std::vector<std::uint16_t> points = window_sums(with_point(field), grid, kThinWindow);
  const auto posts_around = [](std::size_t at, std::size_t count) {
    return std::min(at + kReach, count - 1) - (at > kReach ? at - kReach : 0) + 1;
  };
  double all = 0.0, thin = 0.0;
  for (std::size_t row = 0; row < grid.rows; ++row)
    for (std::size_t column = 0; column < grid.columns; ++column) {
      if (!std::isfinite(field.height_mm[row * grid.columns + column])) continue;
      const std::size_t posts = posts_around(column, grid.columns) * posts_around(row, grid.rows);
      const std::size_t found = points[(row + kReach) * windows.columns + column + kReach];
      const double area = static_cast<double>(posts) / static_cast<double>(found);
      all += area;
      if (kMaxPostsPerPoint * found < posts) thin += area;
    }
  return thin / all;
}

HeightFieldSummary summarise_height_field(const Cloud& cloud, bool filled) {
  HeightFieldSummary facts;
  const Result<HeightField> field = height_field_of(cloud);
  facts.is = field.ok();
  if (!facts.is) {
    facts.words = field.error().what;
    return facts;
  }
  facts.holes = find_holes(*field);
  release_memory(facts.holes.of_post);
  facts.words = describe(*field, facts.holes, filled);
  facts.columns = field->columns;
  facts.rows = field->rows;
  return facts;
}

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
    const auto check = [&](std::int32_t dx, std::int32_t dy) {
      const std::int32_t c = column + dx, r = row + dy;
      if (c < 0 || r < 0 || c >= columns_ || r >= rows_ || !has_point(c, r)) return;
      seen |= (dx >= 0 && dy >= 0) | (dx <= 0 && dy >= 0) << 1 | (dx >= 0 && dy <= 0) << 2 |
              (dx <= 0 && dy <= 0) << 3;
    };
    for (std::int32_t reach = 1; reach < kMost; ++reach) {
      for (std::int32_t d = -reach; d <= reach; ++d) {
        check(d, -reach);
        check(d, reach);
        check(-reach, d);
        check(reach, d);
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
  parallel_each(field.rows, kRowsPerChunk, threads, [&](std::size_t row) {
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
