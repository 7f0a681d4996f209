#include "baselines/reconstruct/fixed_order.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

namespace palpate::baselines {
namespace {

/// The piece of each triangle, by the number of one of its triangles.
std::vector<std::uint32_t> pieces_of(const geometry::TriangleMesh& mesh) {
  struct Edge {
    std::uint32_t low, high, triangle;
    bool operator<(const Edge& other) const noexcept {
      return std::pair(low, high) < std::pair(other.low, other.high);
    }
  };
  std::vector<Edge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
    for (std::size_t i = 0; i < 3; ++i) {
      const auto [low, high] = std::minmax(mesh.triangles[t][i], mesh.triangles[t][(i + 1) % 3]);
      edges.push_back({low, high, t});
    }
  std::sort(edges.begin(), edges.end());
  std::vector<std::uint32_t> piece(mesh.triangles.size());
  std::iota(piece.begin(), piece.end(), 0u);
  const auto root = [&](std::uint32_t t) {
    while (piece[t] != t) t = piece[t] = piece[piece[t]];
    return t;
  };
  for (std::size_t i = 1; i < edges.size(); ++i)
    if (!(edges[i - 1] < edges[i])) piece[root(edges[i].triangle)] = root(edges[i - 1].triangle);
  for (std::uint32_t t = 0; t < piece.size(); ++t) piece[t] = root(t);
  return piece;
}

}  // namespace

void fix_order(geometry::TriangleMesh& mesh) {
  for (auto& t : mesh.triangles) std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  const std::vector<std::uint32_t> piece = pieces_of(mesh);
  // The lowest triangle of a piece, whichever way round.
  const auto corners = [&](std::uint32_t t) {
    std::array<std::uint32_t, 3> c = mesh.triangles[t];
    std::sort(c.begin(), c.end());
    return c;
  };
  std::vector<std::uint32_t> lowest(piece.size(), 0xFFFFFFFFu);
  for (std::uint32_t t = 0; t < piece.size(); ++t) {
    std::uint32_t& best = lowest[piece[t]];
    if (best == 0xFFFFFFFFu || corners(t) < corners(best)) best = t;
  }
  std::vector<bool> turn(piece.size());
  for (std::uint32_t t = 0; t < piece.size(); ++t) {
    const auto& first = mesh.triangles[lowest[piece[t]]];
    turn[t] = first[1] > first[2];
  }
  for (std::uint32_t t = 0; t < piece.size(); ++t)
    if (turn[t]) std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
  std::sort(mesh.triangles.begin(), mesh.triangles.end());
}

}  // namespace palpate::baselines
