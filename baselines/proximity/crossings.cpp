#include "baselines/proximity/crossings.h"

#include <algorithm>
#include <utility>

#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

/// Facets a chunk, for parallel work; decides nothing about the result.
constexpr std::size_t kChunk = 16384;

using Pair = std::pair<std::uint32_t, std::uint32_t>;

/// Whether a -> b goes through g, its ends clear of the plane and the point clear of doubt, in double.
bool pierces(const SurfaceMesh& mesh, const Vec3& a, const Vec3& b, std::uint32_t g) noexcept {
  const Vec3 n = mesh.normal(half_facet(g, 0));
  const Facet& facet = mesh.facet(g);
  const double from = n.dot(a - facet.corner[0]), to = n.dot(b - facet.corner[0]);
  const double clear = mesh.rounding_mm();
  if (!((from > clear && to < -clear) || (from < -clear && to > clear))) return false;
  const Vec3 at = a + (b - a) * (from / (from - to));
  return closest_on_facet(facet, at).distance_sq <= clear * clear;
}

}  // namespace

Crossings Crossings::find(const SurfaceMesh& mesh, const SegmentIndex& index, int threads) {
  const std::size_t count = mesh.facets().size();
  std::vector<std::vector<Pair>> found((count + kChunk - 1) / kChunk);
  parallel_chunks(count, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint32_t> met;
    std::vector<Pair>& mine = found[begin / kChunk];
    for (std::size_t i = begin; i < end; ++i) {
      const auto facet = static_cast<std::uint32_t>(i);
      const Facet& f = mesh.facet(facet);
      for (std::uint32_t e = 0; e < 3; ++e) {
        // Each edge once, from its lower facet; edges of several facets from each, which sorting removes.
        const std::uint32_t other = mesh.neighbour(half_facet(facet, 0), e);
        if (other != kNoFacet && facet_of(other) < facet &&
            facet_of(mesh.neighbour(half_facet(facet, 1), e)) < facet)
          continue;
        met.clear();
        index.all_hits(f.vertex[e], f.vertex[after(e)], met);
        for (const std::uint32_t g : met) {
          if (!pierces(mesh, f.corner[e], f.corner[after(e)], g)) continue;
          const auto with = [&](std::uint32_t holder) {
            mine.emplace_back(holder, g);
            mine.emplace_back(g, holder);
          };
          with(facet);
          if (other != kNoFacet) with(facet_of(other));
        }
      }
    }
  });
  std::vector<Pair> pairs;
  for (const auto& part : found) pairs.insert(pairs.end(), part.begin(), part.end());
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  Crossings result;
  if (pairs.empty()) return result;
  result.begin_.assign(count + 1, 0);
  for (const Pair& pair : pairs) {
    result.facets_ += result.begin_[pair.first + 1] == 0;
    ++result.begin_[pair.first + 1];
    result.others_.push_back(pair.second);
  }
  for (std::size_t i = 0; i < count; ++i) result.begin_[i + 1] += result.begin_[i];
  return result;
}

}  // namespace palpate::baselines
