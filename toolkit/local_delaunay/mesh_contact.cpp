#include "toolkit/local_delaunay/mesh_contact.h"

#include <algorithm>
#include <cmath>

namespace palpate::local_delaunay {
namespace {

/// A HIP in front of a flipped facet is behind the surface around it. A squared distance below this share of
/// the edge's square (a tenth of the edge) counts as on the facet.
constexpr double kFlippedShare = 0.01;

/// Threshold on a piece's solid angle as a share of the sphere: 0 outside, 1 inside.
constexpr double kInsideShare = 0.5;

/// Solid angle of a triangle seen from the origin (van Oosterom and Strackee 1983).
double solid_angle(const Vec3& a, const Vec3& b, const Vec3& c) noexcept {
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

/// Rounded operations from a HIP to its projection's height over a plane: the projection (unit normal,
/// height, product, sum) and the height over another facet (differences, cross product).
constexpr int kProjectionOperations = 32;

/// True if the left closest point lies in this triangle's plane, to rounding, and they share a corner: among
/// coplanar facets a closest point on an edge may be attributed to either.
bool stands_in(const LocalDelaunayMesh& mesh, const SurfacePosition& left, const Vec3& h, std::uint32_t a,
               std::uint32_t b, std::uint32_t c) noexcept {
  const auto& place = left.facet.place;
  const auto has = [&](std::uint32_t p) { return p == place[0] || p == place[1] || p == place[2]; };
  if (!has(a) && !has(b) && !has(c)) return false;
  const Vec3 pa = mesh.at(a), n = (mesh.at(b) - pa).cross(mesh.at(c) - pa);
  const double size = h.norm() + left.closest.point.norm() + pa.norm();
  return std::abs(n.dot(left.closest.point - pa)) <= gamma(kProjectionOperations) * size * n.norm();
}

/// Without a call: memcmp's time depends on page alignment.
bool is_same(const std::array<std::uint32_t, 3>& a, const std::array<std::uint32_t, 3>& b) noexcept {
  return ((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2])) == 0;
}

bool shares(const SurfacePosition& left, std::uint32_t a, std::uint32_t b, std::uint32_t c) noexcept {
  const auto has = [&](std::uint32_t place) { return place == a || place == b || place == c; };
  const Feature f = left.closest.feature;
  const auto& place = left.facet.place;
  if (f == Feature::kInside) return has(place[0]) && has(place[1]) && has(place[2]);
  const std::uint32_t k = feature_index(f);
  return has(place[k]) && (!is_edge(f) || has(place[next_corner(k)]));
}

}  // namespace

void MeshContact::attach(const LocalDelaunayMesh& mesh, const BlockBvh& tree) {
  mesh_ = &mesh;
  tree_ = &tree;
  free_side_.assign(mesh.counts().closed_components, 1.0);
}

void MeshContact::reset(const Vec3& h) noexcept {
  start_from(h);
  if (free_side_.empty()) return;
  std::fill(free_side_.begin(), free_side_.end(), 0.0);
  for (std::uint32_t i = 0; i < mesh_->size(); ++i) {
    if (!mesh_->is_closed(i)) continue;
    double& angle = free_side_[mesh_->closed_component(i)];
    mesh_->for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      angle += solid_angle(mesh_->at(a) - h, mesh_->at(b) - h, mesh_->at(c) - h);
    });
  }
  constexpr double kAllAround = 4.0 * M_PI;
  for (double& angle : free_side_) angle = std::abs(angle) > kInsideShare * kAllAround ? -1.0 : 1.0;
}

bool MeshContact::advance_segment(const Vec3& to, bool all, const SegmentHit& hit) noexcept {
  bound_hit_ = true;
  if (all) {
    way_share_ = std::min(1.0, 2.0 * way_share_);
    return true;
  }
  if (way_share_ > kMinSegmentShare) {
    way_share_ *= 0.5;
    return false;
  }
  // Even the shortest way exceeds the bound here; what was found counts.
  if (hit.place[0] == kNoPlace) from_ = to;
  return hit.place[0] != kNoPlace;
}

bool MeshContact::update_general(const Vec3& h, ContactCounters& counters) noexcept {
  const SurfacePosition* left = nullptr;
  in_clear_ = false;
  for (int flight = 0; flight < kMaxFlights; ++flight) {
    if (!contact_) {
      SegmentHit hit;
      const Vec3* to = &h;
      Vec3 part;
      if (way_share_ < 1.0) [[unlikely]] {
        part = from_ + way_share_ * (h - from_);
        to = &part;
      }
      const bool all = first_entry(from_, *to, left, counters, hit);
      if ((!all || to != &h) && !advance_segment(*to, all, hit)) [[unlikely]]
        return false;
      if (hit.place[0] == kNoPlace) {
        from_ = *to;
        in_clear_ = is_clear(from_);
        return false;
      }
      position_.closest.point = from_ + hit.fraction * (*to - from_);
      set_position(hit);
    }
    if (others_count_ > 0 ? solve_all_sheets(h, counters) : follow_single_sheet(h, counters)) return true;
    contact_ = false;
    others_count_ = 0;
    from_ = position_.closest.point;
    left = &position_;
  }
  bound_hit_ = true;
  return false;
}

void MeshContact::set_position(const SegmentHit& hit) noexcept {
  position_.facet = Facet(*mesh_, hit.place[0], hit.place[1], hit.place[2]);
  side_ = hit.side;
  if (is_flipped(position_.facet)) side_ = -side_;
  framed_ = false;
  watched_ = is_crossed(position_.facet);
  check_above_sq_ =
      geometry::kAdjacentSpacings * geometry::kAdjacentSpacings * position_.facet.middle_edge_sq();
  frames_since_check_ = 0;
  others_count_ = 0;
  contact_ = true;
}

/// Only pieces without holes are free of flipped facets.
bool MeshContact::is_flipped(const Facet& facet) const noexcept {
  const std::uint32_t place = facet.place[0];
  if (mesh_->is_closed(place) && !mesh_->has_holes(mesh_->closed_component(place))) return false;
  const MeanOrientation trend = mean_orientation_around(*mesh_, facet, false);
  return trend.share > kMinOrientationShare && trend.normal.dot(facet.area_normal()) < 0.0;
}

bool MeshContact::is_free(std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) const noexcept {
  if (!mesh_->is_closed(a)) return true;
  const double free = free_side_[mesh_->closed_component(a)];
  return (is_flipped(Facet(*mesh_, a, b, c)) ? -side : side) == free;
}

bool MeshContact::cross(const Vec3& h, FacetFrame::Weights weights, ContactCounters& counters) noexcept {
  std::array<std::uint32_t, 3> place = position_.facet.place;
  Vec3 pull = Vec3::Zero(), normal = frame_.normal();
  Feature feature = Feature::kInside;
  int crossed = 0;
  bool found = false, straight = true;
  while (crossed < kMaxCrossed && !found) {
    std::uint32_t corner = weights.beyond();
    const bool one = corner < 3;
    if (!one) {
      corner = weights.farther_beyond();
      if (corner == 3) break;
      straight = false;
    }
    const std::uint32_t first = next_corner(corner);
    const std::uint32_t a = place[first], b = place[next_corner(first)], c = mesh_->before(a, b);
    if (c == kNoPlace || mesh_->is_crossed(c)) break;
    const Vec3 at = mesh_->at(a), to = mesh_->at(b);
    const FacetFrame next(at, mesh_->at(c), to, side_);
    weights = next.at(h);
    if (!(weights.height < 0.0)) break;
    // The entered edge is between corners 0 and 2; beyond it again means that the closest point is on the
    // edge.
    if (weights.corner[1] < 0.0) {
      feature = edge_feature(first);
      found = one && weights.corner[0] >= 0.0 && weights.corner[2] >= 0.0 &&
              rests_on_edge(h, at, to, normal + next.normal(), pull);
      break;
    }
    ++crossed;
    place = {a, c, b};
    frame_ = next;
    normal = next.normal();
    prefetch_around(c);
    found = weights.hold();
    if (found) pull = next.pull(weights);
  }
  counters.moves += static_cast<std::uint64_t>(crossed);
  // At a corner the walk may have gone the longer way around.
  if (!straight && !(found && pull.squaredNorm() <= (h - position_.closest.point).squaredNorm()))
      [[unlikely]] {
    frame_ = FacetFrame(position_.facet, side_);
    return false;
  }
  if (crossed > 0) position_.facet = Facet(*mesh_, place[0], place[1], place[2]);
  if (!found) return false;
  const bool rises = pull.squaredNorm() < position_.closest.distance_sq;
  set_pull(h, pull, feature);
  prefetch_for_release(h, rises, counters);
  return true;
}

void MeshContact::prefetch_for_release(const Vec3& h, bool rises, ContactCounters& counters) noexcept {
  const std::uint32_t block = position_.facet.place[0] / kBlockPlaces, node = block / kBvhWidth;
  if (node != node_read_) {
    node_read_ = node;
    tree_->prefetch_above(block);
    return;
  }
  if (!rises || !(pull_.cwiseAbs().maxCoeff() < kShallowShare * near_reach_)) [[likely]]
    return;
  if (!covers(h, h + pull_)) {
    ++counters.blocks;
    find_blocks(h + pull_, near_reach_, kMaxFartherNodes);
  } else {
    (void)packed(block);
  }
}

bool MeshContact::follow(const Vec3& h, ContactCounters& counters) noexcept {
  int moves = most_moves_;
  const std::array<std::uint32_t, 3> before = position_.facet.place;
  const bool finished = descend(*mesh_, h, position_, moves);
  counters.moves += static_cast<std::uint64_t>(most_moves_ - moves);
  if (!is_same(position_.facet.place, before) || !framed_) {
    frame_ = FacetFrame(position_.facet, side_);
    framed_ = true;
    watched_ = is_crossed(position_.facet);
    for (const std::uint32_t place : position_.facet.place) prefetch_around(place);
  }
  pull_ = position_.closest.point - h;
  if (!finished) {  // the side is not judged mid-way
    bound_hit_ = true;
    return true;
  }
  const double edge_sq = position_.facet.longest_edge_sq();
  if (position_.closest.feature == Feature::kInside)
    return !(frame_.side_of(h) > 0.0) || still_behind(h, edge_sq);
  const Side side = side_of(*mesh_, position_, h);
  if (side_ * side.height > 0.0) return still_behind(h, edge_sq);
  const bool far = position_.closest.distance_sq > edge_sq;
  bool past = side.border && past_border_sq(position_, position_.facet.area_normal(), h) > edge_sq;
  bool hangs = false;
  // One facet is unreliable for a far HIP.
  if (far && !past && (side.border || tilts_beyond(side_ * side.area, pull_, kSmoothShare))) {
    const Vec3 around = mean_orientation_around(*mesh_, position_.facet, true).normal;
    past = side.border && past_border_sq(position_, around, h) > edge_sq;
    hangs = tilts_beyond(side_ * side.area, pull_, kSmoothShare) &&
            tilts_beyond(side_ * around, pull_, kUprightShare);
  }
  if (!past && !hangs) [[likely]]
    return true;
  const double edge = std::sqrt(position_.facet.middle_edge_sq());
  return bridge(h, edge, counters) || !past || bridge_step(h, edge, counters);
}

bool MeshContact::still_behind(const Vec3& h, double edge_sq) const noexcept {
  if (!(position_.closest.distance_sq > kFlippedShare * edge_sq)) return false;
  const MeanOrientation trend = mean_orientation_around(*mesh_, position_.facet, true);
  return trend.share > kMinOrientationShare && side_ * trend.normal.dot(h - position_.closest.point) < 0.0;
}

bool MeshContact::find_blocks_near(const Vec3& at, const Vec3& step, ContactCounters& counters) noexcept {
  ++counters.blocks;
  if (tree_->is_none()) return false;  // without a tree no block is kept: every query is complete
  const double reach = kStepsAhead * step.cwiseAbs().maxCoeff();
  if (!find_blocks(at + kStepsBefore * step, reach, kMaxNodes)) return false;
  for (int query = 0; query < kFartherQueries && near_count_ == 0; ++query) {
    const double known = near_reach_;
    const Vec3 known_at = near_at_;
    if (find_blocks(at, kFarther * known, kMaxFartherNodes)) continue;
    near_count_ = 0;  // too much there: keeps what is known
    near_at_ = known_at;
    near_reach_ = known;
    break;
  }
  return true;
}

bool MeshContact::find_blocks(const Vec3& at, double reach, std::uint32_t most) noexcept {
  forget_blocks();
  near_count_ = 0;
  near_box_.fill(BvhNode::empty());
  const Vec3 half = Vec3::Constant(reach);
  const bool all =
      tree_->for_blocks({at - half, at + half}, most,
                        [&](std::uint32_t block, const BvhNode& node, std::uint32_t child) noexcept {
                          if (near_count_ == kMaxBlocksNear) return false;
                          BvhNode& box = near_box_[near_count_ / kBvhWidth];
                          const std::uint32_t slot = near_count_ % kBvhWidth;
                          for (std::size_t axis = 0; axis < 3; ++axis) {
                            box.low[axis][slot] = node.low[axis][child];
                            box.high[axis][slot] = node.high[axis][child];
                          }
                          near_block_[near_count_++] = block;
                          return true;
                        });
  near_at_ = at;
  near_read_ = 0;
  if (all) near_reach_ = reach;
  return all;
}

void MeshContact::update_clearance(const Vec3& h) noexcept {
  const double cube = std::max(near_reach_ - (h - near_at_).cwiseAbs().maxCoeff(), 0.0);
  const FloatBox at = FloatBox::around({h, h});
  auto nearest_sq = static_cast<float>(cube * cube);
  for (std::uint32_t first = 0; first < near_count_; first += kBvhWidth)
    for (const float box_sq : near_box_[first / kBvhWidth].distance_sq(at))
      nearest_sq = std::min(nearest_sq, box_sq);
  const double clear =
      kClearShare * std::sqrt(static_cast<double>(nearest_sq)) - kClearSlack * h.cwiseAbs().maxCoeff();
  clear_at_ = h;
  clear_sq_ = clear > 0.0 ? clear * clear : -1.0;
}

const PackedBlock& MeshContact::packed(std::uint32_t block) noexcept {
  for (const PackedBlock& known : packed_)
    if (known.block == block) return known;
  PackedBlock& made = packed_[next_packed_++ % kPackedBlocks];
  made.pack(*mesh_, block);
  return made;
}

bool MeshContact::first_entry(const Vec3& from, const Vec3& to, const SurfacePosition* left,
                              ContactCounters& counters, SegmentHit& hit) noexcept {
  std::uint32_t tested = 0;
  const geometry::Aabb around{from.cwiseMin(to), from.cwiseMax(to)};
  const SegmentQuery way{from, to, FloatBox::around(around)};
  bool near = covers(from, to), queried = false;
  if (!near)
    near = queried = find_blocks_near(to, to - from, counters);
  else if (near_read_ < near_count_)
    tree_->prefetch(*mesh_, near_block_[near_read_++]);
  const auto takes = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) noexcept {
    if (left != nullptr) {
      if (shares(*left, a, b, c)) return false;
      // Leaving to the front meets no facet from behind.
      if (side != side_ && stands_in(*mesh_, *left, to, a, b, c)) return false;
    }
    return is_free(a, b, c, side);
  };
  bool met = false;
  bool all = true;
  if (near) {
    for (std::uint32_t node = 0; node * kBvhWidth < near_count_; ++node)
      for (unsigned mask = near_box_[node].meets(way.box); mask != 0; mask &= mask - 1) {
        met = true;
        const auto child = static_cast<std::uint32_t>(__builtin_ctz(mask));
        const std::uint32_t block = near_block_[node * kBvhWidth + child];
        if (tree_->layer(block).misses(from, to)) continue;
        const PackedBlock& triangles = packed(block);
        if (triangles.size <= PackedBlock::kMost) [[likely]]
          intersect_packed(*mesh_, triangles, way, hit, tested, takes);
        else
          intersect_block(*mesh_, *tree_, block, way, hit, tested, takes);
      }
  } else {
    all = tree_->for_blocks(around, kMaxNodes,
                            [&](std::uint32_t block, const BvhNode&, std::uint32_t) noexcept {
                              intersect_block(*mesh_, *tree_, block, way, hit, tested, takes);
                              return tested < kMaxTestedTriangles || tree_->is_none();
                            });
  }
  counters.tested += tested;
  // Once per query: near a box the distance would be computed in vain in every frame.
  if (queried && !met) update_clearance(to);
  return all;
}

/// A moving corner sweeps its triangle over a tetrahedron; if that contains the HIP, the triangle passed it.
/// The tests are four signs of faces seen from the HIP, consistent between tetrahedra that share a face.
void MeshContact::point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept {
  if (contact_) return;
  const Vec3 &h = from_, f = from - h, t = to - h;
  const Ring ring = mesh_->ring(place);
  for (std::uint32_t k = 0; k < ring.size; ++k) {
    if (!ring.has_sector(k)) continue;
    const std::uint32_t b = ring.of[k], c = ring.of[ring.next(k)];
    const Vec3 rb = mesh_->at(b) - h, rc = mesh_->at(c) - h;
    const Vec3 low = f.cwiseMin(t).cwiseMin(rb).cwiseMin(rc), high = f.cwiseMax(t).cwiseMax(rb).cwiseMax(rc);
    if ((low.array() > 0.0).any() || (high.array() < 0.0).any()) continue;
    const std::array<std::uint32_t, 3> corner = {place, b, c};
    const double before = triple_product(corner, {f, rb, rc}), behind = triple_product(corner, {t, rb, rc});
    const double at_b = f.dot(t.cross(rb)), at_c = f.dot(t.cross(rc));
    const bool in = before <= 0.0 && behind > 0.0 && at_b <= 0.0 && at_c >= 0.0;
    const bool out = before >= 0.0 && behind < 0.0 && at_b >= 0.0 && at_c <= 0.0;
    const double side = in ? 1.0 : -1.0;
    if (!in && !out) continue;
    if (!is_free(place, b, c, side)) continue;
    SegmentHit hit;
    hit.place = corner;
    hit.side = side;
    set_position(hit);
    position_.closest = closest_point_on(position_.facet, h);
    pull_ = position_.closest.point - h;
    return;
  }
}

/// Takes the facet of these corners, or, if an edge was split or joined, the nearest to the HIP around them
/// on the same sheet.
void MeshContact::take_facet(const std::array<std::uint32_t, 3>& place) noexcept {
  const Vec3 h = position_.closest.point - pull_;
  SurfacePosition nearest;
  const auto offer = [&](const Facet& facet) noexcept {
    const ClosestPoint closest = closest_point_on(facet, h);
    if (closest.distance_sq < nearest.closest.distance_sq) nearest = {facet, closest};
  };
  const Ring around = mesh_->ring(place[0]);
  const std::uint32_t at = around.find(place[1]);
  if (at < around.size && around.has_sector(at) && around.of[around.next(at)] == place[2])
    offer(Facet(*mesh_, place[0], place[1], place[2]));
  else
    for (const std::uint32_t corner : place) {
      const Ring ring = mesh_->ring(corner);
      for (std::uint32_t k = 0; k < ring.size; ++k)
        if (ring.has_sector(k)) offer(Facet(*mesh_, corner, ring.of[k], ring.of[ring.next(k)]));
    }
  if (nearest.facet.place[0] == kNoPlace) {  // no facet is left there
    start_from(h);
    return;
  }
  position_ = nearest;
  pull_ = position_.closest.point - h;
  frame_ = FacetFrame(position_.facet, side_);
  framed_ = true;
}

}  // namespace palpate::local_delaunay
