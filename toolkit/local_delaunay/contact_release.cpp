// Compares the held place with the surface around the HIP (geometry/god_object_check.h).
#include <algorithm>
#include <cmath>

#include "toolkit/geometry/winding_number.h"
#include "toolkit/local_delaunay/mesh_contact.h"

namespace palpate::local_delaunay {
namespace {

/// Bounds on nodes and triangles of one query. Each of a few sheets has about thirty triangles within 1.5
/// spacings.
constexpr std::uint32_t kMaxAroundNodes = 64, kMaxAroundTested = 512;
/// First radius of a query: this many edges, or this share of the largest. An empty query doubles it, at most
/// seven times, each with the same bound on triangles.
constexpr double kFirstEdges = 1.0, kFirstShare = 1.0 / 64.0, kReachGrowth = 2.0;

}  // namespace

bool MeshContact::find_around(const Vec3& h, double most, ContactCounters& counters,
                              SurfacePosition& found) const noexcept {
  const double edge = std::sqrt(position_.facet.middle_edge_sq());
  std::uint32_t tested = 0;
  for (double reach = std::min(std::max(kFirstEdges * edge, kFirstShare * most), most);;
       reach = std::min(kReachGrowth * reach, most)) {
    double to_beat = reach * reach;
    const Vec3 half = Vec3::Constant(reach);
    const geometry::Aabb around{h - half, h + half};
    const FloatBox box = FloatBox::around(around);
    bool any = false;
    const bool all = tree_->for_blocks(
        around, kMaxAroundNodes, [&](std::uint32_t block, const BvhNode&, std::uint32_t) noexcept {
          mesh_->for_triangles_of_block(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
            ++tested;
            if (mesh_->triangle_misses(a, b, c, box)) return;
            const Facet facet(*mesh_, a, b, c);
            const ClosestPoint closest = closest_point_on(facet, h);
            if (!(closest.distance_sq < to_beat)) return;
            to_beat = closest.distance_sq;
            found = {facet, closest};
            any = true;
          });
          return tested < kMaxAroundTested;
        });
    if (!all || any || !(reach < most)) {
      counters.tested += tested;
      return all && any;
    }
  }
}

/// Queries when the pull has grown by two fifths since the last query, and repeatedly while the god object is
/// on an edge or corner. Inside a facet with the HIP behind it nothing else is nearer.
bool MeshContact::check_with_surroundings(const Vec3& h, ContactCounters& counters) noexcept {
  check_above_sq_ = kGrown * position_.closest.distance_sq;
  frames_since_check_ = 0;
  // Crossing sheets hold from a side of their own.
  if (others_count_ > 0) return true;
  const double far = std::sqrt(position_.closest.distance_sq),
               edge = std::sqrt(position_.facet.middle_edge_sq());
  if (!(far > geometry::kAdjacentSpacings * edge)) return true;
  SurfacePosition near;
  double near_side = side_;
  const auto query = [&](const Vec3& at) noexcept -> geometry::NearestSurface {
    if (!find_around(at, geometry::kMuchNearerShare * far, counters, near)) return {};
    const std::uint32_t place = near.facet.place[0];
    const bool closed = mesh_->is_closed(place);
    near_side = closed ? free_side_[mesh_->closed_component(place)] : side_;
    if (is_flipped(near.facet)) near_side = -near_side;
    const Side seen = side_of(*mesh_, near, at);
    const double size = seen.area.norm(), distance = std::sqrt(near.closest.distance_sq);
    if (!(size > 0.0)) return {};
    return {true, near_side * seen.height > 0.0 ? distance : -distance, seen.area * (near_side / size),
            closed ? mesh_->closed_component(place) + 1 : 0};
  };
  const Vec3 outward = pull_ / far;
  switch (geometry::check_god_object(query(h), h, h + pull_, outward, outward, edge,
                                     geometry::kMuchNearerShare, query)) {
    case geometry::GodObjectVerdict::kKeep:
      return true;
    case geometry::GodObjectVerdict::kMove:
      if (!query(h).known || near.facet.place == position_.facet.place) return true;
      side_ = near_side;
      others_count_ = 0;
      move_to(near.facet, near.closest, h);
      framed_ = true;
      return true;
    case geometry::GodObjectVerdict::kFree:
      break;
  }
  start_from(h);
  return false;
}

bool MeshContact::reattach(const Vec3& h, ContactCounters& counters) noexcept {
  if (bound_hit_) return false;
  const double edge = std::sqrt(position_.facet.middle_edge_sq());
  SurfacePosition near;
  if (!find_around(h, std::max(pull_.norm(), edge), counters, near)) return false;
  const std::uint32_t place = near.facet.place[0];
  if (!mesh_->is_closed(place)) return false;
  // A HIP may have entered through a real opening; gaps between points are none.
  if (mesh_->has_holes(mesh_->closed_component(place)) &&
      1.0 - mesh_->counts().min_enclosed > geometry::kTightOpeningFraction)
    return false;
  const double side = free_side_[mesh_->closed_component(place)];
  // Where sheets are close, single facets may be flipped.
  const MeanOrientation trend = mean_orientation_around(*mesh_, near.facet, true);
  const double height = trend.share > kMinOrientationShare ? trend.normal.dot(h - near.closest.point)
                                                           : side_of(*mesh_, near, h).height;
  const double least = geometry::kOutsideSpacings * edge;
  if (!(side * height < 0.0) || !(near.closest.distance_sq > least * least)) return false;
  side_ = side;
  others_count_ = 0;
  contact_ = true;
  check_above_sq_ = kGrown * near.closest.distance_sq;
  frames_since_check_ = 0;
  move_to(near.facet, near.closest, h);
  framed_ = true;
  return true;
}

}  // namespace palpate::local_delaunay
