#include "baselines/mesh/surface_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "toolkit/core/parallel.h"
#include "toolkit/core/try.h"

namespace palpate::baselines {
namespace {

/// Facets that 2 * facet + side can number below the codes of radial edges.
constexpr std::size_t kMaxFacets = std::size_t{1} << 29;
/// A facet whose doubled area is within this of the product of its sides has a normal of rounding alone:
/// about eight rounded operations stand between corners and normal.
constexpr double kFlat = gamma(8);
/// Operations that a walk puts between corners and a result, generously.
constexpr int kOperations = 64;

std::uint64_t mix(std::uint64_t h) noexcept {  // the finisher of MurmurHash3: spreads bits, decides nothing
  h ^= h >> 33;
  h *= 0xFF51AFD7ED558CCDu;
  h ^= h >> 33;
  h *= 0xC4CEB9FE1A85EC53u;
  return h ^ (h >> 33);
}

std::uint64_t place_hash(const Vec3& p) noexcept {
  std::uint64_t h = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double value = p[axis] == 0.0 ? 0.0 : p[axis];  // -0 is the place of 0
    h = mix(h ^ std::bit_cast<std::uint64_t>(value)) + 0x9E3779B97F4A7C15u;
  }
  return h;
}

/// For every vertex the number of the welded one; fills `places` with one vertex per place, in order of
/// appearance.
std::vector<std::uint32_t> weld(const std::vector<Vec3>& given, LargeVector<Vec3>& places) {
  const std::size_t slots = std::bit_ceil(given.size() * 2 + 1);
  std::vector<std::uint32_t> table(slots, kNoFacet);
  std::vector<std::uint32_t> welded(given.size());
  places.reserve(given.size());
  for (std::size_t i = 0; i < given.size(); ++i) {
    std::size_t slot = place_hash(given[i]) & (slots - 1);
    while (table[slot] != kNoFacet && places[table[slot]] != given[i]) slot = (slot + 1) & (slots - 1);
    if (table[slot] == kNoFacet) {
      table[slot] = static_cast<std::uint32_t>(places.size());
      places.push_back(given[i]);
    }
    welded[i] = table[slot];
  }
  return welded;
}

Status check(const geometry::TriangleMesh& mesh) {
  if (mesh.triangles.size() >= kMaxFacets || mesh.vertices_mm.size() >= kNoFacet)
    return Error{fmt::format("a mesh of {} triangles is more than can be numbered", mesh.triangles.size()),
                 fmt::format("decimate it below {}", kMaxFacets),
                 {},
                 0};
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i)
    if (!is_finite(mesh.vertices_mm[i]))
      return Error{fmt::format("vertex {} of the mesh is not finite", i), "repair the mesh", {}, 0};
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    for (const std::uint32_t v : mesh.triangles[i])
      if (v >= mesh.vertices_mm.size())
        return Error{fmt::format("triangle {} names vertex {} of {}", i, v, mesh.vertices_mm.size()),
                     "repair the mesh",
                     {},
                     0};
  return Done{};
}

/// One use of an edge: the vertex at its higher-numbered end, and facet * 4 + edge.
constexpr std::uint64_t edge_use(std::uint32_t high, std::uint32_t facet, std::uint32_t edge) noexcept {
  return (std::uint64_t{high} << 32) | (facet * 4u + edge);
}

}  // namespace

Result<SurfaceMesh> SurfaceMesh::build(const geometry::TriangleMesh& mesh, int threads) {
  PALPATE_TRY(check(mesh));
  SurfaceMesh result;
  const std::vector<std::uint32_t> welded = weld(mesh.vertices_mm, result.vertices_);
  result.counts_.vertices = result.vertices_.size();
  result.counts_.welded_vertices = welded.size() - result.vertices_.size();

  geometry::Aabb world_box;
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t v : triangle) world_box.add(mesh.vertices_mm[v]);
  result.origin_mm_ = world_box.centre_mm();
  for (Vec3& v : result.vertices_) v -= result.origin_mm_;

  result.facets_.reserve(mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) {
    const std::array<std::uint32_t, 3> v{welded[triangle[0]], welded[triangle[1]], welded[triangle[2]]};
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) {
      ++result.counts_.collapsed_facets;
      continue;
    }
    Facet facet{};
    facet.vertex = v;
    facet.across = {kNoFacet, kNoFacet, kNoFacet};
    for (std::size_t i = 0; i < 3; ++i) {
      facet.corner[i] = result.vertices_[v[i]];
      result.box_.add(facet.corner[i]);
    }
    result.facets_.push_back(facet);
  }
  if (result.facets_.empty())
    return Error{"the mesh has no triangle with three different corners", "use a mesh with faces", {}, 0};
  result.rounding_mm_ = gamma(kOperations) * result.box_.extent_mm().norm();
  static_cast<void>(threads);
  std::vector<bool> two_sided(result.facets_.size(), false);
  result.connect(two_sided);
  for (const Facet& facet : result.facets_) {
    const double sides =
        (facet.corner[1] - facet.corner[0]).norm() * (facet.corner[2] - facet.corner[0]).norm();
    result.counts_.flat_facets += facet.scaled_normal().norm() <= kFlat * sides;
  }
  return result;
}

bool SurfaceMesh::drop_repeated(const Starts& begin, const Uses& uses, std::vector<bool>& two_sided) {
  const auto facet_at = [&](std::size_t i) { return static_cast<std::uint32_t>(uses[i]) / 4; };
  const auto edge_at = [&](std::size_t i) { return static_cast<std::uint32_t>(uses[i]) % 4; };
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
  const auto facet_at = [&](std::size_t i) { return static_cast<std::uint32_t>(uses[i]) / 4; };
  // visit(first, last): the uses of one edge.
  const auto for_edges = [&](const auto& visit) {
    for (std::size_t v = 0; v + 1 < begin.size(); ++v)
      for (std::size_t i = begin[v], end = i; i < begin[v + 1]; i = end) {
        while (end < begin[v + 1] && (uses[end] >> 32) == (uses[i] >> 32)) ++end;
        visit(i, end);
      }
  };
  constexpr std::size_t kSurface = 2;  // facets at an edge of one
  std::vector<bool> free(facets_.size(), false), fin(two_sided);
  for_edges([&](std::size_t first, std::size_t last) {
    if (last - first == 1) free[facet_at(first)] = true;
    if (last - first == kSurface) fin[facet_at(first)] = fin[facet_at(first + 1)] = false;
  });
  for (std::size_t i = 0; i < fin.size(); ++i) fin[i] = fin[i] && free[i];
  for_edges([&](std::size_t first, std::size_t last) {
    std::size_t others = 0;
    for (std::size_t i = first; i < last; ++i) others += !fin[facet_at(i)];
    if (last - first > 1 && others < kSurface)
      for (std::size_t i = first; i < last; ++i) fin[facet_at(i)] = false;
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
    facets_[kept++] = facets_[i];
  }
  facets_.resize(kept);
  two_sided.resize(kept);
  counts_.two_sided_facets = static_cast<std::size_t>(std::count(two_sided.begin(), two_sided.end(), true));
}

void SurfaceMesh::connect(std::vector<bool>& two_sided) {
  const std::size_t n = vertices_.size();
  // Buckets of edges by their lower-numbered vertex, in order of facets; then equal edges are a few
  // neighbours.
  std::vector<std::uint32_t> begin(n + 1, 0);
  for (const Facet& f : facets_)
    for (std::uint32_t e = 0; e < 3; ++e) ++begin[std::min(f.vertex[e], f.vertex[after(e)]) + 1];
  for (std::size_t v = 0; v < n; ++v) begin[v + 1] += begin[v];
  std::vector<std::uint64_t> uses(facets_.size() * 3);
  std::vector<std::uint32_t> fill(begin.begin(), begin.end() - 1);
  for (std::uint32_t i = 0; i < facets_.size(); ++i)
    for (std::uint32_t e = 0; e < 3; ++e) {
      const std::uint32_t a = facets_[i].vertex[e], b = facets_[i].vertex[after(e)];
      uses[fill[std::min(a, b)]++] = edge_use(std::max(a, b), i, e);
    }
  for (std::size_t v = 0; v < n; ++v) std::sort(uses.begin() + begin[v], uses.begin() + begin[v + 1]);
  // Sheets that lie on one another are one: between them there is no room for a god object.
  if (drop_repeated(begin, uses, two_sided)) return connect(two_sided);
  if (counts_.two_sided_facets > 0 && drop_fins(begin, uses, two_sided)) return connect(two_sided);
  for (std::size_t v = 0; v < n; ++v) {
    const auto first = uses.begin() + begin[v], last = uses.begin() + begin[v + 1];
    for (auto run = first; run != last;) {
      auto stop = run;
      while (stop != last && (*stop >> 32) == (*run >> 32)) ++stop;
      connect_edge(std::span<const std::uint64_t>(run, stop), two_sided);
      run = stop;
    }
  }
  star_begin_.assign(n + 1, 0);
  for (const Facet& f : facets_)
    for (const std::uint32_t v : f.vertex) ++star_begin_[v + 1];
  for (std::size_t v = 0; v < n; ++v) star_begin_[v + 1] += star_begin_[v];
  star_.resize(facets_.size() * 3);
  fill.assign(star_begin_.begin(), star_begin_.end() - 1);
  for (std::uint32_t i = 0; i < facets_.size(); ++i)
    for (const std::uint32_t v : facets_[i].vertex) star_[fill[v]++] = i;
}

void SurfaceMesh::connect_edge(std::span<const std::uint64_t> uses, const std::vector<bool>& two_sided) {
  const auto facet_at = [&](std::size_t i) { return static_cast<std::uint32_t>(uses[i]) / 4; };
  const auto edge_at = [&](std::size_t i) { return static_cast<std::uint32_t>(uses[i]) % 4; };
  ++counts_.edges;
  if (uses.size() == 1) {
    if (two_sided[facet_at(0)])
      facets_[facet_at(0)].across[edge_at(0)] = half_facet(facet_at(0), 1);
    else
      ++counts_.boundary_edges;
    return;
  }
  if (uses.size() > 2) {
    connect_radial(uses);
    return;
  }
  Facet& f = facets_[facet_at(0)];
  Facet& g = facets_[facet_at(1)];
  // Running the same way along the edge means that the two look to opposite sides.
  const std::uint32_t flip = f.vertex[edge_at(0)] == g.vertex[edge_at(1)] ? 1u : 0u;
  counts_.flipped_edges += flip;
  f.across[edge_at(0)] = half_facet(facet_at(1), flip);
  g.across[edge_at(1)] = half_facet(facet_at(0), flip);
}

/// Sorts the facets by angle around the edge. Side 0 of a facet that runs along the edge faces growing
/// angles, of one that runs against it falling angles; each side's neighbour is the next facet that way.
void SurfaceMesh::connect_radial(std::span<const std::uint64_t> uses) {
  ++counts_.radial_edges;
  struct Leaf {
    double angle;
    std::uint32_t facet, edge, along;
  };
  std::vector<Leaf> leaves;
  Vec3 axis, u, w;
  for (std::size_t i = 0; i < uses.size(); ++i) {
    const std::uint32_t index = static_cast<std::uint32_t>(uses[i]) / 4,
                        edge = static_cast<std::uint32_t>(uses[i]) % 4;
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
    // The side of `up` that looks down, and of `down` that looks up.
    const HalfFacet rising = half_facet(up.facet, up.along);
    const HalfFacet falling = half_facet(down.facet, 1u - down.along);
    facets_[here.facet].across[here.edge] = kRadialBase + static_cast<std::uint32_t>(radial_.size());
    radial_.push_back(here.along != 0 ? std::array<HalfFacet, 2>{rising, falling}
                                      : std::array<HalfFacet, 2>{falling, rising});
  }
}

std::size_t SurfaceMesh::bytes() const noexcept {
  return vertices_.capacity() * sizeof(Vec3) + facets_.capacity() * sizeof(Facet) +
         (star_begin_.capacity() + star_.capacity()) * sizeof(std::uint32_t) +
         radial_.capacity() * sizeof(radial_[0]);
}

double SurfaceMesh::longest_edge_sq(std::uint32_t facet) const noexcept {
  const Facet& f = facets_[facet];
  double longest = 0.0;
  for (std::uint32_t e = 0; e < 3; ++e)
    longest = std::max(longest, (f.corner[after(e)] - f.corner[e]).squaredNorm());
  return longest;
}

Vec3 SurfaceMesh::normal(HalfFacet half) const noexcept {
  const Facet& f = facets_[facet_of(half)];
  const Vec3 n = f.scaled_normal();
  const double size = n.norm();
  if (size <= kFlat * (f.corner[1] - f.corner[0]).norm() * (f.corner[2] - f.corner[0]).norm())
    return Vec3::Zero();
  return n * ((side_of(half) == 0 ? 1.0 : -1.0) / size);
}

namespace {

double corner_angle(const Facet& f, std::uint32_t corner) noexcept {
  const Vec3 u = f.corner[after(corner)] - f.corner[corner];
  const Vec3 w = f.corner[before(corner)] - f.corner[corner];
  return std::atan2(u.cross(w).norm(), u.dot(w));
}

Vec3 unit_or_zero(const Vec3& v, double noise) noexcept {
  const double size = v.norm();
  return size > noise ? Vec3(v / size) : Vec3(Vec3::Zero());
}

}  // namespace

bool SurfaceMesh::goes_round(HalfFacet half, Feature feature) const noexcept {
  const HalfFacet back = half ^ 1u;
  if (feature == kInside) return false;
  if (feature < kCorner) return neighbour(half, static_cast<std::uint32_t>(feature - kEdge)) == back;
  bool round = false;
  around_corner(half, static_cast<std::uint32_t>(feature - kCorner),
                [&](HalfFacet other) { round = round || other == back; });
  return round;
}

Vec3 SurfaceMesh::pseudonormal(HalfFacet half, Feature feature, bool* boundary) const noexcept {
  *boundary = false;
  if (feature == kInside) return normal(half);
  if (feature < kCorner) {
    const HalfFacet other = neighbour(half, static_cast<std::uint32_t>(feature - kEdge));
    *boundary = other == kNoFacet;
    if (*boundary) return normal(half);
    return unit_or_zero(normal(half) + normal(other), kFlat);
  }
  const std::uint32_t corner = static_cast<std::uint32_t>(feature - kCorner);
  const std::uint32_t vertex = facets_[facet_of(half)].vertex[corner];
  Vec3 sum = normal(half) * corner_angle(facets_[facet_of(half)], corner);
  *boundary = around_corner(half, corner, [&](HalfFacet other) {
    const Facet& f = facets_[facet_of(other)];
    std::uint32_t at = 0;
    while (at < 2 && f.vertex[at] != vertex) ++at;
    sum += normal(other) * corner_angle(f, at);
  });
  return *boundary ? normal(half) : unit_or_zero(sum, kFlat);
}

}  // namespace palpate::baselines
