// Builds a SurfaceMesh: welding, numbering, facets. Connections: connect.cpp.

#include "baselines/mesh/surface_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <palpate/result.h>
#include "toolkit/geometry/triangle_meshes.h"
#include "toolkit/search/morton_order.h"

namespace palpate::baselines {
namespace {

/// Limit for 2 * facet + side to stay below the codes of radial edges.
constexpr std::size_t kMaxFacets = std::size_t{1} << 29;
/// Generous count of operations between corners and a result.
constexpr int kOperations = 64;
constexpr std::uint64_t kPlacesSeed = 1;
constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

template <class Bad>
std::size_t first_bad(std::size_t count, int threads, const Bad& bad) {
  std::vector<std::size_t> first((count + kPointsPerChunk - 1) / kPointsPerChunk, kNone);
  parallel_chunks(count, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::size_t i = begin;
    while (i < end && !bad(i)) ++i;
    if (i < end) first[begin / kPointsPerChunk] = i;
  });
  const auto found = std::find_if(first.begin(), first.end(), [](std::size_t i) { return i != kNone; });
  return found == first.end() ? kNone : *found;
}

/// Box of all that visit(i, box) adds for i < `count`.
template <class Visit>
geometry::Aabb box_of(std::size_t count, int threads, const Visit& visit) {
  geometry::Aabb box;
  for (const auto& part : parallel_parts<geometry::Aabb>(count, kPointsPerChunk, threads, visit))
    box.add(part);
  return box;
}

Status check(const geometry::TriangleMesh& mesh, int threads) {
  const auto& vertices = mesh.vertices_mm;
  const auto& triangles = mesh.triangles;
  if (triangles.size() >= kMaxFacets || vertices.size() >= kNoFacet)
    return Error{fmt::format("a mesh of {} triangles is more than can be numbered", triangles.size()),
                 fmt::format("decimate it below {}", kMaxFacets)};
  if (const std::size_t i =
          first_bad(vertices.size(), threads, [&](std::size_t v) { return !is_finite(vertices[v]); });
      i != kNone)
    return Error{fmt::format("vertex {} of the mesh is not finite", i), "repair the mesh"};
  const auto out_of_range = [&](std::uint32_t v) { return v >= vertices.size(); };
  const std::size_t i = first_bad(triangles.size(), threads, [&](std::size_t t) {
    return out_of_range(triangles[t][0]) || out_of_range(triangles[t][1]) || out_of_range(triangles[t][2]);
  });
  if (i == kNone) return Done{};
  return Error{
      fmt::format("triangle {} names vertex {} of {}", i,
                  *std::find_if(triangles[i].begin(), triangles[i].end(), out_of_range), vertices.size()),
      "repair the mesh"};
}

/// Vertices along a Morton curve; bitwise equal places share a cube.
search::MortonOrder along_curve(const std::vector<Vec3>& given, const geometry::Aabb& used, int threads) {
  const std::size_t n = given.size();
  const Vec3 middle = used.centre_mm();
  cloud::Cloud places;
  places.x_mm.resize(n);
  places.y_mm.resize(n);
  places.z_mm.resize(n);
  parallel_each(n, kPointsPerChunk, threads, [&](std::size_t i) {
    const Vec3f p = (given[i] - middle).cast<float>();
    places.x_mm[i] = p.x();
    places.y_mm[i] = p.y();
    places.z_mm[i] = p.z();
  });
  // n vertices of a sheet have about sqrt(n) a side: cubes of half their spacing separate them; finer ones
  // cost sorting passes. Affects speed only.
  const int bits = std::min(static_cast<int>(std::ceil(std::log2(static_cast<double>(n)) / 2.0)) + 1,
                            search::kMortonBits - 1);
  const double unit =
      std::max(std::ldexp(used.extent_mm().maxCoeff(), -bits), std::numeric_limits<double>::min());
  const geometry::Aabb local{used.low_mm - middle, used.high_mm - middle};
  return search::sort_by_morton(places, search::Lattice::over(local.grown(unit), unit), threads);
}

/// Order of vertices within a cube; equal places by number.
struct ByPlace {
  const std::vector<Vec3>& given;
  bool operator()(std::uint32_t i, std::uint32_t j) const noexcept {
    for (int axis = 0; axis < 3; ++axis)
      if (given[i][axis] != given[j][axis]) return given[i][axis] < given[j][axis];
    return i < j;
  }
};

/// First vertex at each vertex's place. Then equal places are adjacent in `sorted`, the first of them first.
std::vector<std::uint32_t> first_at_place(const std::vector<Vec3>& given, search::MortonOrder& sorted,
                                          int threads) {
  const std::size_t n = given.size();
  std::vector<std::uint32_t> first(n);
  const auto& codes = sorted.codes;
  auto& order = sorted.order;
  const auto one_cube = [&](std::size_t begin, std::size_t end) {
    if (end - begin > 1)
      std::sort(order.begin() + static_cast<std::ptrdiff_t>(begin),
                order.begin() + static_cast<std::ptrdiff_t>(end), ByPlace{given});
    std::uint32_t at = order[begin];
    for (std::size_t k = begin; k < end; ++k) {
      if (given[order[k]] != given[at]) at = order[k];
      first[order[k]] = at;
    }
  };
  parallel_each(n, kPointsPerChunk, threads, [&](std::size_t k) {
    // A cube belongs to the point with which it begins.
    if (k > 0 && codes[k] == codes[k - 1]) return;
    std::size_t stop = k + 1;
    while (stop < n && codes[stop] == codes[k]) ++stop;
    one_cube(k, stop);
  });
  return first;
}

}  // namespace

Result<SurfaceMesh> SurfaceMesh::build(const geometry::TriangleMesh& mesh, int threads, MeshOrder order,
                                       MeshFrame frame) {
  PALPATE_TRY(check(mesh, threads));
  SurfaceMesh result;
  const geometry::Aabb used = box_of(mesh.triangles.size(), threads, [&](std::size_t t, geometry::Aabb& box) {
    for (const std::uint32_t v : mesh.triangles[t]) box.add(mesh.vertices_mm[v]);
  });
  if (frame == MeshFrame::kLocal) result.origin_mm_ = used.centre_mm();
  const std::vector<std::uint32_t> welded = result.weld(mesh.vertices_mm, used, threads, order);
  result.fill_facets(mesh, welded, threads, order);
  if (result.facets_.empty())
    return Error{"the mesh has no triangle with three different corners", "use a mesh with faces"};
  geometry::Aabb numbers = result.box_;  // as large as coordinates; about its own centre the box itself
  if (frame == MeshFrame::kWorld) numbers.add(Vec3::Zero());
  result.rounding_mm_ = rounding_of(numbers);
  result.connect(threads);
  result.count_flat(threads);
  result.find_largest_fan();
  return result;
}

double SurfaceMesh::rounding_of(const geometry::Aabb& numbers) noexcept {
  return gamma(kOperations) * numbers.extent_mm().norm();
}

std::vector<std::uint32_t> SurfaceMesh::weld(const std::vector<Vec3>& given, const geometry::Aabb& used,
                                             int threads, MeshOrder order) {
  const std::size_t n = given.size();
  search::MortonOrder sorted = along_curve(given, used, threads);
  const std::vector<std::uint32_t> first = first_at_place(given, sorted, threads);
  std::vector<std::uint32_t> number(n);
  std::uint32_t count = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = order == MeshOrder::kCurve ? sorted.order[k] : k;
    number[i] = first[i] == i ? count++ : number[first[i]];
  }
  vertices_.resize(count);
  parallel_each(n, kPointsPerChunk, threads, [&](std::size_t i) {
    if (first[i] == i) vertices_[number[i]] = given[i] - origin_mm_;
  });
  counts_.vertices = count;
  counts_.welded_vertices = n - count;
  return number;
}

void SurfaceMesh::fill_facets(const geometry::TriangleMesh& mesh, const std::vector<std::uint32_t>& welded,
                              int threads, MeshOrder order) {
  const auto corners = [&](std::size_t t) -> std::array<std::uint32_t, 3> {
    const auto& given = mesh.triangles[t];
    return {welded[given[0]], welded[given[1]], welded[given[2]]};
  };
  const auto collapsed = [](const std::array<std::uint32_t, 3>& v) {
    return v[0] == v[1] || v[1] == v[2] || v[2] == v[0];
  };
  LargePageUninitializedVector<std::uint32_t> kept;
  if (order == MeshOrder::kCurve) {
    const auto lowest = [&](std::size_t t, const auto& visit) {
      const auto v = corners(t);
      if (!collapsed(v)) visit(std::min({v[0], v[1], v[2]}));
    };
    kept = group_by_key(vertices_.size(), mesh.triangles.size(), threads, lowest).items;
  } else {
    kept.reserve(mesh.triangles.size());
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
      if (!collapsed(corners(t))) kept.push_back(t);
  }
  counts_.collapsed_facets = mesh.triangles.size() - kept.size();
  facets_.resize(kept.size());
  box_ = box_of(kept.size(), threads, [&](std::size_t i, geometry::Aabb& box) {
    Facet& facet = facets_[i];
    facet.vertex = corners(kept[i]);
    facet.across = {kNoFacet, kNoFacet, kNoFacet};
    for (std::size_t c = 0; c < 3; ++c) {
      facet.corner[c] = vertices_[facet.vertex[c]];
      box.add(facet.corner[c]);
    }
  });
}

void SurfaceMesh::count_flat(int threads) {
  const auto parts = parallel_parts<std::size_t>(facets_.size(), kPointsPerChunk, threads,
                                                 [this](std::size_t i, std::size_t& part) {
                                                   part += facets_[i].flat(facets_[i].scaled_normal().norm());
                                                 });
  counts_.flat_facets = std::accumulate(parts.begin(), parts.end(), std::size_t{0});
}

void SurfaceMesh::find_largest_fan() {
  for (std::uint32_t v = 0; v < vertices_.size(); ++v)
    counts_.largest_fan = std::max(counts_.largest_fan, star(v).size());
}

geometry::TriangleMesh SurfaceMesh::as_mesh() const {
  geometry::TriangleMesh mesh;
  mesh.vertices_mm.reserve(vertices_.size());
  for (const Vec3& v : vertices_) mesh.vertices_mm.push_back(v + origin_mm_);
  mesh.triangles.reserve(facets_.size());
  for (const Facet& facet : facets_) mesh.triangles.push_back(facet.vertex);
  return mesh;
}

std::size_t SurfaceMesh::bytes() const noexcept {
  return vertices_.capacity() * sizeof(Vec3) + facets_.capacity() * sizeof(Facet) +
         (stars_.begin.capacity() + stars_.items.capacity()) * sizeof(std::uint32_t) +
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
  if (f.flat(size)) return Vec3::Zero();
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

bool SurfaceMesh::is_free_edge(HalfFacet half, Feature feature) const noexcept {
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

std::vector<Vec3f> interpolation_normals(const SurfaceMesh& mesh) {
  std::vector<Vec3f> normals(mesh.vertices().size(), Vec3f::Zero());
  for (std::uint32_t v = 0; v < normals.size(); ++v) {
    if (mesh.star(v).empty()) continue;
    const std::uint32_t facet = mesh.star(v)[0];
    std::uint32_t corner = 0;
    while (corner < 2 && mesh.facet(facet).vertex[corner] != v) ++corner;
    Vec3 sum = mesh.facet(facet).scaled_normal();
    mesh.around_corner(half_facet(facet, 0), corner, [&](HalfFacet half) {
      sum += mesh.facet(facet_of(half)).scaled_normal() * (side_of(half) == 0 ? 1.0 : -1.0);
    });
    const double size = sum.norm();
    if (size > 0.0) normals[v] = (sum / size).cast<float>();
  }
  return normals;
}

std::array<double, 3> corner_shares(const Facet& f, const Vec3& point) noexcept {
  std::array<double, 3> share;
  double sum = 0.0;
  for (std::uint32_t i = 0; i < 3; ++i) {
    share[i] = (f.corner[after(i)] - point).cross(f.corner[before(i)] - point).norm();
    sum += share[i];
  }
  if (!(sum > 0.0)) return {1.0, 0.0, 0.0};
  for (double& s : share) s /= sum;
  return share;
}

std::vector<Vec3> places_on(const geometry::TriangleMesh& mesh, std::size_t count) {
  const geometry::MeshSurfaceSampler picker(mesh);
  std::vector<Vec3> places;
  if (!(picker.area() > 0.0)) return places;
  Random random(kPlacesSeed);
  for (std::size_t i = 0; i < count; ++i) {
    const double at =
        picker.area() * (static_cast<double>(i) + random.uniform()) / static_cast<double>(count);
    places.push_back(picker.pick_at(at, random).point);
  }
  return places;
}

Vec3 interpolated_normal(const Facet& f, std::span<const Vec3f> vertex_normals, const Vec3& point,
                         const Vec3& side) noexcept {
  const std::array<double, 3> share = corner_shares(f, point);
  Vec3 blend = Vec3::Zero();
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 corner_normal = vertex_normals[f.vertex[i]].cast<double>();
    blend += corner_normal * (corner_normal.dot(side) < 0.0 ? -share[i] : share[i]);
  }
  const double size = blend.norm();
  return size > 0.0 ? Vec3(blend / size) : side;
}

}  // namespace palpate::baselines
