#include "baselines/reconstruct/fixed_order.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "baselines/mesh/buckets.h"

namespace palpate::baselines {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

/// Of a triangle that starts at its lowest vertex.
std::uint32_t middle(const Triangle& t) noexcept {
  return std::min(t[1], t[2]);
}
std::uint32_t highest(const Triangle& t) noexcept {
  return std::max(t[1], t[2]);
}

/// Calls body(first, last) with places in buckets.items for every bucket, in parallel.
template <class Body>
void for_buckets(const Buckets& buckets, int threads, const Body& body) {
  parallel_chunks(buckets.begin.size() - 1, kPointsPerChunk, threads, [&](std::size_t from, std::size_t to) {
    for (std::size_t v = from; v < to; ++v) body(buckets.begin[v], buckets.begin[v + 1]);
  });
}

/// Triangles by their corners, whichever way round they run; of equal ones the one given first is first.
void order_by_corners(geometry::TriangleMesh& mesh, Buckets& of_lowest, int threads) {
  of_lowest = in_buckets(mesh.vertices_mm.size(), mesh.triangles.size(), threads,
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

/// Pairs of triangles that share an edge, enough of them to connect all at each edge.
std::vector<std::vector<std::pair<std::uint32_t, std::uint32_t>>> neighbours(
    const geometry::TriangleMesh& mesh, int threads) {
  const std::size_t vertices = mesh.vertices_mm.size();
  // An edge belongs to its lower end: the lowest corner has two of them, the middle one the third.
  const Buckets around =
      in_buckets(vertices, mesh.triangles.size(), threads, [&](std::size_t t, const auto& visit) {
        visit(mesh.triangles[t][0]);
        visit(middle(mesh.triangles[t]));
      });
  std::vector<std::vector<std::pair<std::uint32_t, std::uint32_t>>> parts((vertices + kPointsPerChunk - 1) /
                                                                          kPointsPerChunk);
  parallel_chunks(vertices, kPointsPerChunk, threads, [&](std::size_t from, std::size_t to) {
    std::vector<std::pair<std::uint32_t, std::uint32_t>> uses;  // the edge's higher end, the triangle
    auto& found = parts[from / kPointsPerChunk];
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
  });
  return parts;
}

/// The first triangle of each one's piece.
std::vector<std::uint32_t> firsts_of_pieces(const geometry::TriangleMesh& mesh, int threads) {
  std::vector<std::uint32_t> first(mesh.triangles.size());
  for (std::uint32_t t = 0; t < first.size(); ++t) first[t] = t;
  const auto root = [&](std::uint32_t t) {
    while (first[t] != t) t = first[t] = first[first[t]];
    return t;
  };
  for (const auto& part : neighbours(mesh, threads))
    for (const auto& [a, b] : part) {
      const std::uint32_t x = root(a), y = root(b);
      first[std::max(x, y)] = std::min(x, y);
    }
  for (std::uint32_t t = 0; t < first.size(); ++t)
    first[t] = first[first[t]];  // what is before it is finished
  return first;
}

}  // namespace

void fix_order(geometry::TriangleMesh& mesh, int threads) {
  const auto for_all = [&](const auto& body) {
    parallel_chunks(mesh.triangles.size(), kPointsPerChunk, threads, [&](std::size_t from, std::size_t to) {
      for (std::size_t t = from; t < to; ++t) body(t, mesh.triangles[t]);
    });
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

}  // namespace palpate::baselines
