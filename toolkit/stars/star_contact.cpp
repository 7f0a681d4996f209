#include "toolkit/stars/star_contact.h"

#include <algorithm>
#include <cmath>

namespace palpate::stars {
namespace {

/// A HIP in front of a facet that is turned over stands behind the surface around it. Nearer to the facet
/// than a tenth of its edge (squared) that is as good as on it.
constexpr double kTurnedShare = 0.01;

/// A piece's solid angle as a part of all around: outside it sees nothing of it, inside all.
constexpr double kInsideShare = 0.5;

/// Solid angle of a triangle seen from the origin (van Oosterom and Strackee 1983).
double solid_angle(const Vec3& a, const Vec3& b, const Vec3& c) noexcept {
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

/// Rounded operations between a HIP and how far its foot stands from a plane: the foot (a normal of unit
/// length, a height, their product and a sum) and its height over another facet (differences, a product of
/// vectors).
constexpr int kFootOperations = 32;

/// Whether the foot that is left lies in this triangle's plane, to rounding, and the triangle has one of its
/// corners: where facets lie in one plane the foot may be on an edge and be said to lie inside one of them.
bool stands_in(const StarMesh& mesh, const Stand& left, const Vec3& h, std::uint32_t a, std::uint32_t b,
               std::uint32_t c) noexcept {
  const auto& place = left.facet.place;
  const auto has = [&](std::uint32_t p) { return p == place[0] || p == place[1] || p == place[2]; };
  if (!has(a) && !has(b) && !has(c)) return false;
  const Vec3 pa = mesh.at(a), n = (mesh.at(b) - pa).cross(mesh.at(c) - pa);
  const double size = h.norm() + left.foot.point.norm() + pa.norm();
  return std::abs(n.dot(left.foot.point - pa)) <= gamma(kFootOperations) * size * n.norm();
}

/// Without a call: what the library's comparison of memory takes depends on where on a page its operands lie.
bool is_same(const std::array<std::uint32_t, 3>& a, const std::array<std::uint32_t, 3>& b) noexcept {
  return ((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2])) == 0;
}

bool shares(const Stand& left, std::uint32_t a, std::uint32_t b, std::uint32_t c) noexcept {
  const auto has = [&](std::uint32_t place) { return place == a || place == b || place == c; };
  const Feature f = left.foot.feature;
  const auto& place = left.facet.place;
  if (f == Feature::kInside) return has(place[0]) && has(place[1]) && has(place[2]);
  const std::uint32_t k = number_of(f);
  return has(place[k]) && (!is_edge(f) || has(place[corner_after(k)]));
}

}  // namespace

void StarContact::attach(const StarMesh& mesh, const StarTree& tree) {
  mesh_ = &mesh;
  tree_ = &tree;
  free_side_.assign(mesh.counts().closed_pieces, 1.0);
}

void StarContact::reset(const Vec3& h) noexcept {
  start_from(h);
  if (free_side_.empty()) return;
  std::fill(free_side_.begin(), free_side_.end(), 0.0);
  for (std::uint32_t i = 0; i < mesh_->size(); ++i) {
    if (!mesh_->is_closed(i)) continue;
    double& angle = free_side_[mesh_->closed_piece(i)];
    mesh_->for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      angle += solid_angle(mesh_->at(a) - h, mesh_->at(b) - h, mesh_->at(c) - h);
    });
  }
  constexpr double kAllAround = 4.0 * M_PI;
  for (double& angle : free_side_) angle = std::abs(angle) > kInsideShare * kAllAround ? -1.0 : 1.0;
}

bool StarContact::go_on(const Vec3& to, bool all, const Hit& hit) noexcept {
  bound_hit_ = true;
  if (all) {
    way_share_ = std::min(1.0, 2.0 * way_share_);
    return true;
  }
  if (way_share_ > kLeastWayShare) {
    way_share_ *= 0.5;
    return false;
  }
  // More lies here than a frame may look at however short the way is: what was found counts.
  if (hit.place[0] == kNoPlace) from_ = to;
  return hit.place[0] != kNoPlace;
}

bool StarContact::update_slowly(const Vec3& h, StarCounters& counters) noexcept {
  const Stand* left = nullptr;
  in_clear_ = false;
  for (int flight = 0; flight < kMaxFlights; ++flight) {
    if (!contact_) {
      Hit hit;
      const Vec3* to = &h;
      Vec3 part;
      if (way_share_ < 1.0) [[unlikely]] {
        part = from_ + way_share_ * (h - from_);
        to = &part;
      }
      const bool all = first_entry(from_, *to, left, counters, hit);
      if ((!all || to != &h) && !go_on(*to, all, hit)) [[unlikely]]
        return false;
      if (hit.place[0] == kNoPlace) {
        from_ = *to;
        in_clear_ = is_clear(from_);
        return false;
      }
      stand_.foot.point = from_ + hit.fraction * (*to - from_);
      stand_on(hit);
    }
    if (others_count_ > 0 ? hold_together(h, counters) : follow_alone(h, counters)) return true;
    contact_ = false;
    others_count_ = 0;
    from_ = stand_.foot.point;
    left = &stand_;
  }
  bound_hit_ = true;
  return false;
}

void StarContact::stand_on(const Hit& hit) noexcept {
  stand_.facet = Facet(*mesh_, hit.place[0], hit.place[1], hit.place[2]);
  side_ = hit.side;
  if (is_turned_over(stand_.facet)) side_ = -side_;
  framed_ = false;
  watched_ = is_crossed(stand_.facet);
  look_sq_ = geometry::kNextToSpacings * geometry::kNextToSpacings * stand_.facet.middle_edge_sq();
  unlooked_ = 0;
  others_count_ = 0;
  contact_ = true;
}

/// Only a whole piece has none: all around it triangles agree on what is outside.
bool StarContact::is_turned_over(const Facet& facet) const noexcept {
  const std::uint32_t place = facet.place[0];
  if (mesh_->is_closed(place) && !mesh_->has_holes(mesh_->closed_piece(place))) return false;
  const Trend trend = trend_around(*mesh_, facet, false);
  return trend.share > kTrendShare && trend.normal.dot(facet.area_normal()) < 0.0;
}

bool StarContact::is_free(std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) const noexcept {
  if (!mesh_->is_closed(a)) return true;
  const double free = free_side_[mesh_->closed_piece(a)];
  return (is_turned_over(Facet(*mesh_, a, b, c)) ? -side : side) == free;
}

bool StarContact::cross(const Vec3& h, FacetFrame::Weights weights, StarCounters& counters) noexcept {
  std::array<std::uint32_t, 3> place = stand_.facet.place;
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
    const std::uint32_t first = corner_after(corner);
    const std::uint32_t a = place[first], b = place[corner_after(first)], c = mesh_->before(a, b);
    if (c == kNoPlace || mesh_->is_crossed(c)) break;
    const Vec3 at = mesh_->at(a), to = mesh_->at(b);
    const FacetFrame next(at, mesh_->at(c), to, side_);
    weights = next.at(h);
    if (!(weights.height < 0.0)) break;
    // Its own edge is the one between corners 0 and 2: back over it means that the foot is on the edge.
    if (weights.corner[1] < 0.0) {
      feature = edge_number(first);
      found = one && weights.corner[0] >= 0.0 && weights.corner[2] >= 0.0 &&
              rests_on_edge(h, at, to, normal + next.normal(), pull);
      break;
    }
    ++crossed;
    place = {a, c, b};
    frame_ = next;
    normal = next.normal();
    read_ahead(c);
    found = weights.hold();
    if (found) pull = next.pull(weights);
  }
  counters.moves += static_cast<std::uint64_t>(crossed);
  // Past a corner the walk may have gone round it the longer way.
  if (!straight && !(found && pull.squaredNorm() <= (h - stand_.foot.point).squaredNorm())) [[unlikely]] {
    frame_ = FacetFrame(stand_.facet, side_);
    return false;
  }
  if (crossed > 0) stand_.facet = Facet(*mesh_, place[0], place[1], place[2]);
  if (!found) return false;
  const bool rises = pull.squaredNorm() < stand_.foot.distance_sq;
  rest_at(h, pull, feature);
  get_ready(h, rises, counters);
  return true;
}

void StarContact::get_ready(const Vec3& h, bool rises, StarCounters& counters) noexcept {
  const std::uint32_t block = stand_.facet.place[0] / kBlockPlaces, node = block / kFanOut;
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

bool StarContact::follow(const Vec3& h, StarCounters& counters) noexcept {
  int moves = most_moves_;
  const std::array<std::uint32_t, 3> before = stand_.facet.place;
  const bool finished = descend(*mesh_, h, stand_, moves);
  counters.moves += static_cast<std::uint64_t>(most_moves_ - moves);
  if (!is_same(stand_.facet.place, before) || !framed_) {
    frame_ = FacetFrame(stand_.facet, side_);
    framed_ = true;
    watched_ = is_crossed(stand_.facet);
    for (const std::uint32_t place : stand_.facet.place) read_ahead(place);
  }
  pull_ = stand_.foot.point - h;
  if (!finished) {  // its side is not judged on the way
    bound_hit_ = true;
    return true;
  }
  const double edge_sq = stand_.facet.longest_edge_sq();
  if (stand_.foot.feature == Feature::kInside) return !(frame_.side_of(h) > 0.0) || still_behind(h, edge_sq);
  const Side side = side_of(*mesh_, stand_, h);
  if (side_ * side.height > 0.0) return still_behind(h, edge_sq);
  const bool far = stand_.foot.distance_sq > edge_sq;
  bool past = side.border && past_border_sq(stand_, stand_.facet.area_normal(), h) > edge_sq;
  bool hangs = false;
  // One facet is little to go by where h is far.
  if (far && !past && (side.border || leans(side_ * side.area, pull_, kSmoothShare))) {
    const Vec3 around = trend_around(*mesh_, stand_.facet, true).normal;
    past = side.border && past_border_sq(stand_, around, h) > edge_sq;
    hangs = leans(side_ * side.area, pull_, kSmoothShare) && leans(side_ * around, pull_, kUprightShare);
  }
  if (!past && !hangs) [[likely]]
    return true;
  const double edge = std::sqrt(stand_.facet.middle_edge_sq());
  return bridge(h, edge, counters) || !past || bridge_step(h, edge, counters);
}

bool StarContact::still_behind(const Vec3& h, double edge_sq) const noexcept {
  if (!(stand_.foot.distance_sq > kTurnedShare * edge_sq)) return false;
  const Trend trend = trend_around(*mesh_, stand_.facet, true);
  return trend.share > kTrendShare && side_ * trend.normal.dot(h - stand_.foot.point) < 0.0;
}

bool StarContact::look_around(const Vec3& at, const Vec3& step, StarCounters& counters) noexcept {
  ++counters.blocks;
  const double reach = kStepsAhead * step.cwiseAbs().maxCoeff();
  if (!find_blocks(at + kStepsBefore * step, reach, kMaxNodes)) return false;
  for (int look = 0; look < kFartherLooks && near_count_ == 0; ++look) {
    const double known = near_reach_;
    const Vec3 known_at = near_at_;
    if (find_blocks(at, kFarther * known, kMaxFartherNodes)) continue;
    near_count_ = 0;  // too much there: what is known stays
    near_at_ = known_at;
    near_reach_ = known;
    break;
  }
  return true;
}

bool StarContact::find_blocks(const Vec3& at, double reach, std::uint32_t most) noexcept {
  forget_blocks();
  near_count_ = 0;
  near_box_.fill(BoxNode::empty());
  const Vec3 half = Vec3::Constant(reach);
  const bool all =
      tree_->for_blocks({at - half, at + half}, most,
                        [&](std::uint32_t block, const BoxNode& node, std::uint32_t child) noexcept {
                          if (near_count_ == kMaxBlocksNear) return false;
                          BoxNode& box = near_box_[near_count_ / kFanOut];
                          const std::uint32_t slot = near_count_ % kFanOut;
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

void StarContact::note_clear(const Vec3& h) noexcept {
  const double cube = std::max(near_reach_ - (h - near_at_).cwiseAbs().maxCoeff(), 0.0);
  const FloatBox at = FloatBox::around({h, h});
  auto nearest_sq = static_cast<float>(cube * cube);
  for (std::uint32_t first = 0; first < near_count_; first += kFanOut)
    for (const float box_sq : near_box_[first / kFanOut].distance_sq(at))
      nearest_sq = std::min(nearest_sq, box_sq);
  const double clear =
      kClearShare * std::sqrt(static_cast<double>(nearest_sq)) - kClearSlack * h.cwiseAbs().maxCoeff();
  clear_at_ = h;
  clear_sq_ = clear > 0.0 ? clear * clear : -1.0;
}

const PackedBlock& StarContact::packed(std::uint32_t block) noexcept {
  for (const PackedBlock& known : packed_)
    if (known.block == block) return known;
  PackedBlock& made = packed_[next_packed_++ % kPackedBlocks];
  made.pack(*mesh_, block);
  return made;
}

bool StarContact::first_entry(const Vec3& from, const Vec3& to, const Stand* left, StarCounters& counters,
                              Hit& hit) noexcept {
  std::uint32_t tested = 0;
  const geometry::Aabb around{from.cwiseMin(to), from.cwiseMax(to)};
  const Way way{from, to, FloatBox::around(around)};
  bool near = covers(from, to), looked = false;
  if (!near)
    near = looked = look_around(to, to - from, counters);
  else if (near_read_ < near_count_)
    tree_->prefetch(*mesh_, near_block_[near_read_++]);
  const auto takes = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) noexcept {
    if (left != nullptr) {
      if (shares(*left, a, b, c)) return false;
      // It leaves to the front: no facet around is met from behind.
      if (side != side_ && stands_in(*mesh_, *left, to, a, b, c)) return false;
    }
    return is_free(a, b, c, side);
  };
  bool met = false;
  bool all = true;
  if (near) {
    for (std::uint32_t node = 0; node * kFanOut < near_count_; ++node)
      for (unsigned mask = near_box_[node].meets(way.box); mask != 0; mask &= mask - 1) {
        met = true;
        const auto child = static_cast<std::uint32_t>(__builtin_ctz(mask));
        const std::uint32_t block = near_block_[node * kFanOut + child];
        if (tree_->layer(block).misses(from, to)) continue;
        const PackedBlock& triangles = packed(block);
        if (triangles.size <= PackedBlock::kMost) [[likely]]
          pierce_packed(*mesh_, triangles, way, hit, tested, takes);
        else
          pierce_block(*mesh_, *tree_, block, way, hit, tested, takes);
      }
  } else {
    all = tree_->for_blocks(around, kMaxNodes,
                            [&](std::uint32_t block, const BoxNode&, std::uint32_t) noexcept {
                              pierce_block(*mesh_, *tree_, block, way, hit, tested, takes);
                              return tested < kMaxTested;
                            });
  }
  counters.tested += tested;
  // Once a look: who is near to a box would ask for its distance in vain in every frame.
  if (looked && !met) note_clear(to);
  return all;
}

/// A triangle of which one corner moves sweeps a tetrahedron; where the HIP is in it the triangle has gone
/// over it. Seen from the HIP its four faces are four signs, each the same for all tetrahedra that share one.
void StarContact::point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept {
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
    const double before = triple(corner, {f, rb, rc}), behind = triple(corner, {t, rb, rc});
    const double at_b = f.dot(t.cross(rb)), at_c = f.dot(t.cross(rc));
    const bool in = before <= 0.0 && behind > 0.0 && at_b <= 0.0 && at_c >= 0.0;
    const bool out = before >= 0.0 && behind < 0.0 && at_b >= 0.0 && at_c <= 0.0;
    const double side = in ? 1.0 : -1.0;
    if (!in && !out) continue;
    if (!is_free(place, b, c, side)) continue;
    Hit hit;
    hit.place = corner;
    hit.side = side;
    stand_on(hit);
    stand_.foot = foot_on(stand_.facet, h);
    pull_ = stand_.foot.point - h;
    return;
  }
}

/// The facet of these corners, or, where an edge of it was split or joined, the nearest to the HIP of those
/// around them: of the same sheet.
void StarContact::take_facet(const std::array<std::uint32_t, 3>& place) noexcept {
  const Vec3 h = stand_.foot.point - pull_;
  Stand nearest;
  const auto offer = [&](const Facet& facet) noexcept {
    const Foot foot = foot_on(facet, h);
    if (foot.distance_sq < nearest.foot.distance_sq) nearest = {facet, foot};
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
  if (nearest.facet.place[0] == kNoPlace) {  // nothing is left there
    start_from(h);
    return;
  }
  stand_ = nearest;
  pull_ = stand_.foot.point - h;
  frame_ = FacetFrame(stand_.facet, side_);
  framed_ = true;
}

}  // namespace palpate::stars
