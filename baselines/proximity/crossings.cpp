#include "baselines/proximity/segment_index.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "baselines/mesh/pieces.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

/// Facets a chunk for parallel work; does not affect results.
constexpr std::size_t kCrossingChunk = 16384;
/// Most facets near one border edge that are examined; more are skipped.
constexpr std::size_t kNearBorder = 1024;

using Pair = std::pair<std::uint32_t, std::uint32_t>;

void add_both_ways(std::uint32_t f, std::uint32_t g, std::vector<Pair>& pairs) {
  pairs.emplace_back(f, g);
  pairs.emplace_back(g, f);
}

/// Whether a -> b passes through g or ends on it, in double; false within g's plane.
bool meets(const SurfaceMesh& mesh, const Vec3& a, const Vec3& b, std::uint32_t g) noexcept {
  const Vec3 n = mesh.normal(half_facet(g, 0));
  const Facet& facet = mesh.facet(g);
  const double from = n.dot(a - facet.corner[0]), to = n.dot(b - facet.corner[0]);
  const double clear = mesh.rounding_mm();
  const bool starts_on = std::abs(from) <= clear, ends_on = std::abs(to) <= clear;
  if (starts_on && ends_on) return false;
  if (!starts_on && !ends_on && (from > 0.0) == (to > 0.0)) return false;
  const Vec3 at = starts_on ? a : ends_on ? b : Vec3(a + (b - a) * (from / (from - to)));
  return closest_on_facet(facet, at).distance_sq <= clear * clear;
}

bool has_corner(const Facet& f, std::uint32_t a, std::uint32_t b) noexcept {
  for (const std::uint32_t v : f.vertex)
    if (v == a || v == b) return true;
  return false;
}

/// Least squared distance of the segments a + s u and c + t v, s and t in [0, 1] (Ericson 2005, section
/// 5.1.9).
double segments_distance_sq(const Vec3& a, const Vec3& u, const Vec3& c, const Vec3& v) noexcept {
  const Vec3 r = a - c;
  const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v), ur = u.dot(r), vr = v.dot(r);
  const auto within = [](double x) { return std::clamp(x, 0.0, 1.0); };
  const double across = uu * vv - uv * uv;
  double s = across > 0.0 ? within((uv * vr - ur * vv) / across) : 0.0;
  double t = vv > 0.0 ? (uv * s + vr) / vv : 0.0;
  if (t != within(t)) {
    t = within(t);
    s = uu > 0.0 ? within((uv * t - ur) / uu) : 0.0;
  }
  return (r + s * u - t * v).squaredNorm();
}

/// For border edges along or across other facets without shared vertices: float rays may miss grazing
/// contacts, so all near facets are examined.
void pairs_along_border(const SurfaceMesh& mesh, const SegmentIndex& index, std::uint32_t facet,
                        std::uint32_t edge, std::span<NearFacet> near, std::vector<Pair>& pairs) {
  const Facet& f = mesh.facet(facet);
  const Vec3& a = f.corner[edge];
  const Vec3 u = f.corner[after(edge)] - a;
  const double clear = mesh.rounding_mm();
  const Vec3 n = mesh.normal(half_facet(facet, 0));
  const std::size_t found = index.gather(a + 0.5 * u, 0.5 * u.norm() + index.margin_mm(), near);
  for (std::size_t i = 0; i < std::min(found, near.size()); ++i) {
    const Facet& g = mesh.facet(near[i].facet);
    if (near[i].facet == facet || has_corner(g, f.vertex[edge], f.vertex[after(edge)])) continue;
    bool touches = closest_on_facet(g, a).distance_sq <= clear * clear ||
                   closest_on_facet(g, a + u).distance_sq <= clear * clear;
    double aside = 0.0;
    for (std::uint32_t e = 0; e < 3; ++e) {
      const Vec3& c = g.corner[e];
      touches = touches || segments_distance_sq(a, u, c, g.corner[after(e)] - c) <= clear * clear;
      aside = std::max(aside, std::abs(n.dot(c - a)));
    }
    if (!touches || aside <= clear) continue;
    add_both_ways(facet, near[i].facet, pairs);
  }
}

/// Facets that share a vertex without being connected by edges around it: sheets that pass through each other
/// or end there.
void pairs_at_vertex(const SurfaceMesh& mesh, std::uint32_t vertex, std::vector<Pair>& pairs) {
  const auto star = mesh.star(vertex).first(std::min<std::size_t>(mesh.star(vertex).size(), kMaxFan));
  std::array<std::uint32_t, kMaxFan> fan;  // indexed by the lowest position in the star
  for (std::uint32_t i = 0; i < star.size(); ++i) fan[i] = i;
  const auto share_edge = [&](const Facet& f, const Facet& g) {
    for (const std::uint32_t v : f.vertex)
      if (v != vertex && has_corner(g, v, v)) return true;
    return false;
  };
  for (std::uint32_t i = 1; i < star.size(); ++i)
    for (std::uint32_t j = 0; j < i; ++j) {
      if (fan[i] == fan[j] || !share_edge(mesh.facet(star[i]), mesh.facet(star[j]))) continue;
      const std::uint32_t from = std::max(fan[i], fan[j]), to = std::min(fan[i], fan[j]);
      for (std::uint32_t k = 0; k <= i; ++k)
        if (fan[k] == from) fan[k] = to;
    }
  for (std::uint32_t i = 1; i < star.size(); ++i)
    for (std::uint32_t j = 0; j < i; ++j)
      if (fan[i] != fan[j]) add_both_ways(star[i], star[j], pairs);
}

/// Adds the facets met by edge `e` of a facet.
void pairs_of_edge(const SurfaceMesh& mesh, const SegmentIndex& index, std::uint32_t facet, std::uint32_t e,
                   std::vector<std::uint32_t>& met, std::vector<Pair>& pairs) {
  const Facet& f = mesh.facet(facet);
  const HalfFacet other = mesh.neighbour(half_facet(facet, 0), e);
  const auto confirm = [&](std::uint32_t g) {
    if (!meets(mesh, f.corner[e], f.corner[after(e)], g)) return;
    add_both_ways(facet, g, pairs);
    if (other != kNoFacet) add_both_ways(facet_of(other), g, pairs);
  };
  met.clear();
  index.all_hits(f.vertex[e], f.vertex[after(e)], met);
  for (const std::uint32_t g : met) {
    confirm(g);
    // At an edge of two facets float may find only one.
    for (std::uint32_t side = 0; side < 3; ++side)
      if (const HalfFacet beside = mesh.neighbour(half_facet(g, 0), side); beside != kNoFacet)
        if (!has_corner(mesh.facet(facet_of(beside)), f.vertex[e], f.vertex[after(e)]))
          confirm(facet_of(beside));
  }
}

std::vector<Pair> find_all(const SurfaceMesh& mesh, const SegmentIndex& index, int threads) {
  const std::size_t facets = mesh.facets().size(), vertices = mesh.vertices().size();
  const auto at_edges = [&](std::size_t begin, std::size_t end, std::vector<Pair>& mine) {
    std::vector<std::uint32_t> met;
    std::vector<NearFacet> near(kNearBorder);
    for (auto facet = static_cast<std::uint32_t>(begin); facet < end; ++facet)
      for (std::uint32_t e = 0; e < 3; ++e) {
        // Each edge once, from its lower facet; edges of several facets from each, with duplicates removed by
        // sorting.
        const HalfFacet other = mesh.neighbour(half_facet(facet, 0), e);
        if (other == kNoFacet) pairs_along_border(mesh, index, facet, e, near, mine);
        if (other != kNoFacet && facet_of(other) < facet &&
            facet_of(mesh.neighbour(half_facet(facet, 1), e)) < facet)
          continue;
        pairs_of_edge(mesh, index, facet, e, met, mine);
      }
  };
  const auto at_vertex = [&](std::size_t v, std::vector<Pair>& mine) {
    pairs_at_vertex(mesh, static_cast<std::uint32_t>(v), mine);
  };
  std::vector<Pair> all = parallel_list<Pair>(facets, kCrossingChunk, threads, at_edges);
  const auto more = parallel_list<Pair>(vertices, kCrossingChunk, threads, at_vertex);
  all.insert(all.end(), more.begin(), more.end());
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

bool at_border(const SurfaceMesh& mesh, std::uint32_t facet) noexcept {
  for (std::uint32_t e = 0; e < 3; ++e)
    if (mesh.neighbour(half_facet(facet, 0), e) == kNoFacet) return true;
  return false;
}

/// A border that ends on its own surface is a seam without shared vertices, not a fold.
std::size_t count_folded(const SurfaceMesh& mesh, const std::vector<Pair>& pairs) {
  if (pairs.empty()) return 0;
  const std::vector<std::uint32_t> component = components_of(mesh);
  std::vector<bool> folded(component.size(), false);
  for (const auto& [a, b] : pairs)
    if (component[a] == component[b] && !at_border(mesh, a) && !at_border(mesh, b)) folded[a] = true;
  return static_cast<std::size_t>(std::count(folded.begin(), folded.end(), true));
}

}  // namespace

Crossings Crossings::find(const SurfaceMesh& mesh, const SegmentIndex& index, int threads) {
  const std::size_t count = mesh.facets().size();
  const std::vector<Pair> pairs = find_all(mesh, index, threads);
  Crossings result;
  if (pairs.empty()) return result;
  result.folded_ = count_folded(mesh, pairs);
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
