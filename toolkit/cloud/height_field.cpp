#include "toolkit/cloud/height_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace palpate::cloud {
namespace {

/// Coordinates nearer than this share of the mean plan spacing share a column; a lattice eight times longer
/// than wide still has columns eight of these apart.
constexpr double kSameColumnShare = 1.0 / 64.0;

/// Positions low, low + step, ... along one axis.
struct Axis {
  double low = 0.0, step = 0.0;
  std::size_t count = 0;
};

Error no_lattice(std::string why) {
  return Error{"no height field on a regular grid: " + std::move(why), "use the renderer cloud"};
}

/// Finite numbers in ascending order by radix sort: three passes, where comparison takes twenty.
std::vector<float> sorted(const std::vector<float>& values) {
  constexpr std::uint32_t kSign = 0x80000000u;
  constexpr unsigned kDigitBits = 11, kBits = 32;
  constexpr std::size_t kDigits = std::size_t{1} << kDigitBits;
  std::vector<std::uint32_t> keys(values.size()), moved(values.size());
  // Bits of positive floats are in order, those of negative ones reversed.
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto bits = std::bit_cast<std::uint32_t>(values[i]);
    keys[i] = (bits & kSign) != 0 ? ~bits : bits | kSign;
  }
  for (unsigned shift = 0; shift < kBits; shift += kDigitBits) {
    std::array<std::size_t, kDigits + 1> first{};
    const auto digit = [&](std::uint32_t key) { return (key >> shift) & (kDigits - 1); };
    for (const std::uint32_t key : keys) ++first[digit(key) + 1];
    std::partial_sum(first.begin(), first.end(), first.begin());
    for (const std::uint32_t key : keys) moved[first[digit(key)]++] = key;
    std::swap(keys, moved);
  }
  std::vector<float> ascending(values.size());
  for (std::size_t i = 0; i < keys.size(); ++i)
    ascending[i] = std::bit_cast<float>((keys[i] & kSign) != 0 ? keys[i] & ~kSign : ~keys[i]);
  return ascending;
}

/// The lattice along one axis from the smallest distance of two columns. With fewer than two columns count is
/// 0 or 1.
Axis find_axis(const std::vector<float>& values, double same_mm) {
  const std::vector<float> ascending = sorted(values);
  double column = static_cast<double>(ascending.front());
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < ascending.size(); ++i) {
    const double gap = static_cast<double>(ascending[i]) - static_cast<double>(ascending[i - 1]);
    if (!(gap > same_mm)) continue;
    least = std::min(least, static_cast<double>(ascending[i]) - column);
    column = static_cast<double>(ascending[i]);
  }
  Axis axis;
  axis.low = static_cast<double>(ascending.front());
  const double extent = static_cast<double>(ascending.back()) - axis.low;
  if (!(extent > 0.0) || !(least <= extent)) return axis;
  const double cells = std::round(extent / least);
  if (!(cells < static_cast<double>(std::numeric_limits<std::int32_t>::max()))) return axis;
  axis.count = static_cast<std::size_t>(cells) + 1;
  axis.step = extent / cells;
  return axis;
}

/// The lattice axis of a raster from the first and last of a row or column.
Axis ends(double first, double last, std::size_t count) {
  return {std::min(first, last), std::abs(last - first) / static_cast<double>(count - 1), count};
}

struct Lattice {
  Axis x, y;
};

Lattice find_lattice(const Cloud& cloud) {
  const ScanRaster raster = cloud.raster.value_or(ScanRaster{});
  if (raster.columns >= 2 && raster.rows >= 2 && !raster.columns_wrap && !raster.rows_wrap) {
    const std::size_t columns = raster.columns, rows = raster.rows;
    const Vec3 first = cloud.local_mm(raster.index(0, 0)),
               along = cloud.local_mm(raster.index(0, columns - 1));
    const Vec3 across = cloud.local_mm(raster.index(rows - 1, 0));
    // A scanner may run along y and step in x.
    if (std::abs(along.x() - first.x()) >= std::abs(along.y() - first.y()))
      return {ends(first.x(), along.x(), columns), ends(first.y(), across.y(), rows)};
    return {ends(first.x(), across.x(), rows), ends(first.y(), along.y(), columns)};
  }
  const Vec3 extent = cloud.box_mm().extent_mm();
  const double spacing = std::sqrt(extent.x() * extent.y() / static_cast<double>(cloud.size()));
  return {find_axis(cloud.x_mm, kSameColumnShare * spacing),
          find_axis(cloud.y_mm, kSameColumnShare * spacing)};
}

/// Index of a coordinate on its axis; count if between two.
std::size_t place_on(const Axis& axis, float value) noexcept {
  const double exact = (static_cast<double>(value) - axis.low) / axis.step;
  const double nearest = std::round(exact);
  if (!(std::abs(exact - nearest) <= kLatticeShare) || !(nearest >= 0.0) ||
      !(nearest < static_cast<double>(axis.count)))
    return axis.count;
  return static_cast<std::size_t>(nearest);
}

}  // namespace

void update_block_maxima(HeightField& field) {
  const std::uint32_t across = field.block_columns(), down = (field.rows - 2) / HeightField::kBlock + 1;
  field.block_max_mm.assign(std::size_t{across} * down, -std::numeric_limits<float>::infinity());
  field.low_mm = std::numeric_limits<float>::infinity();
  field.high_mm = -field.low_mm;
  field.holes = 0;
  for (std::uint32_t row = 0; row < field.rows; ++row)
    for (std::uint32_t column = 0; column < field.columns; ++column) {
      const float height = field.height_mm[field.at(column, row)];
      if (!std::isfinite(height)) {
        ++field.holes;
        continue;
      }
      field.low_mm = std::min(field.low_mm, height);
      field.high_mm = std::max(field.high_mm, height);
      // A post on a block border belongs to the cells on both sides.
      const std::uint32_t first_x = (column == 0 ? 0 : column - 1) / HeightField::kBlock;
      const std::uint32_t first_y = (row == 0 ? 0 : row - 1) / HeightField::kBlock;
      const std::uint32_t last_x = std::min(column / HeightField::kBlock, across - 1);
      const std::uint32_t last_y = std::min(row / HeightField::kBlock, down - 1);
      for (std::uint32_t y = first_y; y <= last_y; ++y)
        for (std::uint32_t x = first_x; x <= last_x; ++x) {
          float& top = field.block_max_mm[std::size_t{y} * across + x];
          top = std::max(top, height);
        }
    }
}

Result<HeightField> height_field_of(const Cloud& cloud, std::vector<std::uint32_t>* point_of_post) {
  if (cloud.size() < 4)
    return no_lattice(fmt::format("{} points are fewer than two rows of two", cloud.size()));
  const auto [x, y] = find_lattice(cloud);
  if (x.count < 2 || y.count < 2 || !(x.step > 0.0) || !(y.step > 0.0))
    return no_lattice("its points do not span two rows and two columns");
  if (x.count > kMaxPostsPerPoint * cloud.size() / y.count)
    return no_lattice(
        fmt::format("{} points on {} x {} posts, most of them holes", cloud.size(), x.count, y.count));

  HeightField field;
  field.origin_mm = cloud.origin_mm + Vec3(x.low, y.low, 0.0);
  field.columns = static_cast<std::uint32_t>(x.count);
  field.rows = static_cast<std::uint32_t>(y.count);
  field.step_x_mm = x.step;
  field.step_y_mm = y.step;
  field.height_mm.assign(x.count * y.count, std::numeric_limits<float>::quiet_NaN());
  std::vector<std::uint32_t> own;
  std::vector<std::uint32_t>& point_at = point_of_post != nullptr ? *point_of_post : own;
  point_at.assign(x.count * y.count, kNoPoint);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::size_t column = place_on(x, cloud.x_mm[i]), row = place_on(y, cloud.y_mm[i]);
    if (column == x.count || row == y.count)
      return no_lattice(
          fmt::format("point {} stands between the posts of a {:.6g} x {:.6g} mm grid", i, x.step, y.step));
    std::uint32_t& first = point_at[row * x.count + column];
    // An exact repeat of a point is ignored. Any other point at an occupied post is an Error, whatever its
    // height: one far point can make the lattice so coarse that a plane falls on one post.
    if (first != kNoPoint && cloud.local_mm(first) != cloud.local_mm(i))
      return no_lattice(fmt::format("point {} is a second one at its place seen from above", i));
    first = static_cast<std::uint32_t>(i);
    field.height_mm[row * x.count + column] = cloud.z_mm[i];
  }
  update_block_maxima(field);
  if (const double thin = sparse_fraction(field); thin > kMaxSparseFraction)
    return no_lattice(fmt::format(
        "its {} points are strewn over a lattice of {} x {} posts: in {:.3g} % of the area fewer than one "
        "post in {} has one",
        cloud.size(), x.count, y.count, 100.0 * thin, kMaxPostsPerPoint));
  return field;
}

std::array<std::uint32_t, 3> BoxLattice::coordinates(std::size_t index) const noexcept {
  const std::size_t row = n_[0] + std::size_t{1};
  const std::size_t middle = (n_[2] - std::size_t{1}) * ring();
  const auto at = [](std::size_t i, std::size_t j, std::size_t k) {
    return std::array<std::uint32_t, 3>{static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j),
                                        static_cast<std::uint32_t>(k)};
  };
  if (index < full()) return at(index % row, index / row, 0);
  index -= full();
  if (index >= middle) {
    index -= middle;
    return at(index % row, index / row, n_[2]);
  }
  const std::size_t k = 1 + index / ring();
  index %= ring();
  if (index < row) return at(index, 0, k);
  index -= row;
  const std::size_t sides = 2 * (n_[1] - std::size_t{1});
  if (index < sides) return at(index % 2 == 0 ? 0 : n_[0], 1 + index / 2, k);
  return at(index - sides, n_[1], k);
}

std::uint32_t BoxLattice::index(std::uint32_t i, std::uint32_t j, std::uint32_t k) const noexcept {
  const std::size_t row = n_[0] + std::size_t{1};
  std::size_t at = 0;
  if (k == 0) {
    at = j * row + i;
  } else if (k == n_[2]) {
    at = full() + (n_[2] - std::size_t{1}) * ring() + j * row + i;
  } else {
    at = full() + (k - std::size_t{1}) * ring();
    if (j == 0) {
      at += i;
    } else if (j == n_[1]) {
      at += row + 2 * (n_[1] - std::size_t{1}) + i;
    } else {
      at += row + 2 * (j - std::size_t{1}) + (i == 0 ? 0 : 1);
    }
  }
  return static_cast<std::uint32_t>(at);
}

std::vector<std::array<std::uint32_t, 3>> BoxLattice::triangles() const {
  std::vector<std::array<std::uint32_t, 3>> found;
  const std::size_t nx = n_[0], ny = n_[1], nz = n_[2];
  found.reserve(4 * (nx * ny + ny * nz + nz * nx));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool high : {false, true})
      for (std::uint32_t b = 0; b < n_[v]; ++b)
        for (std::uint32_t a = 0; a < n_[u]; ++a) {
          const auto corner = [&](std::uint32_t da, std::uint32_t db) {
            std::array<std::uint32_t, 3> c{};
            c[axis] = high ? n_[axis] : 0;
            c[u] = a + da;
            c[v] = b + db;
            return index(c[0], c[1], c[2]);
          };
          const std::uint32_t p00 = corner(0, 0), p10 = corner(1, 0), p11 = corner(1, 1), p01 = corner(0, 1);
          if (high) {
            found.push_back({p00, p10, p11});
            found.push_back({p00, p11, p01});
          } else {
            found.push_back({p00, p11, p10});
            found.push_back({p00, p01, p11});
          }
        }
  }
  return found;
}

SphereRings::SphereRings(double radius_mm, double rim, double spacing_mm) {
  constexpr double kMinSpokes = 3.0;  // a ring of fewer encloses nothing
  const auto last = static_cast<std::size_t>(std::max(1.0, std::round(radius_mm * rim / spacing_mm)));
  first_ = {0, 1};
  for (std::size_t ring = 1; ring <= last; ++ring) {
    const double angle = rim * static_cast<double>(ring) / static_cast<double>(last);
    const double round_mm = 2.0 * std::numbers::pi * radius_mm * std::sin(angle);
    first_.push_back(first_.back() +
                     static_cast<std::size_t>(std::max(kMinSpokes, std::round(round_mm / spacing_mm))));
  }
}

SphereRings::Place SphereRings::place(std::size_t index) const noexcept {
  const auto next = std::upper_bound(first_.begin(), first_.end(), index);
  const auto ring = static_cast<std::size_t>(next - first_.begin()) - 1;
  return {static_cast<std::uint32_t>(ring), static_cast<std::uint32_t>(index - first_[ring]),
          static_cast<std::uint32_t>(first_[ring + 1] - first_[ring])};
}

std::vector<std::array<std::uint32_t, 3>> SphereRings::triangles() const {
  std::vector<std::array<std::uint32_t, 3>> found;
  for (std::size_t ring = 0; ring + 2 < first_.size(); ++ring) {
    const std::size_t inner = first_[ring + 1] - first_[ring], outer = first_[ring + 2] - first_[ring + 1];
    const auto in = [&](std::size_t i) { return static_cast<std::uint32_t>(first_[ring] + i % inner); };
    const auto out = [&](std::size_t i) { return static_cast<std::uint32_t>(first_[ring + 1] + i % outer); };
    // Walks both rings together; the one behind steps next. A ring of one point has no side.
    const std::size_t inner_steps = inner > 1 ? inner : 0;
    for (std::size_t i = 0, o = 0; i < inner_steps || o < outer;) {
      const bool step_out = i == inner_steps || (o < outer && (o + 1) * inner <= (i + 1) * outer);
      if (step_out) {
        found.push_back({in(i), out(o), out(o + 1)});
        ++o;
      } else {
        found.push_back({in(i), out(o), in(i + 1)});
        ++i;
      }
    }
  }
  return found;
}

}  // namespace palpate::cloud
