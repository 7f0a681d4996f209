#include "toolkit/search/knn.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/search/knn_engine.h"

namespace palpate::search {
namespace {

/// Candidates for the chosen eight. With scan lines r samples apart about 2 r points are nearer than the next
/// line, so 24 reach lines ten samples apart.
constexpr std::size_t kConsidered = 24;
/// Sum of pairwise eigenvalue products of eight unit directions' scatter: 16 spread evenly over a plane, 7
/// within some 20 degrees of a line (eigenvalues 7 and 1).
constexpr double kInARow = 7.0;
/// Length of the sum of eight directions: between 0 (even) and 5.1 (over a half plane).
constexpr double kToOneSide = 2.5;
/// The 24th distance is guessed from the last point, with a quarter to spare.
constexpr double kWideGuessMarginSq = 1.25 * 1.25;

struct Missing {
  std::uint32_t at, to;
};

struct Candidate {
  double square;
  std::uint32_t index;
  bool operator<(const Candidate& o) const noexcept {
    return square != o.square ? square < o.square : index < o.index;
  }
};

/// True if a walk at `q` towards `p` gets nearer by some neighbour.
bool leads_to(const cloud::Cloud& cloud, const Neighbours& around, std::uint32_t q, const Vec3& p) noexcept {
  const double here = (cloud.local_mm(q) - p).squaredNorm();
  for (const std::uint32_t a : around)
    if (a != q && (cloud.local_mm(a) - p).squaredNorm() < here) return true;
  return false;
}

/// Chooses eight of the sorted candidates in different directions.
void choose(const cloud::Cloud& cloud, std::uint32_t q, std::span<const Candidate> sorted, Neighbours& out) {
  std::array<Candidate, kNeighbours> kept;
  std::size_t count = 0;
  std::uint64_t taken = 0;  // by position; at most 64 candidates are considered
  const std::size_t n = std::min<std::size_t>(sorted.size(), 64);
  for (std::size_t i = 0; i < n && count < kNeighbours; ++i) {
    const Vec3 at = cloud.local_mm(sorted[i].index);
    bool behind = false;
    for (std::size_t k = 0; k < count && !behind; ++k)
      behind = (cloud.local_mm(kept[k].index) - at).squaredNorm() < sorted[i].square;
    if (behind) continue;
    taken |= std::uint64_t{1} << i;
    kept[count++] = sorted[i];
  }
  for (std::size_t i = 0; i < n && count < kNeighbours; ++i)
    if ((taken >> i & 1u) == 0) kept[count++] = sorted[i];
  std::sort(kept.begin(), kept.begin() + static_cast<std::ptrdiff_t>(count));
  out.fill(q);
  for (std::size_t k = 0; k < count; ++k) out[k] = kept[k].index;
}

bool is_uneven(const cloud::Cloud& cloud, const Neighbours& around, std::uint32_t p) noexcept {
  Vec3 sum = Vec3::Zero();
  double xx = 0.0, xy = 0.0, xz = 0.0, yy = 0.0, yz = 0.0, zz = 0.0;
  const Vec3 at = cloud.local_mm(p);
  for (const std::uint32_t other : around) {
    const Vec3 d = cloud.local_mm(other) - at;
    const double size = d.norm();
    if (!(size > 0.0)) return true;  // a neighbour is missing or coincides
    const Vec3 u = d / size;
    sum += u;
    xx += u.x() * u.x();
    xy += u.x() * u.y();
    xz += u.x() * u.z();
    yy += u.y() * u.y();
    yz += u.y() * u.z();
    zz += u.z() * u.z();
  }
  const double pairs = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
  return pairs < kInARow || sum.squaredNorm() > kToOneSide * kToOneSide;
}

/// Chooses again for points with neighbours in a row or on one side.
std::size_t spread_uneven(const cloud::Cloud& cloud, NeighbourTable& table, int threads) {
  std::vector<std::uint8_t> uneven(table.size(), 0);
  parallel_each(table.size(), kPointsPerChunk, threads, [&](std::size_t i) {
    uneven[i] = is_uneven(cloud, table.of[i], static_cast<std::uint32_t>(i)) ? 1 : 0;
  });
  const auto count = static_cast<std::size_t>(std::count(uneven.begin(), uneven.end(), 1));
  if (count == 0) return 0;
  const KnnEngine engine(cloud, threads);
  engine.run(
      [&cloud](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
               KnnScratch& scratch) {
        const double covered = radius_mm * radius_mm;
        for (double guess = scratch.guess;; guess = larger_guess(guess)) {
          const bool all = !(guess < covered);
          kernels().keep_ball(c, p, all ? kNoLimit : guess, scratch);
          std::vector<Candidate> near;
          near.reserve(scratch.count);
          for (std::size_t k = 0; k < scratch.count; ++k)
            if (scratch.index[k] != self) near.push_back({scratch.square[k], scratch.index[k]});
          const std::size_t n = std::min(near.size(), kConsidered);
          std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(n), near.end());
          const double last = n < kConsidered ? kNoLimit : near[n - 1].square;
          if (!all && !(last <= guess)) continue;
          scratch.guess = kWideGuessMarginSq * last;
          if (!(last < covered) && radius_mm != kNoLimit) return false;
          choose(cloud, self, std::span(near).first(n), out);
          return true;
        }
      },
      table, uneven);
  return count;
}

std::size_t add_missing_returns(const cloud::Cloud& cloud, NeighbourTable& table, int threads) {
  const auto visit = [&](std::size_t at, std::vector<Missing>& mine) {
    const auto p = static_cast<std::uint32_t>(at);
    const Vec3 place = cloud.local_mm(p);
    for (const std::uint32_t q : table.of[p]) {
      if (q == p) continue;
      const Neighbours& back = table.of[q];
      if (std::find(back.begin(), back.end(), p) == back.end() && !leads_to(cloud, back, q, place))
        mine.push_back({q, p});
    }
  };
  std::vector<Missing> missing = parallel_list<Missing>(table.size(), kPointsPerChunk, threads, visit);
  std::sort(missing.begin(), missing.end(),
            [](const Missing& a, const Missing& b) { return a.at != b.at ? a.at < b.at : a.to < b.to; });
  std::size_t changed = 0;
  std::vector<Candidate> candidates;
  for (std::size_t begin = 0; begin < missing.size(); ++changed) {
    const std::uint32_t q = missing[begin].at;
    const Vec3 at = cloud.local_mm(q);
    candidates.clear();
    const auto offer = [&](std::uint32_t i) {
      if (i != q) candidates.push_back({(cloud.local_mm(i) - at).squaredNorm(), i});
    };
    for (const std::uint32_t i : table.of[q]) offer(i);
    for (; begin < missing.size() && missing[begin].at == q; ++begin) offer(missing[begin].to);
    std::sort(candidates.begin(), candidates.end());
    choose(cloud, q, candidates, table.of[q]);
  }
  return changed;
}

}  // namespace

WalkableReport make_walkable(const cloud::Cloud& cloud, NeighbourTable& table, int threads) {
  WalkableReport report;
  report.spread = spread_uneven(cloud, table, threads);
  report.returned = add_missing_returns(cloud, table, threads);
  return report;
}

}  // namespace palpate::search
