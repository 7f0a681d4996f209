// Decides past a border whether the surface continues beyond a sampling gap or ends.
#include <algorithm>
#include <cmath>

#include "toolkit/local_delaunay/mesh_contact.h"

namespace palpate::local_delaunay {
namespace {

/// Distance to one of a node's boxes.
double distance_sq(const BvhNode& node, std::uint32_t child, const Vec3& h) noexcept {
  double sum = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double at = h[static_cast<Eigen::Index>(axis)];
    const double off = std::max({static_cast<double>(node.low[axis][child]) - at,
                                 at - static_cast<double>(node.high[axis][child]), 0.0});
    sum += off * off;
  }
  return sum;
}

/// Diagonal of one of a node's boxes.
double diagonal_sq(const BvhNode& node, std::uint32_t child) noexcept {
  double sum = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double side =
        static_cast<double>(node.high[axis][child]) - static_cast<double>(node.low[axis][child]);
    sum += side * side;
  }
  return sum;
}

}  // namespace

double MeshContact::way_ahead(const Vec3& h, Vec3& ahead) const noexcept {
  const Vec3 n = mean_orientation_around(*mesh_, position_.facet, true).normal;
  const double square = n.squaredNorm();
  ahead = h - position_.closest.point;
  if (square > 0.0) ahead -= n * (n.dot(ahead) / square);
  const double size = ahead.norm();
  if (size > 0.0) ahead /= size;
  return size;
}

void MeshContact::move_to(const Facet& facet, const ClosestPoint& closest, const Vec3& h) noexcept {
  position_ = {facet, closest};
  frame_ = FacetFrame(facet, side_);
  watched_ = is_crossed(facet);
  pull_ = closest.point - h;
}

bool MeshContact::bridge(const Vec3& h, double edge, ContactCounters& counters) noexcept {
  const Vec3 g = position_.closest.point;
  Vec3 ahead;
  const double size = way_ahead(h, ahead);
  if (!(size > 0.0)) return true;
  const double half = 0.5 * kGapEdges * edge;
  const Vec3 middle = g + ahead * half;
  double to_beat = position_.closest.distance_sq * kDescent;
  Facet best;
  ClosestPoint nearest;
  bool narrow = false;
  std::uint32_t tested = 0;
  const geometry::Aabb around{middle - Vec3::Constant(half), middle + Vec3::Constant(half)};
  const FloatBox box = FloatBox::around(around);
  const bool all = tree_->for_blocks(
      around, kMaxNodes, [&](std::uint32_t block, const BvhNode& node, std::uint32_t child) noexcept {
        // In dense parts only blocks that may be nearer are searched.
        if (narrow && distance_sq(node, child, h) >= to_beat) return true;
        mesh_->for_triangles_of_block(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
          ++tested;
          if (mesh_->triangle_misses(a, b, c, box)) return;
          const Facet facet(*mesh_, a, b, c);
          for (std::size_t k = 0; k < 3 && !narrow; ++k) {
            const Vec3 r = facet.corner[k] - g;
            const double on = ahead.dot(r);
            narrow = on > edge && on * on > kAheadShare * r.squaredNorm();
          }
          const ClosestPoint closest = closest_point_on(facet, h);
          if (!(closest.distance_sq < to_beat) || !(side_ * facet.area_normal().dot(h - closest.point) < 0.0))
            return;
          to_beat = closest.distance_sq;
          best = facet;
          nearest = closest;
        });
        return tested < kMaxTestedTriangles;
      });
  counters.tested += tested;
  bound_hit_ = bound_hit_ || !all;
  // A HIP farther ahead than the gap's width has passed it; nothing there holds it.
  if (best.place[0] == kNoPlace) return narrow && size <= 2.0 * half;
  move_to(best, nearest, h);
  return true;
}

bool MeshContact::bridge_step(const Vec3& h, double edge, ContactCounters& counters) noexcept {
  const Vec3 g = position_.closest.point;
  Vec3 ahead;
  const double size = way_ahead(h, ahead), least = kStepEdges * edge, least_sq = least * least;
  double to_beat = position_.closest.distance_sq * kDescent, reach = kGapEdges * edge, gap = 0.0;
  Facet best;
  ClosestPoint nearest;
  std::uint32_t tested = 0;
  const auto offer = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) noexcept {
    ++tested;
    const Facet facet(*mesh_, a, b, c);
    const double middle_sq = facet.middle_edge_sq();
    if (!(middle_sq >= least_sq)) return;
    const double middle = std::sqrt(middle_sq);
    for (const Vec3& corner : facet.corner) {
      const Vec3 r = corner - g;
      const double on = ahead.dot(r);
      if (on > edge && on <= kGapEdges * middle && on * on > kAheadShare * r.squaredNorm())
        gap = std::max(gap, on + middle);
    }
    const ClosestPoint closest = closest_point_on(facet, h);
    if (!(closest.distance_sq < to_beat) || !(side_ * facet.area_normal().dot(h - closest.point) < 0.0))
      return;
    to_beat = closest.distance_sq;
    best = facet;
    nearest = closest;
  };
  for (std::uint32_t part = 0; part < kStepQueries && gap == 0.0; ++part) {
    reach *= kFarther;
    const Vec3 from = g + ahead * edge, to = g + ahead * reach, wide = Vec3::Constant(kStepWidth * reach);
    const bool all =
        tree_->for_blocks({from.cwiseMin(to) - wide, from.cwiseMax(to) + wide}, kMaxNodes / kStepQueries,
                          [&](std::uint32_t block, const BvhNode& node, std::uint32_t child) noexcept {
                            // A dense part's blocks hold no such facet.
                            if (!(diagonal_sq(node, child) >= least_sq)) return true;
                            mesh_->for_triangles_of_block(block, offer);
                            return tested < kMaxTestedTriangles;
                          });
    // The next frame does not continue this search: contact ends if nothing is found.
    if (!all) break;
  }
  counters.tested += tested;
  if (gap == 0.0) return false;
  if (best.place[0] == kNoPlace) return size <= gap;
  move_to(best, nearest, h);
  return true;
}

}  // namespace palpate::local_delaunay
