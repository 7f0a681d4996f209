#include "toolkit/local_delaunay/raster_stars.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/geometry/winding_number.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"

namespace palpate::local_delaunay {
namespace {

/// Largest share of points remade beside the raster's stars. Remade points are repaired together and query
/// their surroundings: at 3 % a third of the time is saved, at 18 % nothing.
constexpr std::uint64_t kLaidOutShare = 10;
/// Approximate most far-field parts: sixty points of a million are as flat as kPointsPerPart.
constexpr std::size_t kMaxRasterParts = 16384, kRasterPartsPerChunk = 256;

constexpr std::size_t kRowsPerChunk = 16;

/// Work on a point: none, check agreement again, or make a new star.
constexpr std::uint8_t kAsItIs = 0, kBeside = 1, kLaidOut = 2;

/// The eight surrounding positions, from the next column by way of the next row.
constexpr std::uint32_t kAround = 8;
constexpr std::array<std::array<int, 2>, kAround> kStepTo = {
    {{0, 1}, {1, 1}, {1, 0}, {1, -1}, {0, -1}, {-1, -1}, {-1, 0}, {-1, 1}}};

/// Marks with at least `mark` every point next to one that has at least `from`.
void mark_next(const RasterGrid& grid, std::uint8_t from, std::uint8_t mark, int threads,
               std::vector<std::uint8_t>& state) {
  const std::vector<std::uint8_t> before = state;
  const std::size_t columns = grid.columns();
  parallel_chunks(grid.rows(), kRowsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint8_t> most(columns);
    for (std::size_t r = begin; r < end; ++r) {
      const auto row = static_cast<std::uint32_t>(r);
      // The maximum over three rows per column, then over three columns.
      std::copy_n(before.begin() + static_cast<std::ptrdiff_t>(r * columns), columns, most.begin());
      for (const int down : {-1, 1})
        if (const std::uint32_t other = grid.row_beside(row, down); other != kNoPlace)
          for (std::size_t c = 0; c < columns; ++c) most[c] = std::max(most[c], before[other * columns + c]);
      for (std::uint32_t column = 0; column < columns; ++column) {
        std::uint8_t around = most[column];
        for (const int across : {-1, 1})
          if (const std::uint32_t other = grid.column_beside(column, across); other != kNoPlace)
            around = std::max(around, most[other]);
        std::uint8_t& here = state[r * columns + column];
        if (around >= from && here < mark) here = mark;
      }
    }
  });
}

/// Edges of the shortest border; none if it wraps both ways.
std::size_t shortest_border(const RasterGrid& grid) noexcept {
  const std::size_t rows = grid.rows(), columns = grid.columns();
  if (grid.rows_wrap() && grid.columns_wrap()) return rows * columns;
  if (grid.rows_wrap()) return rows;
  if (grid.columns_wrap()) return columns;
  return 2 * (rows + columns) - 4;
}

}  // namespace

std::optional<RasterStars> RasterStars::of(const cloud::Cloud& cloud, int threads) {
  std::optional<RasterGrid> grid = RasterGrid::of(cloud);
  if (!grid) return std::nullopt;
  RasterStars stars(*std::move(grid));
  stars.cells_ = cells_of(cloud, stars.grid_, threads);
  mark_overlaps(cloud, stars.grid_, threads, stars.cells_.doubtful);
  stars.mark_all(threads);
  if (kLaidOutShare * stars.laid_out_ > cloud.size()) return std::nullopt;
  return stars;
}

/// Points around a doubtful one are remade too, so no raster triangle has a doubtful corner.
void RasterStars::mark_all(int threads) {
  state_ = std::move(cells_.doubtful);
  const auto is_doubtful = [](std::uint8_t doubtful) { return doubtful != 0; };
  if (std::any_of(state_.begin(), state_.end(), is_doubtful)) {
    for (std::uint8_t& state : state_) state = state != 0 ? kLaidOut : kAsItIs;
    mark_next(grid_, kLaidOut, kLaidOut, threads, state_);
    mark_next(grid_, kLaidOut, kBeside, threads, state_);
    for (std::uint32_t row = 0; row < grid_.rows(); ++row)
      for (std::uint32_t column = 0; column < grid_.columns(); ++column)
        laid_out_ +=
            static_cast<std::uint64_t>(state_[std::size_t{row} * grid_.columns() + column] == kLaidOut &&
                                       grid_.point(row, column) != kNoPlace);
  }
  whole_ = laid_out_ == 0 && grid_.is_full() && shortest_border(grid_) > kMaxLoop;
}

void RasterStars::set_order(const std::vector<std::uint32_t>& order, int threads) {
  place_at_.assign(grid_.slots(), kNoPlace);
  slot_of_.resize(order.size());
  parallel_each(order.size(), kPointsPerChunk, threads, [&](std::size_t i) {
    slot_of_[i] = grid_.slot(order[i]);
    place_at_[slot_of_[i]] = static_cast<std::uint32_t>(i);
  });
}

Star RasterStars::star(std::uint32_t place) const noexcept {
  const std::uint32_t columns = grid_.columns();
  const std::uint32_t row = slot_of_[place] / columns, column = slot_of_[place] % columns;
  const std::array<std::uint32_t, 3> at_row = {grid_.row_beside(row, -1), row, grid_.row_beside(row, 1)};
  const std::array<std::uint32_t, 3> at_column = {grid_.column_beside(column, -1), column,
                                                  grid_.column_beside(column, 1)};
  Star star;
  std::uint32_t last = kAround;
  const auto stand = [&](std::uint32_t direction) {
    const auto& [down, across] = kStepTo[direction];
    const std::size_t r = at_row[static_cast<std::size_t>(down + 1)];
    star.ring[star.size++] = place_at_[r * columns + at_column[static_cast<std::size_t>(across + 1)]];
    last = direction;
  };
  std::uint32_t begun = kAround;
  const auto sector = [&](std::uint32_t from, std::uint32_t to) {
    if (last != from) {
      if (star.size > 0) star.open |= 1u << (star.size - 1);
      if (star.size == 0) begun = from;
      stand(from);
    }
    stand(to % kAround);
  };
  // The four cells around, from below and beside on. A cell's diagonal passes the point in every second one
  // when it goes down. kFirst, kSecond: the first triangle around the point, and the one it has when the
  // diagonal does not pass it.
  constexpr std::uint32_t kFirst = RasterCell::kFirst, kSecond = RasterCell::kSecond;
  struct Quarter {
    std::size_t row, column;
    bool down;
    std::uint32_t one, two, only;
  };
  constexpr std::array<Quarter, 4> kQuarters = {{{1, 1, true, kFirst, kSecond, kFirst},
                                                 {1, 0, false, kSecond, kFirst, kFirst},
                                                 {0, 0, true, kSecond, kFirst, kSecond},
                                                 {0, 1, false, kFirst, kSecond, kSecond}}};
  std::uint32_t from = 0;
  for (const Quarter& quarter : kQuarters) {
    const std::uint32_t r = at_row[quarter.row], c = at_column[quarter.column];
    const std::uint32_t first = std::exchange(from, from + 2);
    if (r == kNoPlace || c == kNoPlace) continue;
    const RasterCell& cell = cells_.at(grid_, r, c);
    if (cell.has(RasterCell::kDown) == quarter.down) {
      if (cell.has(quarter.one)) sector(first, first + 1);
      if (cell.has(quarter.two)) sector(first + 1, first + 2);
    } else if (cell.has(quarter.only)) {
      sector(first, first + 2);
    }
  }
  if (star.size == 0) return star;
  if (last == begun)
    --star.size;  // all around
  else
    star.open |= 1u << (star.size - 1);
  star.agreed = ((1u << star.size) - 1u) & ~star.open;
  return star;
}

RasterStars::Side RasterStars::side_of_whole(const CandidateTriangulation& candidate) const {
  const std::size_t n = candidate.size();
  const bool is_closed = grid_.rows_wrap() && grid_.columns_wrap();
  Side side;
  side.enclosure = is_closed ? VolumeEnclosure::kWhole : VolumeEnclosure::kOpen;
  if (!is_closed && candidate.both_sides) return side;
  const std::size_t size = std::max<std::size_t>(kPointsPerPart, n / kMaxRasterParts);
  std::vector<geometry::AreaElement> parts((n + size - 1) / size);
  std::vector<double> volume(parts.size(), 0.0);
  const auto visit = [&](std::size_t part) {
    const std::size_t first = part * size, last = std::min(first + size, n);
    Vec3 area = Vec3::Zero(), sum = Vec3::Zero();
    for (std::size_t i = first; i < last; ++i) {
      // Each point owns the cell below and beside it.
      const Vec3 own = 0.5 * cells_.cell[slot_of_[i]].area.cast<double>();
      const Vec3 at = candidate.at(static_cast<std::uint32_t>(i));
      area += own;
      sum += at;
      volume[part] += own.dot(at);
    }
    parts[part] = {(sum / static_cast<double>(last - first)).cast<float>(), area.cast<float>()};
  };
  parallel_each(parts.size(), kRasterPartsPerChunk, candidate.threads,
                [&](std::size_t part) { visit(part); });
  if (is_closed) {
    side.inward = std::accumulate(volume.begin(), volume.end(), 0.0) < 0.0;
    return side;
  }
  const float outer = geometry::normal_orientation(parts, candidate.threads);
  if (outer == 0.0F) return side;
  side.enclosure = VolumeEnclosure::kWithHoles;
  side.inward = outer < 0.0F;
  side.min_enclosed = 1.0 - geometry::opening_fraction(parts);
  return side;
}

Vec3f RasterStars::normal(std::uint32_t place) const noexcept {
  const std::uint32_t row = slot_of_[place] / grid_.columns(), column = slot_of_[place] % grid_.columns();
  Vec3 sum = Vec3::Zero();
  for (const std::uint32_t r : {row, grid_.row_beside(row, -1)})
    for (const std::uint32_t c : {column, grid_.column_beside(column, -1)})
      if (r != kNoPlace && c != kNoPlace) sum += cells_.at(grid_, r, c).area.cast<double>();
  const double size = sum.norm();
  return size > 0.0 ? Vec3f((sum / size).cast<float>()) : Vec3f(Vec3f::Zero());
}

/// Wanted places whose coordinates a point of lower index has too; a pile of them would fill all their
/// neighbours. Only wanted places can be duplicates, because zero-length edges and overlapping tiles are
/// doubtful.
std::vector<std::uint8_t> RasterStars::doubled_places(const CandidateTriangulation& candidate,
                                                      const std::vector<std::uint8_t>& wanted) const {
  std::vector<std::uint32_t> places;
  for (std::uint32_t i = 0; i < candidate.size(); ++i)
    if (wanted[i] != 0) places.push_back(i);
  const auto key = [&](std::uint32_t i) {
    const SortedPoint& p = candidate.point[i];
    return std::array<float, 3>{p.x_mm, p.y_mm, p.z_mm};
  };
  std::sort(places.begin(), places.end(), [&](std::uint32_t a, std::uint32_t b) {
    return key(a) != key(b) ? key(a) < key(b) : slot_of_[a] < slot_of_[b];
  });
  std::vector<std::uint8_t> duplicate(candidate.size(), 0);
  for (std::size_t k = 1; k < places.size(); ++k)
    if (key(places[k]) == key(places[k - 1])) duplicate[places[k]] = 1;
  return duplicate;
}

std::uint64_t RasterStars::fill(CandidateTriangulation& candidate) const {
  const std::size_t n = candidate.size();
  std::vector<std::uint8_t> wanted(n), asked(n);
  candidate.near.resize(n);
  candidate.normal.resize(n);
  candidate.star.resize(n);
  candidate.crossed.assign(n, 0);
  candidate.rough.assign(n, 0);
  parallel_each(n, kPointsPerChunk, candidate.threads, [&](std::size_t k) {
    const auto i = static_cast<std::uint32_t>(k);
    asked[i] = state_[slot_of_[i]];
    wanted[i] = static_cast<std::uint8_t>(asked[i] == kLaidOut);
    candidate.star.put(i, wanted[i] == 0 ? star(i) : Star{});
    candidate.normal[i] = normal(i);
  });
  nearest_from_stars(candidate);
  find_nearest_of(candidate, doubled_places(candidate, wanted), asked);
  make_stars_of(candidate, wanted, asked);
  return n - laid_out_;
}

}  // namespace palpate::local_delaunay
