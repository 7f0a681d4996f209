// Connects the facets of a SurfaceMesh: neighbours over edges, stars of vertices, repeated facets.
#include <algorithm>
#include <cmath>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {
namespace {

/// One use of an edge: its higher vertex, and facet * 4 + edge.
constexpr std::uint64_t edge_use(std::uint32_t high, std::uint32_t facet, std::uint32_t edge) noexcept {
  return (std::uint64_t{high} << 32) | (facet * 4u + edge);
}
constexpr std::uint32_t facet_of_use(std::uint64_t use) noexcept {
  return static_cast<std::uint32_t>(use) / 4;
}
constexpr std::uint32_t edge_of_use(std::uint64_t use) noexcept {
  return static_cast<std::uint32_t>(use) % 4;
}

/// visit(uses of one edge) for all edges in the sorted uses.
template <class Visit>
void for_edges(std::span<const std::uint64_t> uses, const Visit& visit) {
  for (std::size_t first = 0, last = 0; first < uses.size(); first = last) {
    while (last < uses.size() && (uses[last] >> 32) == (uses[first] >> 32)) ++last;
    visit(uses.subspan(first, last - first));
  }
}

}  // namespace

/// Findings of one chunk of vertices, at the edges that begin there.
struct SurfaceMesh::Found {
  std::size_t edges = 0, boundary = 0, flipped = 0;
  bool repeated = false;
  std::vector<std::uint64_t> radial;  ///< uses of edges with three or more facets
  std::vector<std::size_t> radial_begin;
  std::vector<std::uint32_t> thirds;  ///< at the current edge
};

void SurfaceMesh::connect(int threads) {
  std::vector<bool> two_sided(facets_.size(), false);
  const auto connect_now = [&] {
    stars_ = group_by_key(vertices_.size(), facets_.size(), threads, [&](std::size_t i, const auto& visit) {
      for (const std::uint32_t v : facets_[i].vertex) visit(v);
    });
    return connect_edges(two_sided, threads);
  };
  while (connect_now() || counts_.two_sided_facets > 0) {
    Starts begin{0};
    Uses uses;
    for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
      add_uses(v, uses);
      begin.push_back(static_cast<std::uint32_t>(uses.size()));
    }
    // Coincident sheets are one: a god object has no room between them.
    if (drop_repeated(begin, uses, two_sided)) continue;
    if (counts_.two_sided_facets == 0 || !drop_fins(begin, uses, two_sided)) break;
  }
}

void SurfaceMesh::add_uses(std::uint32_t vertex, Uses& uses) const {
  const auto begin = static_cast<std::ptrdiff_t>(uses.size());
  for (const std::uint32_t i : star(vertex))
    for (std::uint32_t e = 0; e < 3; ++e) {
      const std::uint32_t a = facets_[i].vertex[e], b = facets_[i].vertex[after(e)];
      if (std::min(a, b) == vertex) uses.push_back(edge_use(std::max(a, b), i, e));
    }
  std::sort(uses.begin() + begin, uses.end());
}

bool SurfaceMesh::connect_edges(const std::vector<bool>& two_sided, int threads) {
  const auto connect = [&](std::size_t begin, std::size_t end, Found& found) {
    Uses uses;
    for (std::size_t v = begin; v < end; ++v) {
      uses.clear();
      add_uses(static_cast<std::uint32_t>(v), uses);
      for_edges(uses, [&](std::span<const std::uint64_t> edge) { connect_edge(edge, two_sided, found); });
    }
  };
  std::vector<Found> parts = parallel_parts<Found>(vertices_.size(), kPointsPerChunk, threads, connect);
  counts_.edges = counts_.boundary_edges = counts_.flipped_edges = counts_.radial_edges = 0;
  radial_.clear();
  bool repeated = false;
  for (Found& found : parts) {
    counts_.edges += found.edges;
    counts_.boundary_edges += found.boundary;
    counts_.flipped_edges += found.flipped;
    repeated = repeated || found.repeated;
    found.radial_begin.push_back(found.radial.size());
    for (std::size_t i = 0; i + 1 < found.radial_begin.size(); ++i)
      connect_radial(std::span<const std::uint64_t>(found.radial)
                         .subspan(found.radial_begin[i], found.radial_begin[i + 1] - found.radial_begin[i]));
  }
  return repeated;
}

void SurfaceMesh::connect_edge(std::span<const std::uint64_t> uses, const std::vector<bool>& two_sided,
                               Found& found) {
  ++found.edges;
  const std::uint32_t facet = facet_of_use(uses[0]), edge = edge_of_use(uses[0]);
  Facet& f = facets_[facet];
  if (uses.size() == 1) {
    if (two_sided[facet])
      f.across[edge] = half_facet(facet, 1);
    else
      ++found.boundary;
    return;
  }
  found.thirds.clear();
  for (const std::uint64_t use : uses)
    found.thirds.push_back(facets_[facet_of_use(use)].vertex[before(edge_of_use(use))]);
  std::sort(found.thirds.begin(), found.thirds.end());
  found.repeated =
      found.repeated || std::adjacent_find(found.thirds.begin(), found.thirds.end()) != found.thirds.end();
  if (uses.size() > 2) {
    found.radial_begin.push_back(found.radial.size());
    found.radial.insert(found.radial.end(), uses.begin(), uses.end());
    return;
  }
  const std::uint32_t over = facet_of_use(uses[1]), its_edge = edge_of_use(uses[1]);
  Facet& g = facets_[over];
  // Equal directions along the edge mean opposite orientations.
  const std::uint32_t flip = f.vertex[edge] == g.vertex[its_edge] ? 1u : 0u;
  found.flipped += flip;
  f.across[edge] = half_facet(over, flip);
  g.across[its_edge] = half_facet(facet, flip);
}

bool SurfaceMesh::drop_repeated(const Starts& begin, const Uses& uses, std::vector<bool>& two_sided) {
  const auto facet_at = [&](std::size_t i) { return facet_of_use(uses[i]); };
  const auto edge_at = [&](std::size_t i) { return edge_of_use(uses[i]); };
  const auto third = [&](std::size_t i) { return facets_[facet_at(i)].vertex[before(edge_at(i))]; };
  const auto start = [&](std::size_t i) { return facets_[facet_at(i)].vertex[edge_at(i)]; };
  std::vector<bool> repeated(facets_.size(), false);
  std::size_t found = 0;
  for (std::size_t v = 0; v + 1 < begin.size(); ++v)
    for (std::size_t i = begin[v]; i < begin[v + 1]; ++i)
      for (std::size_t j = i + 1; j < begin[v + 1] && (uses[j] >> 32) == (uses[i] >> 32); ++j) {
        // Uses of an edge are sorted by facet: j is the later one.
        if (repeated[facet_at(i)] || repeated[facet_at(j)] || third(i) != third(j)) continue;
        repeated[facet_at(j)] = true;
        two_sided[facet_at(i)] = two_sided[facet_at(i)] || start(i) != start(j);
        ++found;
      }
  if (found == 0) return false;
  counts_.repeated_facets += found;
  drop(repeated, two_sided);
  return true;
}

bool SurfaceMesh::drop_fins(const Starts& begin, const Uses& uses, std::vector<bool>& two_sided) {
  const auto each_edge = [&](const auto& visit) {
    for (std::size_t v = 0; v + 1 < begin.size(); ++v)
      for_edges(std::span<const std::uint64_t>(uses).subspan(begin[v], begin[v + 1] - begin[v]), visit);
  };
  constexpr std::size_t kSurface = 2;  // facets at an ordinary edge
  std::vector<bool> free(facets_.size(), false), fin(two_sided);
  each_edge([&](std::span<const std::uint64_t> edge) {
    if (edge.size() == 1) free[facet_of_use(edge[0])] = true;
    if (edge.size() == kSurface) fin[facet_of_use(edge[0])] = fin[facet_of_use(edge[1])] = false;
  });
  for (std::size_t i = 0; i < fin.size(); ++i) fin[i] = fin[i] && free[i];
  each_edge([&](std::span<const std::uint64_t> edge) {
    std::size_t others = 0;
    for (const std::uint64_t use : edge) others += !fin[facet_of_use(use)];
    if (edge.size() > 1 && others < kSurface)
      for (const std::uint64_t use : edge) fin[facet_of_use(use)] = false;
  });
  const auto found = static_cast<std::size_t>(std::count(fin.begin(), fin.end(), true));
  if (found == 0) return false;
  counts_.fins += found;
  drop(fin, two_sided);
  return true;
}

void SurfaceMesh::drop(const std::vector<bool>& gone, std::vector<bool>& two_sided) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < facets_.size(); ++i) {
    if (gone[i]) continue;
    two_sided[kept] = two_sided[i];
    facets_[kept] = facets_[i];
    facets_[kept++].across = {kNoFacet, kNoFacet, kNoFacet};
  }
  facets_.resize(kept);
  two_sided.resize(kept);
  counts_.two_sided_facets = static_cast<std::size_t>(std::count(two_sided.begin(), two_sided.end(), true));
}

/// Sorts the facets by angle around the edge. Side 0 of a facet along the edge faces growing angles, of one
/// against it falling angles; a side's neighbour is the next facet there.
void SurfaceMesh::connect_radial(std::span<const std::uint64_t> uses) {
  ++counts_.radial_edges;
  struct Leaf {
    double angle;
    std::uint32_t facet, edge, along;
  };
  std::vector<Leaf> leaves;
  Vec3 axis, u, w;
  for (std::size_t i = 0; i < uses.size(); ++i) {
    const std::uint32_t index = facet_of_use(uses[i]), edge = edge_of_use(uses[i]);
    const Facet& f = facets_[index];
    const bool along = f.vertex[edge] < f.vertex[after(edge)];
    const Vec3& p = f.corner[along ? edge : after(edge)];
    const Vec3& q = f.corner[along ? after(edge) : edge];
    const Vec3 third = f.corner[before(edge)] - p;
    if (i == 0) {
      axis = (q - p).normalized();
      u = (third - axis * axis.dot(third)).normalized();
      w = axis.cross(u);
    }
    leaves.push_back({std::atan2(w.dot(third), u.dot(third)), index, edge, along ? 1u : 0u});
  }
  std::sort(leaves.begin(), leaves.end(), [](const Leaf& a, const Leaf& b) {
    return a.angle != b.angle ? a.angle < b.angle : a.facet < b.facet;
  });
  const std::size_t n = leaves.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Leaf& here = leaves[i];
    const Leaf& up = leaves[(i + 1) % n];
    const Leaf& down = leaves[(i + n - 1) % n];
    // The lower side of `up`, and the upper side of `down`.
    const HalfFacet rising = half_facet(up.facet, up.along);
    const HalfFacet falling = half_facet(down.facet, 1u - down.along);
    facets_[here.facet].across[here.edge] = kRadialBase + static_cast<std::uint32_t>(radial_.size());
    radial_.push_back(here.along != 0 ? std::array<HalfFacet, 2>{rising, falling}
                                      : std::array<HalfFacet, 2>{falling, rising});
  }
}

}  // namespace palpate::baselines
