#include "toolkit/search/knn_engine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <mutex>
#include <nanoflann.hpp>
#include <numeric>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/simd.h"
#include "toolkit/search/morton_order.h"

namespace palpate::search {
namespace {

/// Points per cell: six surface points in a cell of 2.4 spacings make a 3 x 3 x 3 block reach past the eighth
/// neighbour, even stretched by half in one direction, with about 54 candidates.
constexpr double kPointsPerCell = 6.0;
/// Searched cells may hold fewer: levels differ by a factor of four, and 24 points a cell would cost more
/// than the few points that cells with four cannot serve.
constexpr double kMinPerCell = 4.0;
/// Families and blocks with more points than this a cell go to the tree, because pairs within a cell grow
/// quadratically.
constexpr std::size_t kDenseCell = 256;
constexpr std::size_t kDenseFamily = 4 * kDenseCell;
constexpr std::size_t kDenseBlock = 27 * kDenseCell;
/// Grid levels tried, each with cells twice as large, before a point goes to the tree.
constexpr int kGridLevels = 3;
/// Coincident points that can matter: itself and eight others.
constexpr std::size_t kSamePlace = kNeighbours + 1;
/// First lattice: its codes fit 32 bits, and it suffices to count occupied cells of most clouds.
constexpr double kFirstCubes = 1023.0;
/// Rounding of (p - low) * per_mm, below 2^21: the block shrinks by this share of a cell.
constexpr double kCellRounding = 1e-9;
/// Families per chunk: some 12,000 points, whose look-ups stay in cache.
constexpr std::size_t kFamiliesPerChunk = 512;
constexpr std::size_t kPlacesPerChunk = std::size_t{1} << 16;

/// Number of occupied cells if the lowest `shift` bits of codes are ignored.
template <class Code>
std::size_t occupied(const std::vector<Code>& codes, int shift, int threads) {
  if (shift >= std::numeric_limits<Code>::digits) return codes.empty() ? 0 : 1;
  const auto parts = parallel_parts<std::size_t>(
      codes.size(), kPlacesPerChunk, threads, [&](std::size_t i, std::size_t& cells) {
        cells += i == 0 || (codes[i] >> shift) != (codes[i - 1] >> shift);
      });
  return std::accumulate(parts.begin(), parts.end(), std::size_t{0});
}

/// Eight sibling cells, one cell of the level above; their points are consecutive places.
struct Family {
  std::uint64_t code = 0;
  std::array<std::uint32_t, 9> begin{};  ///< by sibling (the code's three lowest bits), then the end
  [[nodiscard]] std::uint32_t first() const noexcept { return begin[0]; }
  [[nodiscard]] std::uint32_t end() const noexcept { return begin[8]; }
  [[nodiscard]] std::size_t size() const noexcept { return end() - first(); }
};

/// The families of sorted codes, in order. `shift`: code bits below a cell.
std::vector<Family> families_of(const std::vector<std::uint64_t>& codes, int shift, int threads) {
  const std::size_t n = codes.size();
  const auto visit = [&](std::size_t begin, std::size_t end, std::vector<Family>& mine) {
    // A chunk owns the families that begin in it.
    std::size_t i = begin;
    while (i > 0 && i < n && codes[i] >> (shift + 3) == codes[i - 1] >> (shift + 3)) ++i;
    while (i < end) {
      Family family;
      family.code = codes[i] >> (shift + 3);
      std::size_t sibling = 0;
      for (; i < n && codes[i] >> (shift + 3) == family.code; ++i)
        for (const std::size_t at = codes[i] >> shift & 7u; sibling <= at; ++sibling)
          family.begin[sibling] = static_cast<std::uint32_t>(i);
      for (; sibling < family.begin.size(); ++sibling) family.begin[sibling] = static_cast<std::uint32_t>(i);
      mine.push_back(family);
    }
  };
  return parallel_list<Family>(n, kPlacesPerChunk, threads, visit);
}

/// Siblings of an adjacent family that touch this one, as ranges of begin[].
struct Touching {
  std::array<std::array<std::uint8_t, 2>, 4> range{};
  std::size_t count = 0;
};

/// Indexed by x + 3 y + 9 z of the family in the 3 x 3 x 3 neighbourhood.
constexpr std::array<Touching, 27> kTouching = [] {
  std::array<Touching, 27> all{};
  for (unsigned where = 0; where < all.size(); ++where) {
    const unsigned place[3] = {where % 3, where / 3 % 3, where / 9};
    Touching& here = all[where];
    for (std::uint8_t sibling = 0; sibling < 8; ++sibling) {
      bool touches = true;
      for (unsigned axis = 0; axis < 3; ++axis) {
        const unsigned half = sibling >> axis & 1u;
        touches = touches && (place[axis] == 1 || (place[axis] == 0) == (half == 1));
      }
      if (!touches) continue;
      const auto next = static_cast<std::uint8_t>(sibling + 1);
      if (here.count > 0 && here.range[here.count - 1][1] == sibling)
        here.range[here.count - 1][1] = next;
      else
        here.range[here.count++] = {sibling, next};
    }
  }
  return all;
}();

}  // namespace

/// A grid of cells over the sorted points: every cell is a range of places.
struct KnnEngine::Level {
  int level = 0;  ///< of the cells; families are one above
  double cell_mm = 0.0;
  std::vector<Family> families;
  MortonCellTable table;  ///< of families

  Level(const MortonOrder& sorted, const Lattice& lattice, int cell_level, int threads)
      : level(cell_level),
        cell_mm(lattice.unit_mm * static_cast<double>(std::int64_t{1} << cell_level)),
        families(families_of(sorted.codes, 3 * cell_level, threads)) {
    std::vector<std::uint64_t> codes(families.size());
    std::transform(families.begin(), families.end(), codes.begin(), [](const Family& f) { return f.code; });
    table.build(codes);
  }
  /// Null if no family has that code.
  [[nodiscard]] const Family* find(std::uint64_t code) const noexcept {
    const std::uint32_t found = table.find(code);
    return found == MortonCellTable::kNone ? nullptr : &families[found];
  }
};

/// A k-d tree over the candidates, for outliers and overcrowded cells. Built on first use.
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

/// Result of a pass: places without enough candidates, and the builder's sums.
struct KnnEngine::Pass {
  std::mutex gate;
  std::vector<std::uint32_t> rejected;
  std::array<std::uint64_t, 3> sums{};
  void merge(const std::vector<std::uint32_t>& more, const KnnScratch& scratch) {
    const std::lock_guard lock(gate);
    rejected.insert(rejected.end(), more.begin(), more.end());
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += scratch.sums[k];
  }
};

KnnEngine::~KnnEngine() = default;

KnnEngine::KnnEngine(const cloud::Cloud& cloud, int threads)
    : cloud_(cloud), threads_(threads), fallback_(std::make_unique<Fallback>()) {
  find_lattice();
  limit_piles();
  copy_places();
}

void KnnEngine::find_lattice() {
  const geometry::Aabb box = search::local_box(cloud_, threads_);
  const double extent = box.extent_mm().maxCoeff();
  const auto n = static_cast<double>(cloud_.size());
  // The first level with at least the wanted points per cell.
  const auto level_of = [&](const auto& codes) {
    int level = 0;
    while (level < search::kMortonBits &&
           n < kPointsPerCell * static_cast<double>(occupied(codes, 3 * level, threads_)))
      ++level;
    return level;
  };
  // Two rounds: a first lattice measures the occupancy, the second has cells of the wanted size. For a single
  // place any unit works.
  double unit = 1.0;
  if (extent > 0.0) {
    const search::Lattice coarse = search::Lattice::over(box, extent / kFirstCubes);
    const std::vector<std::uint32_t> codes = search::sorted_coarse_codes(cloud_, coarse, threads_);
    const int level = level_of(codes);
    // A surface's points per cell grow with the squared edge.
    const double points = n / static_cast<double>(occupied(codes, 3 * level, threads_));
    const double wanted =
        coarse.unit_mm * static_cast<double>(std::int64_t{1} << level) * std::sqrt(kPointsPerCell / points);
    // One level below stays in the lattice, for denser clouds than the first round resolved.
    if (wanted > 0.0) unit = 0.5 * wanted;
  }
  lattice_ = search::Lattice::over(box, unit);
  sorted_ = search::sort_by_morton(cloud_, lattice_, threads_);
  const int first_level = level_of(sorted_.codes);
  const double edge = lattice_.unit_mm * static_cast<double>(std::int64_t{1} << first_level);
  mean_spacing_mm_ =
      edge / std::sqrt(n / static_cast<double>(occupied(sorted_.codes, 3 * first_level, threads_)));
  // Families are one level above.
  search_level_ = std::min(first_level, search::kMortonBits - 1);
  const auto enough = [&](int level) {
    return n >= kMinPerCell * static_cast<double>(occupied(sorted_.codes, 3 * level, threads_));
  };
  while (search_level_ > 0 && enough(search_level_ - 1)) --search_level_;
}

/// Of coincident points only the nine of lowest index are candidates. They have equal codes.
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
  places_.make_room(n);
  places_.close(n);
  parallel_each(n, kPlacesPerChunk, threads_, [&](std::size_t place) {
    const std::uint32_t i = sorted_.order[place];
    places_.x[place] = cloud_.x_mm[i];
    places_.y[place] = cloud_.y_mm[i];
    places_.z[place] = cloud_.z_mm[i];
    places_.index[place] = i;
  });
  release_memory(sorted_.order);
}

namespace {

void copy_one(const Candidates& from, std::size_t place, Candidates& to, std::size_t at) noexcept {
  to.x[at] = from.x[place];
  to.y[at] = from.y[place];
  to.z[at] = from.z[place];
  to.index[at] = from.index[place];
}

/// Copies n places in whole steps; reads and writes up to a step more.
void copy_steps(const Candidates& from, std::size_t begin, std::size_t n, Candidates& to,
                std::size_t at) noexcept {
  for (std::size_t k = 0; k < n; k += kLanes) {
    std::memcpy(to.x.data() + at + k, from.x.data() + begin + k, kLanes * sizeof(float));
    std::memcpy(to.y.data() + at + k, from.y.data() + begin + k, kLanes * sizeof(float));
    std::memcpy(to.z.data() + at + k, from.z.data() + begin + k, kLanes * sizeof(float));
    std::memcpy(to.index.data() + at + k, from.index.data() + begin + k, kLanes * sizeof(std::uint32_t));
  }
}

}  // namespace

bool KnnEngine::gather(const Level& level, const std::array<std::int64_t, 3>& at,
                       Candidates& candidates) const {
  struct Range {
    std::uint32_t begin, end;
  };
  std::array<Range, 64> block;
  std::size_t found = 0, held = 0;
  // A code is a sum of one part per axis: nine parts make the 27.
  std::array<std::array<std::uint64_t, 3>, 3> part{};
  std::array<std::array<bool, 3>, 3> inside{};
  const std::int64_t last = (std::int64_t{1} << search::kMortonBits) - 1;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int64_t c = at[axis] + static_cast<std::int64_t>(k) - 1;
      inside[axis][k] = c >= 0 && c <= last;
      const auto u = static_cast<std::uint32_t>(std::clamp<std::int64_t>(c, 0, last));
      part[axis][k] = search::morton_code(u, 0, 0) << axis;
    }
  std::size_t where = 0;
  for (std::size_t z = 0; z < 3; ++z)
    for (std::size_t y = 0; y < 3; ++y)
      for (std::size_t x = 0; x < 3; ++x, ++where) {
        if (!inside[0][x] || !inside[1][y] || !inside[2][z]) continue;
        const Family* family = level.find(part[0][x] | part[1][y] | part[2][z]);
        if (family == nullptr) continue;
        const Touching& touching = kTouching[where];
        for (std::size_t r = 0; r < touching.count; ++r) {
          const Range range = {family->begin[touching.range[r][0]], family->begin[touching.range[r][1]]};
          block[found] = range;
          found += static_cast<std::size_t>(range.begin != range.end);
          held += range.end - range.begin;
        }
      }
  if (held > kDenseBlock) return false;
  candidates.make_room(held);
  std::size_t count = 0;
  for (std::size_t b = 0; b < found; ++b) {
    if (candidate_.empty()) {
      copy_steps(places_, block[b].begin, block[b].end - block[b].begin, candidates, count);
      count += block[b].end - block[b].begin;
    } else {
      for (std::uint32_t place = block[b].begin; place < block[b].end; ++place)
        if (candidate_[place] != 0) copy_one(places_, place, candidates, count++);
    }
  }
  candidates.close(count);
  return true;
}

void KnnEngine::run_level(const Level& level, const NeighbourChooser& choose, NeighbourTable& table,
                          Pass& pass, std::span<const std::uint8_t> pending) const {
  const double family_mm = 2.0 * level.cell_mm;
  parallel_chunks(
      level.families.size(), kFamiliesPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
        Candidates candidates;
        KnnScratch scratch;
        std::vector<std::uint32_t> mine;
        for (std::size_t f = begin; f < end; ++f) {
          const Family& family = level.families[f];
          bool any = pending.empty();
          for (std::uint32_t place = family.first(); place < family.end() && !any; ++place)
            any = pending[place] != 0;
          if (!any) continue;
          const Vec3 somewhere = local_at(family.first());
          std::array<std::int64_t, 3> at;
          for (std::size_t axis = 0; axis < 3; ++axis)
            at[axis] = lattice_.coordinate(somewhere[static_cast<int>(axis)], static_cast<int>(axis)) >>
                       (level.level + 1);
          const bool crowded = family.size() > kDenseFamily || !gather(level, at, candidates);
          const Vec3 low(lattice_.low_mm + family_mm * Vec3(static_cast<double>(at[0]),
                                                            static_cast<double>(at[1]),
                                                            static_cast<double>(at[2])));
          for (std::uint32_t place = family.first(); place < family.end(); ++place) {
            if (!pending.empty() && pending[place] == 0) continue;
            const std::uint32_t self = places_.index[place];
            const Vec3 p = local_at(place);
            const Vec3 into = p - low;
            // The block extends one cell past the family and holds everything nearer than its nearest face.
            const double radius = level.cell_mm * (1.0 - kCellRounding) +
                                  std::min(into.minCoeff(), family_mm - into.maxCoeff());
            if (crowded || !choose(self, p, candidates, radius, table.of[self], scratch))
              mine.push_back(place);
          }
        }
        pass.merge(mine, scratch);
      });
}

std::array<std::uint64_t, 3> KnnEngine::run(const NeighbourChooser& choose, NeighbourTable& table,
                                            std::span<const std::uint8_t> wanted) const {
  const std::size_t n = cloud_.size();
  table.of.resize(n);
  Pass pass;
  std::vector<std::uint8_t> pending;
  if (!wanted.empty()) {
    pending.resize(n);
    for (std::size_t place = 0; place < n; ++place) pending[place] = wanted[places_.index[place]];
  }
  for (int step = 0; step < kGridLevels; ++step) {
    const int level = search_level_ + step;
    if (level + 1 > search::kMortonBits) break;  // families are one level above
    pass.rejected.clear();
    run_level(Level(sorted_, lattice_, level, threads_), choose, table, pass, pending);
    if (pass.rejected.empty()) return pass.sums;
    pending.assign(n, 0);
    for (const std::uint32_t place : pass.rejected) pending[place] = 1;
  }
  run_tree(choose, table, pass);
  return pass.sums;
}

void KnnEngine::run_tree(const NeighbourChooser& choose, NeighbourTable& table, Pass& pass) const {
  std::sort(pass.rejected.begin(), pass.rejected.end());
  std::call_once(fallback_->once, [&] {
    Candidates& points = fallback_->points;
    points.make_room(cloud_.size());
    std::size_t count = 0;
    for (std::size_t place = 0; place < cloud_.size(); ++place)
      if (candidate_.empty() || candidate_[place] != 0) copy_one(places_, place, points, count++);
    points.close(count);
    fallback_->tree = std::make_unique<Fallback::Tree>(3, *fallback_);
  });
  const Fallback& fallback = *fallback_;
  constexpr std::size_t kQueriesPerChunk = 256;
  parallel_chunks(pass.rejected.size(), kQueriesPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
    Candidates candidates;
    KnnScratch scratch;
    std::vector<std::pair<std::uint32_t, double>> hits;
    for (std::size_t r = begin; r < end; ++r) {
      const std::uint32_t self = places_.index[pass.rejected[r]];
      const Vec3 p = cloud_.local_mm(self);
      // The eighth other point bounds every builder's first radius; later ones double it.
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
        candidates.make_room(hits.size());
        for (std::size_t k = 0; k < hits.size(); ++k) copy_one(fallback.points, hits[k].first, candidates, k);
        candidates.close(hits.size());
        // The ball of radius sqrt(3) r covers the cube of half edge r.
        const double covered = whole ? std::numeric_limits<double>::infinity() : radius;
        if (choose(self, p, candidates, covered, table.of[self], scratch) || whole) break;
        radius = radius > 0.0 ? 2.0 * radius : mean_spacing_mm_;
      }
    }
    pass.merge({}, scratch);
  });
}

}  // namespace palpate::search
