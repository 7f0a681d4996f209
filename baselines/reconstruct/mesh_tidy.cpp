#include "baselines/reconstruct/method_functions.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "toolkit/core/disjoint_sets.h"

namespace palpate::baselines {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

/// For triangles that start at their lowest vertex.
std::uint32_t middle(const Triangle& t) noexcept {
  return std::min(t[1], t[2]);
}
std::uint32_t highest(const Triangle& t) noexcept {
  return std::max(t[1], t[2]);
}

/// Calls body(first, last) in parallel with the range of each bucket in buckets.items.
template <class Body>
void for_buckets(const Buckets& buckets, int threads, const Body& body) {
  parallel_each(buckets.begin.size() - 1, kPointsPerChunk, threads,
                [&](std::size_t v) { body(buckets.begin[v], buckets.begin[v + 1]); });
}

/// Sorts triangles by corners regardless of orientation; equal ones keep their order.
void order_by_corners(geometry::TriangleMesh& mesh, Buckets& of_lowest, int threads) {
  of_lowest = group_by_key(mesh.vertices_mm.size(), mesh.triangles.size(), threads,
                           [&](std::size_t t, const auto& visit) { visit(mesh.triangles[t][0]); });
  std::vector<Triangle> ordered(mesh.triangles.size());
  for_buckets(of_lowest, threads, [&](std::uint32_t first, std::uint32_t last) {
    const auto key = [&](std::uint32_t t) {
      const Triangle& corners = mesh.triangles[t];
      return std::tuple(middle(corners), highest(corners), t);
    };
    std::sort(of_lowest.items.begin() + first, of_lowest.items.begin() + last,
              [&](std::uint32_t a, std::uint32_t b) { return key(a) < key(b); });
    for (std::uint32_t i = first; i < last; ++i) ordered[i] = mesh.triangles[of_lowest.items[i]];
  });
  mesh.triangles = std::move(ordered);
}

using IndexPair = std::pair<std::uint32_t, std::uint32_t>;

/// Pairs of triangles that share an edge, enough to connect all at each edge.
std::vector<IndexPair> neighbours(const geometry::TriangleMesh& mesh, int threads) {
  const std::size_t vertices = mesh.vertices_mm.size();
  // An edge belongs to its lower end: the lowest corner has two, the middle one the third.
  const Buckets around =
      group_by_key(vertices, mesh.triangles.size(), threads, [&](std::size_t t, const auto& visit) {
        visit(mesh.triangles[t][0]);
        visit(middle(mesh.triangles[t]));
      });
  const auto look = [&](std::size_t from, std::size_t to, std::vector<IndexPair>& found) {
    std::vector<IndexPair> uses;  // higher end of the edge, triangle
    for (std::size_t v = from; v < to; ++v) {
      uses.clear();
      for (std::uint32_t i = around.begin[v]; i < around.begin[v + 1]; ++i) {
        const std::uint32_t t = around.items[i];
        const Triangle& corners = mesh.triangles[t];
        if (corners[0] == v) uses.emplace_back(middle(corners), t);
        uses.emplace_back(highest(corners), t);
      }
      std::sort(uses.begin(), uses.end());
      for (std::size_t i = 1; i < uses.size(); ++i)
        if (uses[i - 1].first == uses[i].first) found.emplace_back(uses[i - 1].second, uses[i].second);
    }
  };
  return parallel_list<IndexPair>(vertices, kPointsPerChunk, threads, look);
}

/// The lowest member of every member's set.
std::vector<std::uint32_t> lowest_of(OrientedDisjointSets& sets, std::size_t members) {
  std::vector<std::uint32_t> lowest(members);
  for (std::uint32_t i = 0; i < members; ++i) lowest[i] = sets.find(i).set;
  return lowest;
}

std::vector<std::uint32_t> firsts_of_pieces(const geometry::TriangleMesh& mesh, int threads) {
  OrientedDisjointSets sets(mesh.triangles.size(), threads);
  for (const auto& [a, b] : neighbours(mesh, threads)) sets.join(a, b);
  return lowest_of(sets, mesh.triangles.size());
}

}  // namespace

void fix_order(geometry::TriangleMesh& mesh, int threads) {
  const auto for_all = [&](const auto& body) {
    parallel_each(mesh.triangles.size(), kPointsPerChunk, threads,
                  [&](std::size_t t) { body(t, mesh.triangles[t]); });
  };
  for_all([](std::size_t, Triangle& t) {
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  });
  Buckets of_lowest;
  order_by_corners(mesh, of_lowest, threads);
  const std::vector<std::uint32_t> first = firsts_of_pieces(mesh, threads);
  std::vector<std::uint8_t> turn(first.size());
  for_all([&](std::size_t t, const Triangle&) {
    turn[t] = mesh.triangles[first[t]][1] > mesh.triangles[first[t]][2];
  });
  for_all([&](std::size_t t, Triangle& corners) {
    if (turn[t] != 0) std::swap(corners[1], corners[2]);
  });
  for_buckets(of_lowest, threads, [&](std::uint32_t from, std::uint32_t to) {
    std::sort(mesh.triangles.begin() + from, mesh.triangles.begin() + to);
  });
}

namespace {

/// For each vertex the first one connected to it by short edges.
std::vector<std::uint32_t> firsts(const geometry::TriangleMesh& mesh, double distance) {
  OrientedDisjointSets sets(mesh.vertices_mm.size());
  for (const Triangle& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = t[i], b = t[(i + 1) % 3];
      if ((mesh.vertices_mm[a] - mesh.vertices_mm[b]).squaredNorm() <= distance * distance) sets.join(a, b);
    }
  return lowest_of(sets, mesh.vertices_mm.size());
}

/// Orientation of a triangle's corners.
bool odd(const Triangle& t) {
  return (t[0] < t[1]) != ((t[1] < t[2]) != (t[0] < t[2]));
}

/// Marks pairs of triangles with equal corners and opposite orientation.
void mark_back_to_back(const std::vector<Triangle>& triangles, std::vector<bool>& gone) {
  struct Entry {
    Triangle corners;
    std::uint32_t triangle;
  };
  std::vector<Entry> sorted;
  for (std::uint32_t i = 0; i < triangles.size(); ++i) {
    if (gone[i]) continue;
    sorted.push_back({triangles[i], i});
    std::sort(sorted.back().corners.begin(), sorted.back().corners.end());
  }
  std::sort(sorted.begin(), sorted.end(), [](const Entry& a, const Entry& b) {
    return a.corners != b.corners ? a.corners < b.corners : a.triangle < b.triangle;
  });
  std::vector<std::uint32_t> unmatched;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    if (i == 0 || sorted[i].corners != sorted[i - 1].corners) unmatched.clear();
    const std::uint32_t here = sorted[i].triangle;
    const auto other = std::find_if(unmatched.begin(), unmatched.end(), [&](std::uint32_t t) {
      return odd(triangles[t]) != odd(triangles[here]);
    });
    if (other == unmatched.end()) {
      unmatched.push_back(here);
      continue;
    }
    gone[*other] = gone[here] = true;
    unmatched.erase(other);
  }
}

}  // namespace

WeldCounts weld_vertices(geometry::TriangleMesh& mesh, double distance) {
  const std::vector<std::uint32_t> first = firsts(mesh, distance);
  WeldCounts joined;
  std::vector<std::uint32_t> number(first.size(), 0);
  std::vector<Vec3> vertices;
  for (std::uint32_t v = 0; v < first.size(); ++v) {
    if (first[v] != v) {
      ++joined.vertices;
      continue;
    }
    number[v] = static_cast<std::uint32_t>(vertices.size());
    vertices.push_back(mesh.vertices_mm[v]);
  }
  std::vector<bool> gone(mesh.triangles.size(), false);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    Triangle& t = mesh.triangles[i];
    for (std::uint32_t& v : t) v = number[first[v]];
    gone[i] = t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
  }
  mark_back_to_back(mesh.triangles, gone);
  std::vector<Triangle> kept;
  for (std::size_t i = 0; i < gone.size(); ++i)
    if (!gone[i]) kept.push_back(mesh.triangles[i]);
  joined.triangles = mesh.triangles.size() - kept.size();
  mesh.vertices_mm = std::move(vertices);
  mesh.triangles = std::move(kept);
  return joined;
}

}  // namespace palpate::baselines
