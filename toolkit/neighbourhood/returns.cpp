#include "toolkit/neighbourhood/returns.h"

#include <algorithm>
#include <span>
#include <vector>

#include "toolkit/core/parallel.h"

namespace palpate::neighbourhood {
namespace {

constexpr std::size_t kPointsPerChunk = 16384;

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

/// Whether a walk at `q` that wants to go to `p` gets nearer by any neighbour.
bool leads_to(const cloud::Cloud& cloud, const Neighbours& around, std::uint32_t q, const Vec3& p) noexcept {
  const double here = (cloud.local_mm(q) - p).squaredNorm();
  for (const std::uint32_t a : around)
    if (a != q && (cloud.local_mm(a) - p).squaredNorm() < here) return true;
  return false;
}

void choose(const cloud::Cloud& cloud, std::uint32_t q, std::vector<Candidate>& candidates, Neighbours& out) {
  std::sort(candidates.begin(), candidates.end());
  std::vector<Candidate> kept, behind;
  for (const Candidate& c : candidates) {
    if (kept.size() == kNeighbours) break;
    const Vec3 at = cloud.local_mm(c.index);
    const bool occluded = std::any_of(kept.begin(), kept.end(), [&](const Candidate& k) {
      return (cloud.local_mm(k.index) - at).squaredNorm() < c.square;
    });
    (occluded ? behind : kept).push_back(c);
  }
  for (const Candidate& c : behind)
    if (kept.size() < kNeighbours) kept.push_back(c);
  std::sort(kept.begin(), kept.end());
  out.fill(q);
  for (std::size_t k = 0; k < kept.size(); ++k) out[k] = kept[k].index;
}

}  // namespace

std::size_t add_missing_returns(const cloud::Cloud& cloud, NeighbourTable& table, int threads) {
  const std::size_t n = table.size();
  std::vector<std::vector<Missing>> parts((n + kPointsPerChunk - 1) / kPointsPerChunk);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    auto& mine = parts[begin / kPointsPerChunk];
    for (std::size_t at = begin; at < end; ++at) {
      const auto p = static_cast<std::uint32_t>(at);
      const Vec3 place = cloud.local_mm(p);
      for (const std::uint32_t q : table.of[p]) {
        if (q == p) continue;
        const Neighbours& back = table.of[q];
        if (std::find(back.begin(), back.end(), p) == back.end() && !leads_to(cloud, back, q, place))
          mine.push_back({q, p});
      }
    }
  });
  std::vector<Missing> missing;
  for (const auto& part : parts) missing.insert(missing.end(), part.begin(), part.end());
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
    choose(cloud, q, candidates, table.of[q]);
  }
  return changed;
}

}  // namespace palpate::neighbourhood
