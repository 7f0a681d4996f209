// Axis-aligned boxes, rigid motions (named a_from_b: p_a = a_from_b * p_b), and plain indexed triangle
// meshes, as read from files, reconstructed, or used by mesh renderers.
//
// A motion there and back:
//   palpate::geometry::RigidTransform world_from_model;
//   world_from_model.translation_mm = {0.0, 0.0, 50.0};
//   const Vec3 in_world_mm = world_from_model * Vec3(1.0, 2.0, 3.0);
//   const Vec3 back_mm = world_from_model.inverse() * in_world_mm;
//
// A mesh of one facet:
//   palpate::geometry::TriangleMesh mesh;
//   mesh.vertices_mm = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}};
//   mesh.triangles = {{0, 1, 2}};  // counter-clockwise from outside
//   if (auto wrote = io::write_mesh_ply("facet.ply", mesh); !wrote) return failed(wrote.error());
//
// First:
//   palpate::geometry::Aabb box;
//   for (std::size_t i = 0; i < cloud.size(); ++i) box.add(cloud.point_mm(i));
//   const Vec3 above_mm = box.centre_mm() + Vec3(0.0, 0.0, box.extent_mm().z());
#pragma once

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include <palpate/vec.h>

namespace palpate::geometry {

/// The closed box [low, high] per axis, mm. Empty until something is added (low > high).
struct Aabb {
  Vec3 low_mm = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high_mm = Vec3::Constant(-std::numeric_limits<double>::infinity());

  [[nodiscard]] bool empty() const noexcept { return !(low_mm.x() <= high_mm.x()); }
  void add(const Vec3& p) noexcept {
    low_mm = low_mm.cwiseMin(p);
    high_mm = high_mm.cwiseMax(p);
  }
  void add(const Aabb& other) noexcept {
    low_mm = low_mm.cwiseMin(other.low_mm);
    high_mm = high_mm.cwiseMax(other.high_mm);
  }
  [[nodiscard]] Vec3 extent_mm() const noexcept { return empty() ? Vec3::Zero() : Vec3(high_mm - low_mm); }
  [[nodiscard]] Vec3 centre_mm() const noexcept {
    return empty() ? Vec3::Zero() : Vec3(0.5 * (low_mm + high_mm));
  }
  [[nodiscard]] bool contains(const Vec3& p) const noexcept {
    return (p.array() >= low_mm.array()).all() && (p.array() <= high_mm.array()).all();
  }
  /// Boxes that only touch overlap; an empty box overlaps nothing.
  [[nodiscard]] bool overlaps(const Aabb& other) const noexcept {
    return !empty() && !other.empty() && (low_mm.array() <= other.high_mm.array()).all() &&
           (other.low_mm.array() <= high_mm.array()).all();
  }
  /// Squared distance of a point to the box, 0 inside; infinite for an empty box.
  [[nodiscard]] double distance_sq_mm2(const Vec3& p) const noexcept {
    return (low_mm - p).cwiseMax(p - high_mm).cwiseMax(0.0).squaredNorm();
  }
  [[nodiscard]] Aabb grown(double by_mm) const noexcept {
    return {low_mm - Vec3::Constant(by_mm), high_mm + Vec3::Constant(by_mm)};
  }
};

/// A rigid motion, mm; identity by default. Right-handed axes.
struct RigidTransform {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< unit
  Vec3 translation_mm = Vec3::Zero();

  [[nodiscard]] Vec3 operator*(const Vec3& p_mm) const noexcept { return rotation * p_mm + translation_mm; }
  [[nodiscard]] Vec3 rotate(const Vec3& v) const noexcept { return rotation * v; }
  [[nodiscard]] RigidTransform inverse() const noexcept {
    const Eigen::Quaterniond back = rotation.conjugate();
    return {back, -(back * translation_mm)};
  }
  [[nodiscard]] bool is_identity() const noexcept {
    return translation_mm == Vec3::Zero() && rotation.w() == 1.0 && rotation.vec() == Vec3::Zero();
  }
};

/// Vertices in mm (model frame) and triangles of vertex indices, counter-clockwise from outside if the source
/// knows it. Only valid indices are guaranteed.
struct TriangleMesh {
  std::vector<Vec3> vertices_mm;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  [[nodiscard]] bool empty() const noexcept { return triangles.empty(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return vertices_mm.size() * sizeof(Vec3) + triangles.size() * sizeof(triangles[0]);
  }
};

}  // namespace palpate::geometry
