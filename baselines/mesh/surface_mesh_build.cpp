// How SurfaceMesh is made: welding, numbering, facets. What connects them is in connect.cpp.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "baselines/mesh/surface_mesh.h"
#include "toolkit/core/try.h"
#include "toolkit/partition/morton_order.h"

namespace palpate::baselines {
namespace {

/// Facets that 2 * facet + side can number below the codes of radial edges.
constexpr std::size_t kMaxFacets = std::size_t{1} << 29;
/// Operations that a walk puts between corners and a result, generously.
constexpr int kOperations = 64;
constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

/// The first index below `count` that is bad, or kNone.
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

/// The box of what visit(i, box) adds for each i below `count`.
template <class Visit>
geometry::Aabb box_of(std::size_t count, int threads, const Visit& visit) {
  std::vector<geometry::Aabb> parts((count + kPointsPerChunk - 1) / kPointsPerChunk);
  parallel_chunks(count, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    geometry::Aabb box;
    for (std::size_t i = begin; i < end; ++i) visit(i, box);
    parts[begin / kPointsPerChunk] = box;
  });
  geometry::Aabb box;
  for (const geometry::Aabb& part : parts) box.add(part);
  return box;
}

Status check(const geometry::TriangleMesh& mesh, int threads) {
  const auto& vertices = mesh.vertices_mm;
  const auto& triangles = mesh.triangles;
  if (triangles.size() >= kMaxFacets || vertices.size() >= kNoFacet)
    return Error{fmt::format("a mesh of {} triangles is more than can be numbered", triangles.size()),
                 fmt::format("decimate it below {}", kMaxFacets),
                 {},
                 0};
  if (const std::size_t i =
          first_bad(vertices.size(), threads, [&](std::size_t v) { return !is_finite(vertices[v]); });
      i != kNone)
    return Error{fmt::format("vertex {} of the mesh is not finite", i), "repair the mesh", {}, 0};
  const auto out_of_range = [&](std::uint32_t v) { return v >= vertices.size(); };
  const std::size_t i = first_bad(triangles.size(), threads, [&](std::size_t t) {
    return out_of_range(triangles[t][0]) || out_of_range(triangles[t][1]) || out_of_range(triangles[t][2]);
  });
  if (i == kNone) return Done{};
  return Error{
      fmt::format("triangle {} names vertex {} of {}", i,
                  *std::find_if(triangles[i].begin(), triangles[i].end(), out_of_range), vertices.size()),
      "repair the mesh",
      {},
      0};
}

/// Vertices along a Morton curve: places that are equal to the last bit are in one cube.
partition::MortonOrder along_curve(const std::vector<Vec3>& given, const geometry::Aabb& used, int threads) {
  const std::size_t n = given.size();
  const Vec3 middle = used.centre_mm();
  cloud::Cloud places;
  places.x_mm.resize(n);
  places.y_mm.resize(n);
  places.z_mm.resize(n);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3f p = (given[i] - middle).cast<float>();
      places.x_mm[i] = p.x();
      places.y_mm[i] = p.y();
      places.z_mm[i] = p.z();
    }
  });
  // n vertices of a sheet are some sqrt(n) a side: cubes of half their spacing keep them apart, and finer
  // ones would cost passes of the sort. Which cubes are taken decides speed alone.
  const int bits = std::min(static_cast<int>(std::ceil(std::log2(static_cast<double>(n)) / 2.0)) + 1,
                            partition::kMortonBits - 1);
  const double unit =
      std::max(std::ldexp(used.extent_mm().maxCoeff(), -bits), std::numeric_limits<double>::min());
  const geometry::Aabb local{used.low_mm - middle, used.high_mm - middle};
  return partition::sort_by_morton(places, partition::Lattice::over(local.grown(unit), unit), threads);
}

/// Before which place a vertex stands among others of its cube; equal places by number.
struct ByPlace {
  const std::vector<Vec3>& given;
  bool operator()(std::uint32_t i, std::uint32_t j) const noexcept {
    for (int axis = 0; axis < 3; ++axis)
      if (given[i][axis] != given[j][axis]) return given[i][axis] < given[j][axis];
    return i < j;
  }
};

/// For every vertex the first one at the same place. In `sorted` equal places then stand together, the first
/// of them first.
std::vector<std::uint32_t> first_at_place(const std::vector<Vec3>& given, partition::MortonOrder& sorted,
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
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    // A cube belongs to the chunk that it begins in.
    for (std::size_t k = begin; k < end; ++k) {
      if (k > 0 && codes[k] == codes[k - 1]) continue;
      std::size_t stop = k + 1;
      while (stop < n && codes[stop] == codes[k]) ++stop;
      one_cube(k, stop);
    }
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
    return Error{"the mesh has no triangle with three different corners", "use a mesh with faces", {}, 0};
  geometry::Aabb numbers = result.box_;  // as large as coordinates are; about its own middle the box itself
  if (frame == MeshFrame::kWorld) numbers.add(Vec3::Zero());
  result.rounding_mm_ = gamma(kOperations) * numbers.extent_mm().norm();
  result.connect(threads);
  result.count_flat(threads);
  result.find_largest_fan();
  return result;
}

std::vector<std::uint32_t> SurfaceMesh::weld(const std::vector<Vec3>& given, const geometry::Aabb& used,
                                             int threads, MeshOrder order) {
  const std::size_t n = given.size();
  partition::MortonOrder sorted = along_curve(given, used, threads);
  const std::vector<std::uint32_t> first = first_at_place(given, sorted, threads);
  std::vector<std::uint32_t> number(n);
  std::uint32_t count = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = order == MeshOrder::kCurve ? sorted.order[k] : k;
    number[i] = first[i] == i ? count++ : number[first[i]];
  }
  vertices_.resize(count);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
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
  UnfilledVector<std::uint32_t> kept;
  if (order == MeshOrder::kCurve) {
    const auto lowest = [&](std::size_t t, const auto& visit) {
      const auto v = corners(t);
      if (!collapsed(v)) visit(std::min({v[0], v[1], v[2]}));
    };
    kept = in_buckets(vertices_.size(), mesh.triangles.size(), threads, lowest).items;
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
  std::vector<std::size_t> parts((facets_.size() + kPointsPerChunk - 1) / kPointsPerChunk, 0);
  parallel_chunks(facets_.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      parts[begin / kPointsPerChunk] += facets_[i].flat(facets_[i].scaled_normal().norm());
  });
  counts_.flat_facets = std::accumulate(parts.begin(), parts.end(), std::size_t{0});
}

void SurfaceMesh::find_largest_fan() {
  for (std::uint32_t v = 0; v < vertices_.size(); ++v)
    counts_.largest_fan = std::max(counts_.largest_fan, star(v).size());
}

}  // namespace palpate::baselines
