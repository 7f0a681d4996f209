// Contact state of one HIP with one local Delaunay mesh.
//
// Segments are intersected with the triangles of a block first.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Geometry>  // cross products
#include "toolkit/geometry/god_object_check.h"
#include "toolkit/local_delaunay/block_bvh.h"
#include "toolkit/local_delaunay/facet.h"
#include "toolkit/local_delaunay/mesh_descent.h"

namespace palpate::local_delaunay {

/// A step of a HIP or god object.
struct SegmentQuery {
  const Vec3 &from, &to;
  FloatBox box;
};

/// The first triangle that a segment crosses.
struct SegmentHit {
  std::array<std::uint32_t, 3> place{kNoPlace, kNoPlace, kNoPlace};
  double fraction = 2.0;  ///< along the segment
  double side = 1.0;      ///< 1: from the outer side, -1: from the inner one
};

/// d . (a x b), bit-identical for both triangles of an edge.
inline double edge_side_product(const Vec3& d, const Vec3& a, const Vec3& b, std::uint32_t place_a,
                                std::uint32_t place_b) noexcept {
  return place_a < place_b ? d.dot(a.cross(b)) : -d.dot(b.cross(a));
}

/// a . (b x c), bit-identical for any first corner of a triangle.
inline double triple_product(std::array<std::uint32_t, 3> place, std::array<Vec3, 3> at) noexcept {
  const auto first = static_cast<std::size_t>(std::min_element(place.begin(), place.end()) - place.begin());
  return at[first].dot(at[(first + 1) % 3].cross(at[(first + 2) % 3]));
}

/// Tests a triangle for an earlier hit. Exact: nothing slips between two triangles of a sheet. takes(a, b, c,
/// side): whether the triangle counts.
template <class Takes>
void intersect_triangle(const LocalDelaunayMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c,
                        const SegmentQuery& way, SegmentHit& hit, Takes&& takes) noexcept {
  const Vec3 &from = way.from, &to = way.to;
  const Vec3 pa = mesh.at(a), pb = mesh.at(b), pc = mesh.at(c);
  const Vec3 n = (pb - pa).cross(pc - pa);
  double before = n.dot(from - pa), behind = n.dot(to - pa);
  // A segment that ends on the plane hits it: the next one would start there without a side.
  bool in = before >= 0.0 && behind <= 0.0 && before > behind,
       out = before <= 0.0 && behind >= 0.0 && behind > before;
  double larger = 1.0;
  if (!in && !out) {
    if (before != 0.0 || behind != 0.0) [[likely]]
      return;
    larger = kDenormalScale;
    before = n.dot(larger * (from - pa));
    behind = n.dot(larger * (to - pa));
    in = before >= 0.0 && behind <= 0.0 && before > behind;
    out = before <= 0.0 && behind >= 0.0 && behind > before;
    if (!in && !out) return;
  }
  const double fraction = before / (before - behind);
  if (!(fraction < hit.fraction)) return;
  const Vec3 d = larger * (to - from);
  const Vec3 ra = pa - from, rb = pb - from, rc = pc - from;
  const double u = edge_side_product(d, ra, rb, a, b), v = edge_side_product(d, rb, rc, b, c),
               w = edge_side_product(d, rc, ra, c, a);
  if (!((u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0))) return;
  const double side = in ? 1.0 : -1.0;
  if (takes(a, b, c, side)) hit = {{a, b, c}, fraction, side};
}

/// Searches a block for an earlier hit.
template <class Takes>
void intersect_block(const LocalDelaunayMesh& mesh, const BlockBvh& tree, std::uint32_t block,
                     const SegmentQuery& way, SegmentHit& hit, std::uint32_t& tested,
                     Takes&& takes) noexcept {
  if (tree.layer(block).misses(way.from, way.to)) return;
  mesh.for_triangles_of_block(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    ++tested;
    if (!mesh.triangle_misses(a, b, c, way.box)) intersect_triangle(mesh, a, b, c, way, hit, takes);
  });
}

/// A block's triangles with their boxes in lanes, in the order of for_triangles_of().
struct PackedBlock {
  /// Half of the blocks have at most sixteen triangles, and one in a thousand more than this.
  static constexpr std::uint32_t kMost = 4 * kBvhWidth;
  std::uint32_t block = kNoPlace;
  std::uint32_t size = 0;  ///< over kMost if they do not fit
  std::array<BvhNode, kMost / kBvhWidth> box;
  std::array<std::array<std::uint32_t, 3>, kMost> corner;

  void pack(const LocalDelaunayMesh& mesh, std::uint32_t of) noexcept {
    block = of;
    size = 0;
    mesh.for_triangles_of_block(of, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const std::uint32_t at = size++;
      if (at >= kMost) return;
      corner[at] = {a, b, c};
      const auto [low, high] = mesh.triangle_box(a, b, c);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box[at / kBvhWidth].low[axis][at % kBvhWidth] = low[axis];
        box[at / kBvhWidth].high[axis][at % kBvhWidth] = high[axis];
      }
    });
  }
};

/// As intersect_block(), given that the layer is met and the block has at most kMost.
template <class Takes>
void intersect_packed(const LocalDelaunayMesh& mesh, const PackedBlock& block, const SegmentQuery& way,
                      SegmentHit& hit, std::uint32_t& tested, Takes&& takes) noexcept {
  tested += block.size;
  for (std::uint32_t first = 0; first < block.size; first += kBvhWidth) {
    const unsigned filled = (1u << std::min(block.size - first, kBvhWidth)) - 1u;
    for (unsigned mask = block.box[first / kBvhWidth].meets(way.box) & filled; mask != 0; mask &= mask - 1) {
      const auto& [a, b, c] = block.corner[first + static_cast<std::uint32_t>(__builtin_ctz(mask))];
      intersect_triangle(mesh, a, b, c, way, hit, takes);
    }
  }
}

/// Bounds on tree nodes and triangles of one query; a flight makes up to three. The longest frames found take
/// 2.3 million instructions (docs/explanation/the-frame.md): jumps through a whole model at these bounds.
inline constexpr std::uint32_t kMaxNodes = 4096;
inline constexpr std::uint32_t kMaxTestedTriangles = 8192;
/// Facets crossed in a straight walk before the general walk takes over.
inline constexpr int kMaxCrossed = 16;
/// Most times per frame that the HIP leaves a sheet and meets another; the rest waits for the next frame.
inline constexpr int kMaxFlights = 4;
/// A frame that exceeds its bound halves the queried part of the HIP's way, down to this share: a facet's
/// width on the longest way through a model of a million points.
inline constexpr double kMinSegmentShare = 0x1p-10;
/// Widest gap that is bridged, in middle edges of the border facet: a void in random points is two spacings
/// wide, a hole in noise little more.
inline constexpr double kGapEdges = 4.0;
/// Density step: where dense points end at a surface this many times as coarse, no triangle joins them, and
/// the gap is as wide as the coarse edges. The search range grows by kFarther up to 1,024 edges, within one
/// query's total bound. Stars cross steps up to 1:4 in spacing (16:1 in density); random points' triangles do
/// not reach twice that.
inline constexpr double kStepEdges = 8.0;
inline constexpr std::uint32_t kStepQueries = 4;
/// Half width of the searched region, as a share of its length: what lies beyond a step lies ahead.
inline constexpr double kStepWidth = 0.25;
/// cos^2 of 45 degrees: a surface across a gap must be within this angle of the way ahead. Beside it the
/// border continues, and a rising part there would hold a HIP long past it.
inline constexpr double kAheadShare = 0.5;
/// cos^2 of 45 degrees: a pull that leans more from the surrounding surface is stuck on something. Checked
/// for pulls that lean from their own facets beyond kSmoothShare.
inline constexpr double kUprightShare = 0.5;
/// The surrounding surface has a direction if its summed area normals reach this share of their total length:
/// two thirds with noise of a fifth of the spacing and one facet in ten flipped.
inline constexpr double kMinOrientationShare = 0.5;
/// Blocks remembered around a free HIP.
inline constexpr std::size_t kMaxBlocksNear = 16;
/// Look-ahead in steps of the HIP: half the look-ups of four steps, twice the blocks.
inline constexpr double kStepsAhead = 8.0;

/// The searched cube's centre is this many steps ahead: it still contains the last step and lasts for
/// fourteen.
inline constexpr double kStepsBefore = 6.0;
/// For a rising HIP, a god object closer than this share of the last queried pull may release within two
/// steps.
inline constexpr double kShallowShare = 0.25;
/// Growth of an empty search, applied twice: a HIP in free air searches once in 128 steps.
inline constexpr double kFarther = 4.0;
inline constexpr int kFartherQueries = 2;
/// Node bound of each such search: four for each of the sixteen blocks.
inline constexpr std::uint32_t kMaxFartherNodes = 64;
/// Blocks kept packed: a HIP stays in one for a dozen frames and crosses two or three at a time.
inline constexpr std::size_t kPackedBlocks = 4;
/// Reductions of a clearance for rounding: about ten float roundings of 6e-8 in boxes, layers and squares,
/// and the double rounding of coordinates.
inline constexpr double kClearShare = 1.0 - 1e-6, kClearSlack = 16.0 * kUnitRoundoff;

/// A closest point is as exact as its coordinates, up to a few roundings.
inline constexpr double kOnSurface = 4.0 * kUnitRoundoff;

/// Most sheets that hold a god object: three crossing ones leave no freedom for a fourth.
inline constexpr std::size_t kMaxSheets = 3;
/// Rounds of taking facets at the last solution, as with several models.
inline constexpr int kHeldRounds = 3;

struct ContactCounters {
  std::uint64_t moves = 0, tested = 0, blocks = 0;
};

/// Local coordinates, mm. Belongs to one thread; reads mesh and tree, which must outlive it. Only attach()
/// allocates.
class MeshContact {
 public:
  void attach(const LocalDelaunayMesh& mesh, const BlockBvh& tree);
  /// Free at h, which defines the free side of each closed piece. O(n) if there are any.
  void reset(const Vec3& h) noexcept;
  /// Free at h, known to be outside contact.
  void start_from(const Vec3& h) noexcept {
    contact_ = false;
    others_count_ = 0;
    from_ = h;
    way_share_ = 1.0;
    forget_shape();
  }
  /// Moves the HIP to h. True in contact: pull() leads to the god object.
  [[nodiscard, gnu::always_inline]] bool update(const Vec3& h, ContactCounters& counters) noexcept {
    bound_hit_ = false;
    const bool held = contact_;
    if (contact_) [[likely]] {
      const FacetFrame::Weights weights = frame_.at(h);
      if (weights.hold() && !watched_) [[likely]] {
        set_pull(h, frame_.pull(weights), Feature::kInside);
        return agrees(h, counters);
      }
      if (!watched_ && cross(h, weights, counters)) return agrees(h, counters);
    } else if (in_clear_ && is_clear(h)) [[likely]] {
      from_ = h;
      return false;
    }
    if (update_general(h, counters)) return agrees(h, counters) && !is_on_surface(h);
    return held && reattach(h, counters);
  }
  /// Between updates: one point moved, and all others are where the mesh has them; its triangles may meet a
  /// resting HIP. Call points_moved() after the last one.
  void point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept;
  /// All points moved and some may be gone: forgets everything known of the shape. standing(place): the
  /// place, or one near it if its point is gone. Work: three rings.
  template <class Standing>
  void points_moved(Standing&& standing) noexcept {
    forget_shape();
    if (!contact_) return;
    const auto& place = position_.facet.place;
    take_facet({standing(place[0]), standing(place[1]), standing(place[2])});
    for (std::uint32_t i = 0; i < others_count_; ++i) {
      const auto& corner = others_[i].position.facet.place;
      others_[i].position.facet =
          Facet(*mesh_, standing(corner[0]), standing(corner[1]), standing(corner[2]));
    }
  }
  /// Most moves from facet to facet in a frame; the rest waits for the next.
  void bound_moves(int most) noexcept { most_moves_ = most; }
  [[nodiscard]] bool contact() const noexcept { return contact_; }
  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  [[nodiscard]] const Vec3& pull() const noexcept { return pull_; }
  [[nodiscard]] const Facet& facet() const noexcept { return position_.facet; }
  /// The position's closest point is of the last frame that crossed a facet's border; the god object is h +
  /// pull().
  [[nodiscard]] const SurfacePosition& position() const noexcept { return position_; }
  /// 1: touched from outside, -1: from inside.
  [[nodiscard]] double side() const noexcept { return side_; }
  /// A further sheet that holds the god object.
  struct Held {
    SurfacePosition position;
    double side = 1.0;
  };
  [[nodiscard]] std::span<const Held> others() const noexcept { return {others_.data(), others_count_}; }

 private:
  /// A pull grown by this factor, squared, is checked again.
  static constexpr double kGrown = 2.0;
  /// Checks now and then that the held place agrees with the HIP's surroundings; false if the HIP is free.
  [[nodiscard, gnu::always_inline]] bool agrees(const Vec3& h, ContactCounters& counters) noexcept {
    const bool grown = position_.closest.distance_sq > check_above_sq_;
    const bool hangs = position_.closest.feature != Feature::kInside &&
                       ++frames_since_check_ >= geometry::kCheckPeriodFrames;
    if (!grown && !hangs) [[likely]]
      return true;
    return check_with_surroundings(h, counters);
  }
  [[nodiscard]] bool check_with_surroundings(const Vec3& h, ContactCounters& counters) noexcept;
  /// After release: a HIP behind the adjacent closed sheet did not leave through it and is held there again.
  [[nodiscard]] bool reattach(const Vec3& h, ContactCounters& counters) noexcept;
  /// Finds the nearest triangle within `most` of h. False if none, or too much to search.
  [[nodiscard]] bool find_around(const Vec3& h, double most, ContactCounters& counters,
                                 SurfacePosition& found) const noexcept;
  /// On the surface: the next frame knows the HIP's side; the pull is within rounding and not felt.
  [[nodiscard]] bool is_on_surface(const Vec3& h) const noexcept {
    return pull_.cwiseAbs().maxCoeff() <= kOnSurface * h.cwiseAbs().maxCoeff();
  }
  void set_pull(const Vec3& h, const Vec3& pull, Feature feature) noexcept {
    pull_ = pull;
    position_.closest = {h + pull, pull.squaredNorm(), feature};
  }
  /// Walks over facets while the projection is beyond an edge. True at rest inside a facet or on an edge
  /// between two. Crossing the only edge passed never increases the distance, because the next facet shares
  /// it; of two it crosses the farther, and the result counts only if the distance did not grow.
  bool cross(const Vec3& h, FacetFrame::Weights weights, ContactCounters& counters) noexcept;
  /// Prefetches around a place where the god object may go.
  void prefetch_around(std::uint32_t place) const noexcept { mesh_->prefetch_ring(place); }
  /// Open pieces can be touched from both sides, closed ones from the side of the replay's start.
  [[nodiscard]] bool is_free(std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) const noexcept;
  /// True if the surrounding facets face the other way.
  [[nodiscard]] bool is_flipped(const Facet& facet) const noexcept;
  /// True if another sheet may cross the facet.
  [[nodiscard]] bool is_crossed(const Facet& facet) const noexcept {
    return mesh_->is_crossed(facet.place[0]) || mesh_->is_crossed(facet.place[1]) ||
           mesh_->is_crossed(facet.place[2]);
  }
  bool update_general(const Vec3& h, ContactCounters& counters) noexcept;
  /// Handles the search of a free HIP's way to `to`, complete (`all`) or cut off by the bound: decides
  /// whether its result stands. A cut-off part is halved until it fits, so a jumping HIP is followed in later
  /// frames.
  bool advance_segment(const Vec3& to, bool all, const SegmentHit& hit) noexcept;
  /// Follows the sheet. False if h is free of it.
  bool follow(const Vec3& h, ContactCounters& counters) noexcept;
  /// Follows the sheet and checks the god object's path against others; a sheet it crosses holds it too.
  bool follow_single_sheet(const Vec3& h, ContactCounters& counters) noexcept;
  /// The first triangle of another sheet on the god object's path.
  bool meet_other_sheet(const Vec3& from, const Vec3& to, ContactCounters& counters,
                        SegmentHit& hit) noexcept;
  /// Several sheets hold: moves the god object to the place nearest to h behind none of them. False if none
  /// holds any more.
  bool solve_all_sheets(const Vec3& h, ContactCounters& counters) noexcept;
  /// The place nearest to `at` on a facet of one of the sheets.
  [[nodiscard]] Vec3 on_facet(std::span<const Held> held, const Vec3& at) const noexcept;
  /// Keeps the holding sheets, with the god object on one of their facets.
  void stay_at(const Vec3& at, const Vec3& h) noexcept;
  /// A facet sees h in front, at a distance. True if the surrounding surface disagrees: the facet is flipped.
  [[nodiscard]] bool still_behind(const Vec3& h, double edge_sq) const noexcept;
  /// The HIP is behind the sheet, past its border by more than an edge. True if the god object stays: the
  /// surface continues within kGapEdges, and the god object moves there if that is nearer to the HIP, else
  /// waits at the border. Such gaps come from sampling and cannot be entered.
  bool bridge(const Vec3& h, double edge, ContactCounters& counters) noexcept;
  /// The same where the surface ahead is at least kStepEdges as coarse: the gap may be kGapEdges of its edges
  /// wide.
  bool bridge_step(const Vec3& h, double edge, ContactCounters& counters) noexcept;
  /// Direction past the border along the surrounding surface, unit, in `ahead`; returns the length, zero at
  /// the border.
  [[nodiscard]] double way_ahead(const Vec3& h, Vec3& ahead) const noexcept;
  /// Moves the god object to another facet that holds the HIP too.
  void move_to(const Facet& facet, const ClosestPoint& closest, const Vec3& h) noexcept;
  /// The first triangle that the way from -> to enters from a free side. `skip`: places whose triangles are
  /// ignored.
  bool first_entry(const Vec3& from, const Vec3& to, const SurfacePosition* left, ContactCounters& counters,
                   SegmentHit& hit) noexcept;
  void set_position(const SegmentHit& hit) noexcept;
  void take_facet(const std::array<std::uint32_t, 3>& place) noexcept;
  void forget_blocks() noexcept {
    near_reach_ = -1.0;
    clear_sq_ = -1.0;
  }
  /// Called when points may have moved.
  void forget_shape() noexcept {
    forget_blocks();
    for (PackedBlock& block : packed_) block.block = kNoPlace;
  }
  /// Finds the blocks around the way ahead of a HIP at `at` after `step`: within kStepsAhead, or farther if
  /// there are none.
  bool find_blocks_near(const Vec3& at, const Vec3& step, ContactCounters& counters) noexcept;
  /// True if the known blocks include all that meet the segment.
  [[nodiscard]] bool covers(const Vec3& a, const Vec3& b) const noexcept {
    return std::max((a - near_at_).cwiseAbs().maxCoeff(), (b - near_at_).cwiseAbs().maxCoeff()) <=
           near_reach_;
  }
  /// After the god object crossed to another facet: prefetches, a part per frame, what release will need.
  /// That is the tree above the place and, for a rising HIP near the surface, the blocks and triangles
  /// around.
  void prefetch_for_release(const Vec3& h, bool rises, ContactCounters& counters) noexcept;
  bool find_blocks(const Vec3& at, double reach, std::uint32_t most) noexcept;
  [[nodiscard]] bool is_clear(const Vec3& h) const noexcept {
    return (h - clear_at_).squaredNorm() < clear_sq_;
  }
  /// Computes how far a free HIP may move from h without meeting anything: to the nearest known box or
  /// unknown space.
  void update_clearance(const Vec3& h) noexcept;
  [[nodiscard]] const PackedBlock& packed(std::uint32_t block) noexcept;

  const LocalDelaunayMesh* mesh_ = nullptr;
  const BlockBvh* tree_ = nullptr;
  std::vector<double> free_side_;  ///< per closed piece
  bool contact_ = false;
  int most_moves_ = kMaxFacetMoves;
  bool bound_hit_ = false;
  double side_ = 1.0;
  Vec3 pull_ = Vec3::Zero();
  FacetFrame frame_;
  bool framed_ = false;   ///< frame_ belongs to position_.facet
  bool watched_ = false;  ///< another sheet may cross the facet: no fast frames
  SurfacePosition position_;
  double check_above_sq_ = 0.0;              ///< squared pull beyond which the surroundings are checked
  int frames_since_check_ = 0;               ///< frames on an edge or corner since the last check
  std::array<Held, kMaxSheets - 1> others_;  ///< sheets besides position_'s
  std::uint32_t others_count_ = 0;
  Vec3 from_ = Vec3::Zero();  ///< free up to here
  double way_share_ = 1.0;    ///< share of the remaining way that a frame searches

  // Blocks that meet the cube of half edge near_reach_ around near_at_: two nodes' worth.
  Vec3 near_at_ = Vec3::Zero();
  double near_reach_ = -1.0;
  std::array<BvhNode, kMaxBlocksNear / kBvhWidth> near_box_;
  std::array<std::uint32_t, kMaxBlocksNear> near_block_{};
  std::uint32_t near_count_ = 0;
  std::uint32_t near_read_ = 0;         ///< of these, prefetched: one per free frame
  std::uint32_t node_read_ = kNoPlace;  ///< tree node prefetched
  // Nothing is within this distance of clear_at_.
  Vec3 clear_at_ = Vec3::Zero();
  double clear_sq_ = -1.0;
  bool in_clear_ = false;  ///< from_ is inside; a HIP from elsewhere may have met something
  // Blocks that the HIP crossed lately, replaced in turn.
  std::array<PackedBlock, kPackedBlocks> packed_;
  std::uint32_t next_packed_ = 0;
};

}  // namespace palpate::local_delaunay
