#include "toolkit/neighbourhood/knn_engine.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <mutex>
#include <nanoflann.hpp>

#include "toolkit/core/parallel.h"

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
/// First lattice: 2^10 cubes along the longest side, enough to count occupied cells of most clouds before
/// refining.
constexpr double kFirstCubes = 1024.0;
/// Rounding of (p - low) * per_mm, a cell coordinate below 2^21: the block may be smaller by this share of a
/// cell.
constexpr double kCellRounding = 1e-9;
/// Kept candidates up to which ranks are counted pair by pair, without a branch to mispredict: a guess from
/// the point before keeps some fourteen. Beyond, eight places are filled by insertion.
constexpr std::size_t kMostRanked = 24;
/// Cells a parallel chunk, so that its table lookups stay in cache.
constexpr std::size_t kCellsPerChunk = 2048;

/// Occupied cells when the lowest `shift` bits of every code are ignored.
std::size_t occupied(const std::vector<std::uint64_t>& codes, int shift) {
  std::size_t cells = codes.empty() ? 0 : 1;
  for (std::size_t i = 1; i < codes.size(); ++i) cells += (codes[i] >> shift) != (codes[i - 1] >> shift);
  return cells;
}

struct CellRange {
  std::uint64_t code;
  std::uint32_t begin, end;
};

}  // namespace

/// A grid of cells over the sorted points: every cell is a range of places.
struct KnnEngine::Level {
  int shift = 0;  ///< code bits below a cell
  double cell_mm = 0.0;
  std::vector<CellRange> cells;
  std::vector<std::uint32_t> slots;  ///< hash of cells: index + 1, 0 = free
  int hash_shift = 0;

  Level(const partition::MortonOrder& sorted, const partition::Lattice& lattice, int level)
      : shift(3 * level), cell_mm(lattice.unit_mm * static_cast<double>(std::int64_t{1} << level)) {
    const std::size_t n = sorted.codes.size();
    for (std::size_t begin = 0; begin < n;) {
      const std::uint64_t code = sorted.codes[begin] >> shift;
      std::size_t end = begin + 1;
      while (end < n && (sorted.codes[end] >> shift) == code) ++end;
      cells.push_back({code, static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end)});
      begin = end;
    }
    const std::size_t size = std::bit_ceil(std::max<std::size_t>(2 * cells.size(), 2));
    slots.assign(size, 0);
    hash_shift = 64 - std::countr_zero(size);
    for (std::size_t c = 0; c < cells.size(); ++c) {
      std::size_t at = slot(cells[c].code);
      while (slots[at] != 0) at = (at + 1) & (size - 1);
      slots[at] = static_cast<std::uint32_t>(c + 1);
    }
  }
  [[nodiscard]] std::size_t slot(std::uint64_t code) const noexcept {
    return (code * 0x9E3779B97F4A7C15u) >> hash_shift;
  }
  [[nodiscard]] const CellRange* find(std::uint64_t code) const noexcept {
    for (std::size_t at = slot(code); slots[at] != 0; at = (at + 1) & (slots.size() - 1))
      if (cells[slots[at] - 1].code == code) return &cells[slots[at] - 1];
    return nullptr;
  }
};

/// A k-d tree over the candidates, for points whose neighbours the grid cannot give cheaply: outliers, and
/// cells crowded far beyond the rest of the cloud. Built on first use.
struct KnnEngine::Fallback {
  Candidates points;
  std::once_flag once;

  std::size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return axis == 0 ? points.x[i] : axis == 1 ? points.y[i] : points.z[i];
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

void square_distances(const Candidates& candidates, const Vec3& p, Scratch& scratch) {
  const std::size_t n = candidates.size();
  scratch.key.resize(n);
  const double *x = candidates.x.data(), *y = candidates.y.data(), *z = candidates.z.data();
  const double px = p.x(), py = p.y(), pz = p.z();
  double* key = scratch.key.data();
  for (std::size_t i = 0; i < n; ++i) {
    const double dx = x[i] - px, dy = y[i] - py, dz = z[i] - pz;
    key[i] = dx * dx + dy * dy + dz * dz;
  }
}

void keep_within(double limit, Scratch& scratch) {
  const std::size_t n = scratch.key.size();
  scratch.kept.resize(n);
  const double* key = scratch.key.data();
  std::uint32_t* kept = scratch.kept.data();
  std::size_t count = 0;
  for (std::size_t i = 0; i < n; ++i) {
    kept[count] = static_cast<std::uint32_t>(i);
    count += static_cast<std::size_t>(key[i] <= limit);
  }
  scratch.kept.resize(count);
}

double choose_eight(std::uint32_t self, const Candidates& candidates, std::span<const double> key,
                    std::span<const std::uint32_t> kept, Neighbours& out) noexcept {
  if (kept.size() > kMostRanked) {
    BestEight best;
    for (const std::uint32_t i : kept)
      if (key[i] <= best.worst() && candidates.index[i] != self) best.offer(key[i], candidates.index[i]);
    best.store(self, out);
    return best.worst();
  }
  std::array<double, kMostRanked> k;
  std::array<std::uint32_t, kMostRanked> index;
  std::array<unsigned, kMostRanked> rank{};
  std::size_t n = 0;
  for (const std::uint32_t i : kept) {
    k[n] = key[i];
    index[n] = candidates.index[i];
    n += static_cast<std::size_t>(candidates.index[i] != self);
  }
  for (std::size_t i = 1; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const auto before = static_cast<unsigned>(k[j] < k[i]) |
                          (static_cast<unsigned>(k[j] == k[i]) & static_cast<unsigned>(index[j] < index[i]));
      rank[i] += before;
      rank[j] += 1u - before;
    }
  out.fill(self);
  double worst = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < n; ++i) {
    if (rank[i] < kNeighbours) out[rank[i]] = index[i];
    if (rank[i] == kNeighbours - 1) worst = k[i];
  }
  return worst;
}

KnnEngine::~KnnEngine() = default;

KnnEngine::KnnEngine(const cloud::Cloud& cloud, int threads)
    : cloud_(cloud), threads_(threads), fallback_(std::make_unique<Fallback>()) {
  geometry::Aabb box;
  for (std::size_t i = 0; i < cloud.size(); ++i) box.add(cloud.local_mm(i));
  const double extent = box.extent_mm().maxCoeff();
  // A single place has no extent; any unit serves.
  double unit = extent > 0.0 ? extent / kFirstCubes : 1.0;
  // Two looks: the first lattice tells the occupancy, the second has cells of the wanted size.
  for (int look = 0; look < 2; ++look) {
    lattice_ = partition::Lattice::over(cloud, unit);
    sorted_ = partition::sort_by_morton(cloud, lattice_, threads);
    const std::size_t n = cloud.size();
    int level = 0;
    while (level < partition::kMortonBits &&
           static_cast<double>(n) < kPointsPerCell * static_cast<double>(occupied(sorted_.codes, 3 * level)))
      ++level;
    // `level` is the first with at least the wanted points a cell.
    const double cells = static_cast<double>(occupied(sorted_.codes, 3 * level));
    const double edge = lattice_.unit_mm * static_cast<double>(std::int64_t{1} << level);
    const double points = static_cast<double>(n) / cells;
    mean_spacing_mm_ = edge / std::sqrt(points);
    first_level_ = level;
    // Of a surface, points a cell grow with the square of the edge. Level 0 is already right or too coarse.
    const double wanted = edge * std::sqrt(kPointsPerCell / points);
    if (look == 1) break;
    // One level below stays in the lattice, so that a later look can still go finer once.
    unit = wanted / 2.0;
    if (!(unit > 0.0) || extent <= 0.0) break;
  }
  // More than nine points at one place: only the nine of lowest index are candidates. Equal points have equal
  // codes.
  const std::size_t n = cloud.size();
  candidate_.assign(n, 1);
  std::vector<std::uint32_t> run;
  for (std::size_t begin = 0; begin < n;) {
    std::size_t end = begin + 1;
    while (end < n && sorted_.codes[end] == sorted_.codes[begin]) ++end;
    if (end - begin > kSamePlace) {
      run.assign(sorted_.order.begin() + static_cast<std::ptrdiff_t>(begin),
                 sorted_.order.begin() + static_cast<std::ptrdiff_t>(end));
      const auto at = [&](std::uint32_t i) {
        return std::array{cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]};
      };
      std::sort(run.begin(), run.end(),
                [&](std::uint32_t a, std::uint32_t b) { return at(a) != at(b) ? at(a) < at(b) : a < b; });
      std::size_t same = 0;
      for (std::size_t i = 0; i < run.size(); ++i) {
        same = i > 0 && at(run[i]) == at(run[i - 1]) ? same + 1 : 1;
        sorted_.order[begin + i] = run[i];
        candidate_[begin + i] = same <= kSamePlace;
      }
    }
    begin = end;
  }
}

void KnnEngine::run_level(const Level& level, const Choose& choose, NeighbourTable& table, Pass& pass,
                          std::span<const std::uint8_t> pending) const {
  parallel_chunks(level.cells.size(), kCellsPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
    Candidates candidates;
    Scratch scratch;
    std::vector<std::uint32_t> mine;
    for (std::size_t c = begin; c < end; ++c) {
      const CellRange& cell = level.cells[c];
      bool any = pending.empty();
      for (std::uint32_t place = cell.begin; place < cell.end && !any; ++place) any = pending[place] != 0;
      if (!any) continue;
      // The block of cells around this one.
      const Vec3 somewhere = cloud_.local_mm(sorted_.order[cell.begin]);
      std::int64_t at[3];
      for (int axis = 0; axis < 3; ++axis)
        at[axis] = lattice_.coordinate(somewhere[axis], axis) >> (level.shift / 3);
      std::array<const CellRange*, 27> block{};
      std::size_t found = 0, held = 0;
      const std::int64_t last = (std::int64_t{1} << partition::kMortonBits) - 1;
      for (std::int64_t z = at[2] - 1; z <= at[2] + 1; ++z)
        for (std::int64_t y = at[1] - 1; y <= at[1] + 1; ++y)
          for (std::int64_t x = at[0] - 1; x <= at[0] + 1; ++x) {
            if (x < 0 || y < 0 || z < 0 || x > last || y > last || z > last) continue;
            const CellRange* other = level.find(partition::morton_code(
                static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), static_cast<std::uint32_t>(z)));
            if (other == nullptr) continue;
            block[found++] = other;
            held += other->end - other->begin;
            // Its own cell first: the nearest candidates seen early spare the rest their place in the list.
            if (other == &cell) std::swap(block[0], block[found - 1]);
          }
      const bool crowded = held > 27 * kDenseCell || cell.end - cell.begin > kDenseCell;
      if (!crowded) {
        candidates.clear();
        for (std::size_t b = 0; b < found; ++b)
          for (std::uint32_t place = block[b]->begin; place < block[b]->end; ++place) {
            if (candidate_[place] == 0) continue;
            const std::uint32_t i = sorted_.order[place];
            candidates.x.push_back(static_cast<double>(cloud_.x_mm[i]));
            candidates.y.push_back(static_cast<double>(cloud_.y_mm[i]));
            candidates.z.push_back(static_cast<double>(cloud_.z_mm[i]));
            candidates.index.push_back(i);
          }
      }
      const Vec3 low(lattice_.low_mm + level.cell_mm * Vec3(static_cast<double>(at[0]),
                                                            static_cast<double>(at[1]),
                                                            static_cast<double>(at[2])));
      for (std::uint32_t place = cell.begin; place < cell.end; ++place) {
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
    run_level(Level(sorted_, lattice_, level), choose, table, pass, pending);
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
    for (std::size_t place = 0; place < cloud_.size(); ++place) {
      if (candidate_[place] == 0) continue;
      const std::uint32_t i = sorted_.order[place];
      const Vec3 p = cloud_.local_mm(i);
      points.x.push_back(p.x());
      points.y.push_back(p.y());
      points.z.push_back(p.z());
      points.index.push_back(i);
    }
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
        candidates.clear();
        for (const auto& [i, square] : hits) {
          candidates.x.push_back(fallback.points.x[i]);
          candidates.y.push_back(fallback.points.y[i]);
          candidates.z.push_back(fallback.points.z[i]);
          candidates.index.push_back(fallback.points.index[i]);
        }
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
