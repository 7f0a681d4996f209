#include "baselines/reference/closest_mesh.h"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/triangle_meshes.h"

namespace palpate::baselines {
namespace {

using ExactKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangles = std::vector<ExactKernel::Triangle_3>;
using TrianglePrimitive = CGAL::AABB_triangle_primitive<ExactKernel, Triangles::const_iterator>;
using TriangleTree = CGAL::AABB_tree<CGAL::AABB_traits<ExactKernel, TrianglePrimitive>>;
using TriangleCorners = std::array<std::uint32_t, 3>;

/// Largest share of the opposite corner for a place on an edge: some dozens of roundings.
constexpr double kOnEdge = 1024.0 * kUnitRoundoff;
/// Largest difference of two shares of the way that are one place.
constexpr double kOnePlace = 1024.0 * kUnitRoundoff;
/// Targets on the nearest facet, as corner shares: the centre, then places off any symmetry.
constexpr std::array<std::array<double, 3>, 4> kLookAt = {
    {{1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0}, {0.58, 0.27, 0.15}, {0.17, 0.61, 0.22}, {0.24, 0.13, 0.63}}};

ExactKernel::Point_3 exact_point(const Vec3& p) {
  return {p.x(), p.y(), p.z()};
}
Vec3 plain(const ExactKernel::Point_3& p) {
  return {p.x(), p.y(), p.z()};
}

/// Boundary edges of each facet (bit i: corner i to the next) and corners on such edges (bit 3 + i).
std::vector<std::uint8_t> open_parts(const std::vector<TriangleCorners>& facets, std::size_t vertices) {
  const std::vector<geometry::TriangleSide> sides = geometry::sides_of(facets);
  std::vector<std::uint8_t> open(facets.size(), 0);
  std::vector<bool> rim(vertices, false);
  for (std::size_t i = 0; i < sides.size(); ++i) {
    if ((i > 0 && sides[i].same(sides[i - 1])) || (i + 1 < sides.size() && sides[i].same(sides[i + 1])))
      continue;
    std::uint8_t& facet = open[sides[i].triangle];
    facet = static_cast<std::uint8_t>(facet | (1u << sides[i].corner));
    rim[sides[i].low] = rim[sides[i].high] = true;
  }
  for (std::size_t f = 0; f < facets.size(); ++f)
    for (std::uint32_t c = 0; c < 3; ++c)
      if (rim[facets[f][c]]) open[f] = static_cast<std::uint8_t>(open[f] | (8u << c));
  return open;
}

/// Barycentric shares of a place, by areas along the normal.
Vec3 shares_of(const std::array<Vec3, 3>& t, const Vec3& p) {
  const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]);
  const double all = n.squaredNorm();
  return Vec3((t[2] - t[1]).cross(p - t[1]).dot(n), (t[0] - t[2]).cross(p - t[2]).dot(n),
              (t[1] - t[0]).cross(p - t[0]).dot(n)) /
         all;
}

}  // namespace

struct ClosestMesh::Tree {
  Vec3 origin = Vec3::Zero();
  Triangles triangles;
  std::vector<std::uint8_t> open;
  TriangleTree tree;

  struct Answer {
    Vec3 point = Vec3::Zero(), normal = Vec3::Zero();
    double signed_distance = 0.0;
  };
  [[nodiscard]] Answer ask(const Vec3& p) const;

 private:
  [[nodiscard]] std::array<Vec3, 3> corners(std::size_t facet) const {
    const ExactKernel::Triangle_3& t = triangles[facet];
    return {plain(t[0]), plain(t[1]), plain(t[2])};
  }
  [[nodiscard]] bool beyond_rim(std::size_t facet, const Vec3& p, const Vec3& q) const;
  [[nodiscard]] std::optional<bool> inside_seen(const Vec3& p, const Vec3& towards) const;
  [[nodiscard]] bool inside(std::size_t facet, const Vec3& p) const;
};

bool ClosestMesh::Tree::beyond_rim(std::size_t facet, const Vec3& p, const Vec3& q) const {
  if (open[facet] == 0) return false;
  const std::array<Vec3, 3> t = corners(facet);
  const Vec3 shares = shares_of(t, q);
  bool on_rim = false;
  for (std::uint32_t c = 0; c < 3; ++c) {
    const bool on_edge = shares[(c + 2) % 3] <= kOnEdge;  // from corner c to the next
    const bool at_corner = shares[(c + 1) % 3] <= kOnEdge && shares[(c + 2) % 3] <= kOnEdge;
    on_rim = on_rim || (on_edge && (open[facet] & (1u << c)) != 0) ||
             (at_corner && (open[facet] & (8u << c)) != 0);
  }
  if (!on_rim) return false;
  const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]).normalized(), way = p - q;
  return (way - way.dot(n) * n).norm() > kOnEdge * (way.norm() + q.norm());
}

/// Whether the way meets the first facet from behind; nothing if it meets opposite facets at one place.
std::optional<bool> ClosestMesh::Tree::inside_seen(const Vec3& p, const Vec3& towards) const {
  // Twice the way, so that the facet itself is met despite rounding.
  const ExactKernel::Point_3 from = exact_point(p), to = exact_point(p + 2.0 * (towards - p));
  if (from == to) return std::nullopt;
  std::vector<TrianglePrimitive::Id> met;
  tree.all_intersected_primitives(ExactKernel::Segment_3(from, to), std::back_inserter(met));
  double first = HUGE_VAL;
  std::optional<bool> behind;
  bool both = false;
  for (const TrianglePrimitive::Id& id : met) {
    const CGAL::Orientation side = CGAL::orientation((*id)[0], (*id)[1], (*id)[2], from);
    if (side == CGAL::COPLANAR) continue;  // seen edge-on, or the point is in its plane
    const double here = CGAL::volume((*id)[0], (*id)[1], (*id)[2], from),
                 there = CGAL::volume((*id)[0], (*id)[1], (*id)[2], to);
    const double share = here == there ? 1.0 : here / (here - there);
    if (share > first + kOnePlace) continue;
    const bool is_behind = side == CGAL::NEGATIVE;
    both = share >= first - kOnePlace && behind && *behind != is_behind;
    first = std::min(first, share);
    behind = is_behind;
  }
  return both ? std::nullopt : behind;
}

bool ClosestMesh::Tree::inside(std::size_t facet, const Vec3& p) const {
  const std::array<Vec3, 3> t = corners(facet);
  int votes = 0;
  for (const auto& share : kLookAt) {
    const std::optional<bool> seen = inside_seen(p, share[0] * t[0] + share[1] * t[1] + share[2] * t[2]);
    if (seen) return *seen;
    votes += CGAL::orientation(triangles[facet][0], triangles[facet][1], triangles[facet][2],
                               exact_point(p)) == CGAL::NEGATIVE
                 ? 1
                 : -1;
  }
  return votes > 0;
}

ClosestMesh::Tree::Answer ClosestMesh::Tree::ask(const Vec3& p) const {
  const auto found = tree.closest_point_and_primitive(exact_point(p));
  const auto facet = static_cast<std::size_t>(found.second - triangles.begin());
  Answer answer;
  answer.point = plain(found.first);
  const Vec3 way = p - answer.point;
  const double distance = way.norm();
  const std::array<Vec3, 3> t = corners(facet);
  const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]).normalized();
  // On the surface within rounding the way has no direction.
  if (!(distance > kOnEdge * (p.norm() + answer.point.norm()))) {
    answer.normal = n;
    answer.signed_distance = distance;
    return answer;
  }
  const bool is_inside = !beyond_rim(facet, p, answer.point) && inside(facet, p);
  answer.signed_distance = is_inside ? -distance : distance;
  answer.normal = way / answer.signed_distance;
  return answer;
}

ClosestMesh::ClosestMesh(std::unique_ptr<Tree> tree, const geometry::RigidTransform& world_from_model)
    : tree_(std::move(tree)),
      world_from_model_(world_from_model),
      model_from_world_(world_from_model.inverse()) {}

ClosestMesh::~ClosestMesh() = default;

Result<std::unique_ptr<ClosestMesh>> ClosestMesh::build(const geometry::TriangleMesh& mesh,
                                                        const geometry::RigidTransform& world_from_model) {
  geometry::Aabb box;
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    if (!is_finite(mesh.vertices_mm[i]))
      return Error{"vertex " + std::to_string(i) + " of the true mesh is not finite", "mend the mesh"};
    box.add(mesh.vertices_mm[i]);
  }
  auto tree = std::make_unique<Tree>();
  tree->origin = mesh.vertices_mm.empty() ? Vec3(Vec3::Zero()) : box.centre_mm();
  const geometry::TriangleMesh one = geometry::welded(mesh);
  std::vector<TriangleCorners> facets;
  for (const auto& t : one.triangles) {
    std::array<Vec3, 3> corner;
    for (std::size_t c = 0; c < 3; ++c) corner[c] = one.vertices_mm[t[c]] - tree->origin;
    const ExactKernel::Triangle_3 triangle(exact_point(corner[0]), exact_point(corner[1]),
                                           exact_point(corner[2]));
    if (triangle.is_degenerate() || (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm() == 0.0)
      continue;
    tree->triangles.push_back(triangle);
    facets.push_back(t);
  }
  if (facets.empty()) return Error{"the true mesh has no facet with an area", "give a mesh with triangles"};
  tree->open = open_parts(facets, one.vertices_mm.size());
  tree->tree.rebuild(tree->triangles.cbegin(), tree->triangles.cend());
  tree->tree.accelerate_distance_queries();
  return std::unique_ptr<ClosestMesh>(new ClosestMesh(std::move(tree), world_from_model));
}

double ClosestMesh::signed_distance_mm(const Vec3& p_mm) const {
  return tree_->ask(model_from_world_ * p_mm - tree_->origin).signed_distance;
}

geometry::SurfacePoint ClosestMesh::closest(const Vec3& p_mm) const {
  const Tree::Answer answer = tree_->ask(model_from_world_ * p_mm - tree_->origin);
  return {world_from_model_ * (answer.point + tree_->origin), world_from_model_.rotate(answer.normal)};
}

}  // namespace palpate::baselines
