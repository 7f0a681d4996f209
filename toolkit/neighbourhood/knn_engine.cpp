#include "toolkit/neighbourhood/knn_engine.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <mutex>
#include <nanoflann.hpp>
#include <numeric>

#include "toolkit/core/parallel.h"
#include "toolkit/core/tolerances.h"

namespace palpate::neighbourhood {
namespace {

/// Occupancy a cell should have: with six points of a surface in a cell of edge 2.4 spacings, the 3 x 3 x 3
/// block reaches past the eighth neighbour even where one direction is stretched by half, and holds about 54
/// candidates.
constexpr double kPointsPerCell = 6.0;
/// Cells with more points than this many are left to the tree: pairs within a cell grow with the square.
constexpr std::size_t kDenseCell = 256;
/// Levels tried on the grid, each with cells twice as large, before a point is left to the tree.
constexpr int kGridLevels = 3;
/// Points at one place that can matter to any point: itself and eight others.
constexpr std::size_t kSamePlace = kNeighbours + 1;
/// First lattice: its cubes' codes fit 32 bits, and it is enough to count occupied cells of most clouds
/// before refining.
constexpr double kFirstCubes = 1023.0;
/// Rounding of (p - low) * per_mm, a cell coordinate below 2^21: the block may be smaller by this share of a
/// cell.
constexpr double kCellRounding = 1e-9;
/// Kept candidates up to which ranks are counted pair by pair, without a branch to mispredict: a guess from
/// the point before keeps some fourteen. Beyond, eight places are filled by insertion.
constexpr std::size_t kMostRanked = 20;
/// Cells a parallel chunk, so that its table lookups stay in cache.
constexpr std::size_t kCellsPerChunk = 2048;
constexpr std::size_t kPlacesPerChunk = std::size_t{1} << 16;

/// Two doubles compared at once: compilers do not vectorise a comparison by themselves, since it might trap.
using Pair = double __attribute__((vector_size(16)));
using PairCount = std::int64_t __attribute__((vector_size(16)));

/// Occupied cells when the lowest `shift` bits of every code are ignored.
template <class Code>
std::size_t occupied(const std::vector<Code>& codes, int shift, int threads) {
  if (shift >= std::numeric_limits<Code>::digits) return codes.empty() ? 0 : 1;
  std::vector<std::size_t> parts((codes.size() + kPlacesPerChunk - 1) / kPlacesPerChunk);
  parallel_chunks(codes.size(), kPlacesPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::size_t cells = begin == 0 ? 1 : 0;
    for (std::size_t i = std::max<std::size_t>(begin, 1); i < end; ++i)
      cells += (codes[i] >> shift) != (codes[i - 1] >> shift);
    parts[begin / kPlacesPerChunk] = cells;
  });
  return std::accumulate(parts.begin(), parts.end(), std::size_t{0});
}

struct PlaceRange {
  std::uint32_t begin = 0, end = 0;
};
struct Cell {
  std::uint64_t code = 0;
  PlaceRange places;
};

/// The cells of sorted codes, in order.
std::vector<Cell> cells_of(const std::vector<std::uint64_t>& codes, int shift, int threads) {
  const std::size_t n = codes.size();
  std::vector<std::vector<Cell>> parts((n + kPlacesPerChunk - 1) / kPlacesPerChunk);
  parallel_chunks(n, kPlacesPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    // A chunk has the cells that begin in it, however far they reach.
    auto& mine = parts[begin / kPlacesPerChunk];
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint64_t code = codes[i] >> shift;
      if (i > 0 && (codes[i - 1] >> shift) == code) continue;
      mine.push_back({code, {static_cast<std::uint32_t>(i), 0}});
    }
  });
  std::vector<Cell> cells;
  for (const auto& part : parts) cells.insert(cells.end(), part.begin(), part.end());
  for (std::size_t c = 0; c < cells.size(); ++c)
    cells[c].places.end = c + 1 < cells.size() ? cells[c + 1].places.begin : static_cast<std::uint32_t>(n);
  return cells;
}

}  // namespace

/// A grid of cells over the sorted points: every cell is a range of places.
struct KnnEngine::Level {
  int shift = 0;  ///< code bits below a cell
  double cell_mm = 0.0;
  std::vector<Cell> cells;
  std::vector<Cell> slots;  ///< hash of cells; free where the range is empty
  int hash_shift = 0;

  Level(const partition::MortonOrder& sorted, const partition::Lattice& lattice, int level, int threads)
      : shift(3 * level), cell_mm(lattice.unit_mm * static_cast<double>(std::int64_t{1} << level)) {
    cells = cells_of(sorted.codes, shift, threads);
    const std::size_t size = std::bit_ceil(std::max<std::size_t>(2 * cells.size(), 2));
    slots.assign(size, Cell{});
    hash_shift = 64 - std::countr_zero(size);
    for (const Cell& cell : cells) {
      std::size_t at = slot(cell.code);
      while (slots[at].places.end != 0) at = (at + 1) & (size - 1);
      slots[at] = cell;
    }
  }
  [[nodiscard]] std::size_t slot(std::uint64_t code) const noexcept {
    return (code * 0x9E3779B97F4A7C15u) >> hash_shift;
  }
  /// Empty where no cell has that code.
  [[nodiscard]] PlaceRange find(std::uint64_t code) const noexcept {
    for (std::size_t at = slot(code); slots[at].places.end != 0; at = (at + 1) & (slots.size() - 1))
      if (slots[at].code == code) return slots[at].places;
    return {};
  }
};

/// A k-d tree over the candidates, for points whose neighbours the grid cannot give cheaply: outliers, and
/// cells crowded far beyond the rest of the cloud. Built on first use.
struct KnnEngine::Fallback {
  Candidates points;
  std::once_flag once;

  std::size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return static_cast<double>(axis == 0 ? points.x[i] : axis == 1 ? points.y[i] : points.z[i]);
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }

  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Fallback>, Fallback,
                                                   3, std::uint32_t>;
  std::unique_ptr<Tree> tree;
};

/// What a pass over the points leaves: places that no candidates were enough for, and the builder's sums.
struct KnnEngine::Pass {
  std::mutex gate;
  std::vector<std::uint32_t> rejected;
  std::array<std::uint64_t, 3> sums{};
  void merge(const std::vector<std::uint32_t>& more, const Scratch& scratch) {
    const std::lock_guard lock(gate);
    rejected.insert(rejected.end(), more.begin(), more.end());
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += scratch.sums[k];
  }
};

namespace {

/// The rough keys are floats: three differences, squared and summed, each rounded, and the limit rounded
/// once. Eight roundings are bounded by nine units; squares below the smallest float vanish, hence the floor.
constexpr double kRoughRoom = 1.0 + 9.0 * 2.0 * kUnitRoundoffFloat;
constexpr double kRoughFloor = std::numeric_limits<float>::min();

float rough_limit(double limit) noexcept {
  const double wide = limit * kRoughRoom + kRoughFloor;
  return wide < static_cast<double>(std::numeric_limits<float>::max())
             ? static_cast<float>(wide)
             : std::numeric_limits<float>::infinity();
}

/// Positions of the rough keys up to the limit, without a branch.
void sieve(float limit, Scratch& scratch) {
  const std::size_t n = scratch.rough.size();
  scratch.kept.resize(n);
  const float* rough = scratch.rough.data();
  std::uint32_t* kept = scratch.kept.data();
  std::size_t count = 0;
  for (std::size_t i = 0; i < n; ++i) {
    kept[count] = static_cast<std::uint32_t>(i);
    count += static_cast<std::size_t>(rough[i] <= limit);
  }
  scratch.kept.resize(count);
  scratch.key.resize(count);
}

}  // namespace

void keep_ball(const Candidates& candidates, const Vec3& p, double limit_sq_mm2, Scratch& scratch) {
  const std::size_t n = candidates.size();
  scratch.rough.resize(n);
  const float *x = candidates.x.data(), *y = candidates.y.data(), *z = candidates.z.data();
  // The points' own coordinates are floats.
  const auto px = static_cast<float>(p.x()), py = static_cast<float>(p.y()), pz = static_cast<float>(p.z());
  float* rough = scratch.rough.data();
  for (std::size_t i = 0; i < n; ++i) {
    const float dx = x[i] - px, dy = y[i] - py, dz = z[i] - pz;
    rough[i] = dx * dx + dy * dy + dz * dz;
  }
  sieve(rough_limit(limit_sq_mm2), scratch);
  for (std::size_t k = 0; k < scratch.kept.size(); ++k) {
    const std::uint32_t i = scratch.kept[k];
    const double dx = static_cast<double>(x[i]) - p.x(), dy = static_cast<double>(y[i]) - p.y(),
                 dz = static_cast<double>(z[i]) - p.z();
    scratch.key[k] = dx * dx + dy * dy + dz * dz;
  }
}

void keep_cube(const Candidates& candidates, const Vec3& p, double half_mm, Scratch& scratch) {
  const std::size_t n = candidates.size();
  scratch.rough.resize(n);
  const float *x = candidates.x.data(), *y = candidates.y.data(), *z = candidates.z.data();
  const auto px = static_cast<float>(p.x()), py = static_cast<float>(p.y()), pz = static_cast<float>(p.z());
  float* rough = scratch.rough.data();
  for (std::size_t i = 0; i < n; ++i) {
    const float xy = std::max(std::abs(x[i] - px), std::abs(y[i] - py));
    rough[i] = std::max(xy, std::abs(z[i] - pz));
  }
  sieve(rough_limit(half_mm), scratch);
  for (std::size_t k = 0; k < scratch.kept.size(); ++k) {
    const std::uint32_t i = scratch.kept[k];
    const double xy =
        std::max(std::abs(static_cast<double>(x[i]) - p.x()), std::abs(static_cast<double>(y[i]) - p.y()));
    scratch.key[k] = std::max(xy, std::abs(static_cast<double>(z[i]) - p.z()));
  }
}

double choose_eight(std::uint32_t self, const Candidates& candidates, const Scratch& scratch,
                    Neighbours& out) noexcept {
  if (scratch.kept.size() > kMostRanked) {
    BestEight best;
    for (std::size_t k = 0; k < scratch.kept.size(); ++k) {
      const std::uint32_t index = candidates.index[scratch.kept[k]];
      if (scratch.key[k] <= best.worst() && index != self) best.offer(scratch.key[k], index);
    }
    best.store(self, out);
    return best.worst();
  }
  // Each one's rank is the number of smaller keys: a fixed number of comparisons and no branch, so that they
  // run side by side. Unused places hold infinity, which comes before nothing.
  std::array<double, kMostRanked> key;
  std::array<std::uint32_t, kMostRanked> index;
  key.fill(kEverything);
  std::size_t n = 0;
  for (std::size_t k = 0; k < scratch.kept.size(); ++k) {
    const std::uint32_t candidate = candidates.index[scratch.kept[k]];
    index[n] = candidate;
    key[n] = candidate != self ? scratch.key[k] : kEverything;
    n += static_cast<std::size_t>(candidate != self);
  }
  std::array<double, kMostRanked + 1> sorted;
  std::array<std::uint32_t, kMostRanked + 1> order;
  std::uint32_t taken = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double own = key[i];
    const Pair both = {own, own};
    PairCount smaller = {0, 0};
    for (std::size_t j = 0; j < kMostRanked; j += 2)
      smaller -= Pair{key[j], key[j + 1]} < both;  // true is -1
    auto rank = static_cast<std::size_t>(smaller[0] + smaller[1]);
    while ((taken >> rank & 1u) != 0) ++rank;  // equal keys stand in a row
    taken |= 1u << rank;
    sorted[rank] = own;
    order[rank] = index[i];
  }
  // Now equal keys by index; they are rare, and then few.
  for (std::size_t i = 1; i < n; ++i)
    for (std::size_t j = i; j > 0 && sorted[j - 1] == sorted[j] && order[j - 1] > order[j]; --j)
      std::swap(order[j - 1], order[j]);
  for (std::size_t k = 0; k < kNeighbours; ++k) out[k] = k < n ? order[k] : self;
  return n < kNeighbours ? kEverything : sorted[kNeighbours - 1];
}

KnnEngine::~KnnEngine() = default;

KnnEngine::KnnEngine(const cloud::Cloud& cloud, int threads)
    : cloud_(cloud), threads_(threads), fallback_(std::make_unique<Fallback>()) {
  find_lattice();
  limit_piles();
  copy_places();
}

void KnnEngine::find_lattice() {
  const geometry::Aabb box = partition::local_box(cloud_, threads_);
  const double extent = box.extent_mm().maxCoeff();
  const auto n = static_cast<double>(cloud_.size());
  // The first level with at least the wanted points a cell.
  const auto level_of = [&](const auto& codes) {
    int level = 0;
    while (level < partition::kMortonBits &&
           n < kPointsPerCell * static_cast<double>(occupied(codes, 3 * level, threads_)))
      ++level;
    return level;
  };
  // Two looks: a first lattice tells the occupancy, the second has cells of the wanted size. A single place
  // has no extent; any unit serves.
  double unit = 1.0;
  if (extent > 0.0) {
    const partition::Lattice coarse = partition::Lattice::over(box, extent / kFirstCubes);
    const std::vector<std::uint32_t> codes = partition::sorted_coarse_codes(cloud_, coarse, threads_);
    const int level = level_of(codes);
    // Of a surface, points a cell grow with the square of the edge.
    const double points = n / static_cast<double>(occupied(codes, 3 * level, threads_));
    const double wanted =
        coarse.unit_mm * static_cast<double>(std::int64_t{1} << level) * std::sqrt(kPointsPerCell / points);
    // One level below stays in the lattice, for a cloud denser than the first look could tell.
    if (wanted > 0.0) unit = 0.5 * wanted;
  }
  lattice_ = partition::Lattice::over(box, unit);
  sorted_ = partition::sort_by_morton(cloud_, lattice_, threads_);
  first_level_ = level_of(sorted_.codes);
  const double edge = lattice_.unit_mm * static_cast<double>(std::int64_t{1} << first_level_);
  mean_spacing_mm_ =
      edge / std::sqrt(n / static_cast<double>(occupied(sorted_.codes, 3 * first_level_, threads_)));
}

/// More than nine points at one place: only the nine of lowest index are candidates. Equal points have equal
/// codes.
void KnnEngine::limit_piles() {
  const std::size_t n = cloud_.size();
  const auto at = [&](std::uint32_t i) { return std::array{cloud_.x_mm[i], cloud_.y_mm[i], cloud_.z_mm[i]}; };
  std::vector<std::uint32_t> run;
  for (std::size_t begin = 0; begin < n;) {
    std::size_t end = begin + 1;
    while (end < n && sorted_.codes[end] == sorted_.codes[begin]) ++end;
    if (end - begin > kSamePlace) {
      run.assign(sorted_.order.begin() + static_cast<std::ptrdiff_t>(begin),
                 sorted_.order.begin() + static_cast<std::ptrdiff_t>(end));
      std::sort(run.begin(), run.end(),
                [&](std::uint32_t a, std::uint32_t b) { return at(a) != at(b) ? at(a) < at(b) : a < b; });
      std::size_t same = 0;
      if (candidate_.empty()) candidate_.assign(n, 1);
      for (std::size_t i = 0; i < run.size(); ++i) {
        same = i > 0 && at(run[i]) == at(run[i - 1]) ? same + 1 : 1;
        sorted_.order[begin + i] = run[i];
        candidate_[begin + i] = same <= kSamePlace;
      }
    }
    begin = end;
  }
}

void KnnEngine::copy_places() {
  const std::size_t n = cloud_.size();
  places_.resize(n);
  parallel_chunks(n, kPlacesPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
    for (std::size_t place = begin; place < end; ++place) {
      const std::uint32_t i = sorted_.order[place];
      places_.x[place] = cloud_.x_mm[i];
      places_.y[place] = cloud_.y_mm[i];
      places_.z[place] = cloud_.z_mm[i];
      places_.index[place] = i;
    }
  });
}

bool KnnEngine::gather(const Level& level, const std::array<std::int64_t, 3>& at,
                       Candidates& candidates) const {
  std::array<PlaceRange, 27> block;
  std::size_t found = 0, held = 0;
  // A code is the sum of one part an axis: nine parts make the 27.
  std::array<std::array<std::uint64_t, 3>, 3> part{};
  std::array<std::array<bool, 3>, 3> inside{};
  const std::int64_t last = (std::int64_t{1} << partition::kMortonBits) - 1;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int64_t c = at[axis] + static_cast<std::int64_t>(k) - 1;
      inside[axis][k] = c >= 0 && c <= last;
      const auto u = static_cast<std::uint32_t>(std::clamp<std::int64_t>(c, 0, last));
      part[axis][k] = partition::morton_code(axis == 0 ? u : 0, axis == 1 ? u : 0, axis == 2 ? u : 0);
    }
  for (std::size_t z = 0; z < 3; ++z)
    for (std::size_t y = 0; y < 3; ++y)
      for (std::size_t x = 0; x < 3; ++x) {
        if (!inside[0][x] || !inside[1][y] || !inside[2][z]) continue;
        const PlaceRange range = level.find(part[0][x] | part[1][y] | part[2][z]);
        if (range.begin == range.end) continue;
        block[found++] = range;
        held += range.end - range.begin;
      }
  if (held > kDenseCell * block.size()) return false;
  candidates.resize(held);
  std::size_t count = 0;
  for (std::size_t b = 0; b < found; ++b) {
    if (candidate_.empty()) {
      candidates.copy(count, places_, block[b].begin, block[b].end);
      count += block[b].end - block[b].begin;
    } else {
      for (std::uint32_t place = block[b].begin; place < block[b].end; ++place)
        if (candidate_[place] != 0) candidates.copy(count++, places_, place, place + 1);
    }
  }
  candidates.resize(count);
  return true;
}

void KnnEngine::run_level(const Level& level, const Choose& choose, NeighbourTable& table, Pass& pass,
                          std::span<const std::uint8_t> pending) const {
  parallel_chunks(level.cells.size(), kCellsPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
    Candidates candidates;
    Scratch scratch;
    std::vector<std::uint32_t> mine;
    for (std::size_t c = begin; c < end; ++c) {
      const Cell& cell = level.cells[c];
      bool any = pending.empty();
      for (std::uint32_t place = cell.places.begin; place < cell.places.end && !any; ++place)
        any = pending[place] != 0;
      if (!any) continue;
      const Vec3 somewhere = cloud_.local_mm(sorted_.order[cell.places.begin]);
      std::array<std::int64_t, 3> at;
      for (std::size_t axis = 0; axis < 3; ++axis)
        at[axis] = lattice_.coordinate(somewhere[static_cast<int>(axis)], static_cast<int>(axis)) >>
                   (level.shift / 3);
      const bool crowded = cell.places.end - cell.places.begin > kDenseCell || !gather(level, at, candidates);
      const Vec3 low(lattice_.low_mm + level.cell_mm * Vec3(static_cast<double>(at[0]),
                                                            static_cast<double>(at[1]),
                                                            static_cast<double>(at[2])));
      for (std::uint32_t place = cell.places.begin; place < cell.places.end; ++place) {
        if (!pending.empty() && pending[place] == 0) continue;
        const std::uint32_t self = sorted_.order[place];
        const Vec3 p = cloud_.local_mm(self);
        const Vec3 into = p - low;
        // Everything closer than the nearest face of the block is in it.
        const double radius = level.cell_mm * (1.0 - kCellRounding) +
                              std::min(into.minCoeff(), level.cell_mm - into.maxCoeff());
        if (crowded || !choose(self, p, candidates, radius, table.of[self], scratch)) mine.push_back(place);
      }
    }
    pass.merge(mine, scratch);
  });
}

std::array<std::uint64_t, 3> KnnEngine::run(const Choose& choose, NeighbourTable& table,
                                            std::span<const std::uint8_t> wanted) const {
  const std::size_t n = cloud_.size();
  table.of.resize(n);
  Pass pass;
  std::vector<std::uint8_t> pending;
  if (!wanted.empty()) {
    pending.resize(n);
    for (std::size_t place = 0; place < n; ++place) pending[place] = wanted[sorted_.order[place]];
  }
  for (int step = 0; step < kGridLevels; ++step) {
    const int level = first_level_ + step;
    if (level > partition::kMortonBits) break;
    pass.rejected.clear();
    run_level(Level(sorted_, lattice_, level, threads_), choose, table, pass, pending);
    if (pass.rejected.empty()) return pass.sums;
    pending.assign(n, 0);
    for (const std::uint32_t place : pass.rejected) pending[place] = 1;
  }
  run_tree(choose, table, pass);
  return pass.sums;
}

void KnnEngine::run_tree(const Choose& choose, NeighbourTable& table, Pass& pass) const {
  std::sort(pass.rejected.begin(), pass.rejected.end());
  std::call_once(fallback_->once, [&] {
    Candidates& points = fallback_->points;
    points.resize(cloud_.size());
    std::size_t count = 0;
    for (std::size_t place = 0; place < cloud_.size(); ++place)
      if (candidate_.empty() || candidate_[place] != 0) points.copy(count++, places_, place, place + 1);
    points.resize(count);
    fallback_->tree = std::make_unique<Fallback::Tree>(3, *fallback_);
  });
  const Fallback& fallback = *fallback_;
  constexpr std::size_t kQueriesPerChunk = 256;
  parallel_chunks(pass.rejected.size(), kQueriesPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
    Candidates candidates;
    Scratch scratch;
    std::vector<std::pair<std::uint32_t, double>> hits;
    for (std::size_t r = begin; r < end; ++r) {
      const std::uint32_t self = sorted_.order[pass.rejected[r]];
      const Vec3 p = cloud_.local_mm(self);
      // The eighth other point bounds every radius that a builder asks for first; later ones double it.
      std::array<std::uint32_t, kSamePlace> near{};
      std::array<double, kSamePlace> near_sq{};
      const std::size_t got = fallback.tree->knnSearch(p.data(), kSamePlace, near.data(), near_sq.data());
      double radius = got == 0 ? 0.0 : std::sqrt(near_sq[got - 1]) * 2.0;
      for (bool whole = false;;) {
        // nanoflann's radius is squared and exclusive.
        hits.clear();
        nanoflann::SearchParams unsorted;
        unsorted.sorted = false;
        fallback.tree->radiusSearch(p.data(), 3.0 * radius * radius * (1.0 + 1e-12) + 1e-300, hits, unsorted);
        whole = hits.size() == fallback.points.size();
        candidates.resize(hits.size());
        for (std::size_t k = 0; k < hits.size(); ++k)
          candidates.copy(k, fallback.points, hits[k].first, hits[k].first + std::size_t{1});
        // The ball of radius sqrt(3) r covers the cube of half edge r.
        const double covered = whole ? std::numeric_limits<double>::infinity() : radius;
        if (choose(self, p, candidates, covered, table.of[self], scratch) || whole) break;
        radius = radius > 0.0 ? 2.0 * radius : mean_spacing_mm_;
      }
    }
    pass.merge({}, scratch);
  });
}

}  // namespace palpate::neighbourhood
