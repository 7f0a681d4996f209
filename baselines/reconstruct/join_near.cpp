#include "baselines/reconstruct/join_near.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <vector>

namespace palpate::baselines {
namespace {

using Corners = std::array<std::uint32_t, 3>;

/// For every vertex the first of those that short edges connect it with.
std::vector<std::uint32_t> firsts(const geometry::TriangleMesh& mesh, double distance) {
  std::vector<std::uint32_t> first(mesh.vertices_mm.size());
  std::iota(first.begin(), first.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (first[v] != v) v = first[v] = first[first[v]];
    return v;
  };
  for (const Corners& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = t[i], b = t[(i + 1) % 3];
      if ((mesh.vertices_mm[a] - mesh.vertices_mm[b]).squaredNorm() > distance * distance) continue;
      const std::uint32_t low = std::min(root(a), root(b)), high = std::max(root(a), root(b));
      first[high] = low;
    }
  for (std::uint32_t v = 0; v < first.size(); ++v) first[v] = root(v);
  return first;
}

/// Which way round a triangle's corners run.
bool odd(const Corners& t) {
  return (t[0] < t[1]) != ((t[1] < t[2]) != (t[0] < t[2]));
}

/// Marks triangles with the same corners that run opposite ways, two by two.
void mark_back_to_back(const std::vector<Corners>& triangles, std::vector<bool>& gone) {
  struct Entry {
    Corners corners;
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

Joined join_near(geometry::TriangleMesh& mesh, double distance) {
  const std::vector<std::uint32_t> first = firsts(mesh, distance);
  Joined joined;
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
    Corners& t = mesh.triangles[i];
    for (std::uint32_t& v : t) v = number[first[v]];
    gone[i] = t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
  }
  mark_back_to_back(mesh.triangles, gone);
  std::vector<Corners> kept;
  for (std::size_t i = 0; i < gone.size(); ++i)
    if (!gone[i]) kept.push_back(mesh.triangles[i]);
  joined.triangles = mesh.triangles.size() - kept.size();
  mesh.vertices_mm = std::move(vertices);
  mesh.triangles = std::move(kept);
  return joined;
}

}  // namespace palpate::baselines
