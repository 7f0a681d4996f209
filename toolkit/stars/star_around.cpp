// The place held compared with the surface around the HIP: geometry/held_place.h.
#include <algorithm>
#include <cmath>

#include "toolkit/geometry/mouth.h"
#include "toolkit/stars/star_contact.h"

namespace palpate::stars {
namespace {

/// Nodes and triangles that one look may take: some thirty triangles stand within a spacing and a half of a
/// place, on each of a few sheets.
constexpr std::uint32_t kMaxAroundNodes = 64, kMaxAroundTested = 512;
/// It begins with this many edges around the HIP, or that share of the way it may go, and goes on twice as
/// far where there is nothing: at most seven times, on all of which it may take as many triangles.
constexpr double kFirstEdges = 1.0, kFirstShare = 1.0 / 64.0, kWider = 2.0;

}  // namespace

bool StarContact::find_around(const Vec3& h, double most, StarCounters& counters,
                              Stand& found) const noexcept {
  const double edge = std::sqrt(stand_.facet.middle_edge_sq());
  std::uint32_t tested = 0;
  for (double reach = std::min(std::max(kFirstEdges * edge, kFirstShare * most), most);;
       reach = std::min(kWider * reach, most)) {
    double to_beat = reach * reach;
    const Vec3 half = Vec3::Constant(reach);
    const geometry::Aabb around{h - half, h + half};
    const FloatBox box = FloatBox::around(around);
    bool any = false;
    const bool all = tree_->for_blocks(
        around, kMaxAroundNodes, [&](std::uint32_t block, const BoxNode&, std::uint32_t) noexcept {
          mesh_->for_triangles_of_block(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
            ++tested;
            if (mesh_->triangle_misses(a, b, c, box)) return;
            const Facet facet(*mesh_, a, b, c);
            const Foot foot = foot_on(facet, h);
            if (!(foot.distance_sq < to_beat)) return;
            to_beat = foot.distance_sq;
            found = {facet, foot};
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

/// Looked at where the pull has grown by two fifths since, and again and again where the god object hangs on
/// an edge or a corner: inside a facet that the HIP is behind nothing else is nearer.
bool StarContact::agree_with(const Vec3& h, StarCounters& counters) noexcept {
  look_sq_ = kGrown * stand_.foot.distance_sq;
  unlooked_ = 0;
  // Between sheets that cross each holds from a side of its own.
  if (others_count_ > 0) return true;
  const double far = std::sqrt(stand_.foot.distance_sq), edge = std::sqrt(stand_.facet.middle_edge_sq());
  if (!(far > geometry::kNextToSpacings * edge)) return true;
  Stand near;
  double near_side = side_;
  const auto look = [&](const Vec3& at) noexcept -> geometry::Surroundings {
    if (!find_around(at, geometry::kMuchNearer * far, counters, near)) return {};
    const std::uint32_t place = near.facet.place[0];
    near_side = mesh_->is_closed(place) ? free_side_[mesh_->closed_piece(place)] : side_;
    if (is_turned_over(near.facet)) near_side = -near_side;
    const Side seen = side_of(*mesh_, near, at);
    const double size = seen.area.norm(), distance = std::sqrt(near.foot.distance_sq);
    if (!(size > 0.0)) return {};
    return {true, near_side * seen.height > 0.0 ? distance : -distance, seen.area * (near_side / size)};
  };
  switch (geometry::judge_held_place(h, h + pull_, pull_ / far, edge, geometry::kMuchNearer, look)) {
    case geometry::HeldPlace::kKeep:
      return true;
    case geometry::HeldPlace::kMove:
      if (!look(h).known || near.facet.place == stand_.facet.place) return true;
      corrected_ = true;
      uncorrected_ = pull_;
      side_ = near_side;
      others_count_ = 0;
      move_to(near.facet, near.foot, h);
      framed_ = true;
      return true;
    case geometry::HeldPlace::kFree:
      break;
  }
  corrected_ = true;
  uncorrected_ = pull_;
  start_from(h);
  return false;
}

bool StarContact::regain(const Vec3& h, StarCounters& counters) noexcept {
  if (bound_hit_) return false;
  const double edge = std::sqrt(stand_.facet.middle_edge_sq());
  Stand near;
  if (!find_around(h, std::max(pull_.norm(), edge), counters, near)) return false;
  const std::uint32_t place = near.facet.place[0];
  if (!mesh_->is_closed(place)) return false;
  // Through a mouth a HIP may well have come in; what is left open between points is none.
  if (mesh_->has_holes(mesh_->closed_piece(place)) &&
      1.0 - mesh_->counts().least_enclosed > geometry::kTightMouthShare)
    return false;
  const double side = free_side_[mesh_->closed_piece(place)];
  // Single facets may be turned over where sheets are close.
  const Trend trend = trend_around(*mesh_, near.facet, true);
  const double height =
      trend.share > kTrendShare ? trend.normal.dot(h - near.foot.point) : side_of(*mesh_, near, h).height;
  const double least = geometry::kOutSpacings * edge;
  if (!(side * height < 0.0) || !(near.foot.distance_sq > least * least)) return false;
  corrected_ = true;
  uncorrected_ = pull_;
  side_ = side;
  others_count_ = 0;
  contact_ = true;
  look_sq_ = kGrown * near.foot.distance_sq;
  unlooked_ = 0;
  move_to(near.facet, near.foot, h);
  framed_ = true;
  return true;
}

}  // namespace palpate::stars
