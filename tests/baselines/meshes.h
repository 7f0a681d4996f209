// Small meshes for the tests of the mesh side.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>

#include <palpate/geometry.h>
#include "baselines/proximity/segment_index.h"
#include "tests/toolkit/messages.h"

namespace palpate::test {

using geometry::TriangleMesh;

/// z = f(x, y) over [-half, half]^2, `cells` by `cells` squares of two triangles, seen from above.
inline TriangleMesh height_mesh(int cells, double half, const std::function<double(double, double)>& f) {
  TriangleMesh mesh;
  for (int row = 0; row <= cells; ++row)
    for (int column = 0; column <= cells; ++column) {
      const double x = -half + 2 * half * column / cells, y = -half + 2 * half * row / cells;
      mesh.vertices_mm.push_back({x, y, f(x, y)});
    }
  const auto at = [&](int row, int column) { return static_cast<std::uint32_t>(row * (cells + 1) + column); };
  for (int row = 0; row < cells; ++row)
    for (int column = 0; column < cells; ++column) {
      mesh.triangles.push_back({at(row, column), at(row, column + 1), at(row + 1, column + 1)});
      mesh.triangles.push_back({at(row, column), at(row + 1, column + 1), at(row + 1, column)});
    }
  return mesh;
}

/// z = 0 alike.
inline TriangleMesh flat_mesh(int cells, double half) {
  return height_mesh(cells, half, [](double, double) { return 0.0; });
}

/// The box [-x, x] x [-y, y] x [-z, z], outward.
inline TriangleMesh box_mesh(double x, double y, double z) {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) mesh.vertices_mm.push_back({i & 1 ? x : -x, i & 2 ? y : -y, i & 4 ? z : -z});
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

/// Every facet cut in four, `times` times; shared corners are repeated, bit for bit.
inline TriangleMesh subdivided(TriangleMesh mesh, int times) {
  for (; times > 0; --times) {
    TriangleMesh fine;
    const auto add = [&](const Vec3& a, const Vec3& b, const Vec3& c) {
      const auto first = static_cast<std::uint32_t>(fine.vertices_mm.size());
      fine.vertices_mm.insert(fine.vertices_mm.end(), {a, b, c});
      fine.triangles.push_back({first, first + 1, first + 2});
    };
    for (const auto& t : mesh.triangles) {
      const Vec3 a = mesh.vertices_mm[t[0]], b = mesh.vertices_mm[t[1]], c = mesh.vertices_mm[t[2]];
      const Vec3 ab = 0.5 * (a + b), bc = 0.5 * (b + c), ca = 0.5 * (c + a);
      add(a, ab, ca);
      add(ab, b, bc);
      add(ca, bc, c);
      add(ab, bc, ca);
    }
    mesh = fine;
  }
  return mesh;
}

inline TriangleMesh joined(TriangleMesh a, const TriangleMesh& b) {
  const auto shift = static_cast<std::uint32_t>(a.vertices_mm.size());
  a.vertices_mm.insert(a.vertices_mm.end(), b.vertices_mm.begin(), b.vertices_mm.end());
  for (const auto& t : b.triangles) a.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
  return a;
}

inline TriangleMesh moved(TriangleMesh mesh, const geometry::RigidTransform& motion, double scale = 1.0) {
  for (Vec3& v : mesh.vertices_mm) v = motion * Vec3(v * scale);
  return mesh;
}

/// Two sheets z = 0 over [-10, 10]^2 that cross: the second stands upright at x = 0.3.
inline TriangleMesh crossing_sheets(int cells) {
  const TriangleMesh flat = flat_mesh(cells, 10.0);
  const geometry::RigidTransform upright{Eigen::Quaterniond(std::sqrt(0.5), 0, std::sqrt(0.5), 0),
                                         Vec3(0.3, 0.1, 0.2)};
  return joined(flat, moved(flat, upright));
}

/// Table 7's surface.
inline double sinusoid(double x, double y) {
  constexpr double kRate = 0.04 * 3.14159265358979323846;
  return 10.0 * (std::cos(kRate * x) + std::cos(kRate * y));
}

/// What a closed mesh encloses, by the divergence theorem; positive where triangles are counter-clockwise
/// seen from outside.
inline double volume_of(const TriangleMesh& mesh) {
  double volume = 0.0;
  for (const auto& t : mesh.triangles)
    volume += mesh.vertices_mm[t[0]].dot(mesh.vertices_mm[t[1]].cross(mesh.vertices_mm[t[2]])) / 6.0;
  return volume;
}

// A mesh with its index, and its distance by brute force.

struct Indexed {
  std::unique_ptr<baselines::SurfaceMesh> mesh;
  std::unique_ptr<baselines::SegmentIndex> index;
};
inline Indexed indexed(const TriangleMesh& source) {
  Indexed made;
  made.mesh = std::make_unique<baselines::SurfaceMesh>(value_of(baselines::SurfaceMesh::build(source, 1)));
  made.index =
      std::make_unique<baselines::SegmentIndex>(value_of(baselines::SegmentIndex::build(*made.mesh, 1)));
  return made;
}

inline double least_distance_sq(const baselines::SurfaceMesh& mesh, const Vec3& p) {
  double least = std::numeric_limits<double>::infinity();
  for (const baselines::Facet& f : mesh.facets())
    least = std::min(least, baselines::closest_on_facet(f, p).distance_sq);
  return least;
}
inline double least_distance_sq(const TriangleMesh& mesh, const Vec3& p) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& t : mesh.triangles) {
    baselines::Facet f{};
    for (std::size_t i = 0; i < 3; ++i) f.corner[i] = mesh.vertices_mm[t[i]];
    least = std::min(least, baselines::closest_on_facet(f, p).distance_sq);
  }
  return least;
}

}  // namespace palpate::test
