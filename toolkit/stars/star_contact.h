// The contact state of one HIP with one star mesh.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/geometry/held_place.h"
#include "toolkit/stars/pierce.h"
#include "toolkit/stars/star_tree.h"
#include "toolkit/stars/star_walk.h"

namespace palpate::stars {

/// Nodes of the tree that one look may take, and triangles it may test; a flight looks three times. The
/// longest frames found take 2.3 million instructions (docs/hunt.md): jumps through a whole model, which test
/// as many triangles as they may.
inline constexpr std::uint32_t kMaxNodes = 4096;
inline constexpr std::uint32_t kMaxTested = 8192;
/// Facets crossed straight on; where more are needed the walk that looks all around goes on.
inline constexpr int kMaxCrossed = 16;
/// Times a frame may leave one sheet and meet another; the rest is done in the next.
inline constexpr int kMaxFlights = 4;
/// Where a frame cannot look at all that lies around the HIP's way, the next one takes half of it: this share
/// at least, a facet's width on the longest way through a model of a million points.
inline constexpr double kLeastWayShare = 0x1p-10;
/// A gap of so many edges is bridged, the middle one of the facet at its border: a void in random points is
/// two spacings wide, and a hole in noise little more.
inline constexpr double kGapEdges = 4.0;
/// Where a crowd of points ends in a surface this many times as coarse no triangle joins the two, and the gap
/// is as wide as the coarse edges are long: it is looked for so many times as far, each time by kFarther, up
/// to 1,024 edges, at no more nodes and triangles in all than another look takes. Up to a step of 1:4 (16:1
/// in density) the points' own stars go across; twice that is no step of random points' triangles.
inline constexpr double kStepEdges = 8.0;
inline constexpr std::uint32_t kStepLooks = 4;
/// What is looked at is so wide, on either side, as a share of its length: what lies beyond a step lies
/// ahead.
inline constexpr double kStepWidth = 0.25;
/// What lies across a gap is less than 45 degrees off the way ahead, the square of its cosine: beside it the
/// border itself goes on, and what rises there would hold a HIP that is long past it.
inline constexpr double kAheadShare = 0.5;
/// A pull that leans by more than 45 degrees from the surface around hangs on something: the square of its
/// cosine. Looked at where it leans by more than kSmoothShare tells from the facets that it stands on.
inline constexpr double kUprightShare = 0.5;
/// The surface around faces one way where the sum of its area normals is so long a part of their lengths: at
/// noise of a fifth of the spacing, with one facet in ten turned over, it is two thirds.
inline constexpr double kTrendShare = 0.5;
/// Blocks remembered around a free HIP.
inline constexpr std::size_t kMaxBlocksNear = 16;
/// Steps of the HIP that they are looked up for: half of the look-ups of four, twice the blocks.
inline constexpr double kStepsAhead = 8.0;

/// The middle of the cube that they are looked up in lies so many steps ahead: it still holds where the HIP
/// was a step ago, and lasts for fourteen.
inline constexpr double kStepsBefore = 6.0;
/// A god object so near to a HIP that rises, as a share of what was looked at last, may let go within two
/// steps.
inline constexpr double kShallowShare = 0.25;
/// Where there are none they are looked for so many times as far, and once more: a HIP in free air looks
/// around once in 128 steps.
inline constexpr double kFarther = 4.0;
inline constexpr int kFartherLooks = 2;
/// Nodes that each of these looks may take: four for each of the sixteen blocks that it may find.
inline constexpr std::uint32_t kMaxFartherNodes = 64;
/// Blocks whose triangles are kept packed: a HIP goes through one for a dozen frames, and through two or
/// three at a time.
inline constexpr std::size_t kPackedBlocks = 4;
/// A clearance is less by the roundings of single precision that its boxes and layers, and the squares of
/// their distances, go through: some ten of 6e-8. And by those of places in double precision, of their
/// coordinates.
inline constexpr double kClearShare = 1.0 - 1e-6, kClearSlack = 16.0 * kUnitRoundoff;

/// A foot is as exact as the coordinates that it is made of, but for some roundings.
inline constexpr double kOnSurface = 4.0 * kUnitRoundoff;

/// Sheets that hold a god object together: of three that cross, none adds a place where it may go.
inline constexpr std::size_t kMaxHeld = 3;
/// Times the facets are looked up again where the last solution lies, as for several models.
inline constexpr int kHeldRounds = 3;

struct StarCounters {
  std::uint64_t moves = 0, tested = 0, blocks = 0;
};

/// Everything in local coordinates, mm. Belongs to one thread; mesh and tree are only read and must outlive
/// this. Allocates in attach() alone.
class StarContact {
 public:
  void attach(const StarMesh& mesh, const StarTree& tree);
  /// Free at h; of each closed piece the side where h is is the free one. O(n) where there are any.
  void reset(const Vec3& h) noexcept;
  /// Free at h, known to be clear.
  void start_from(const Vec3& h) noexcept {
    contact_ = false;
    others_count_ = 0;
    from_ = h;
    way_share_ = 1.0;
    forget_shape();
  }
  /// The HIP is now at h. True in contact: pull() leads to the god object.
  [[nodiscard, gnu::always_inline]] bool update(const Vec3& h, StarCounters& counters) noexcept {
    bound_hit_ = corrected_ = false;
    const bool held = contact_;
    if (contact_) [[likely]] {
      const FacetFrame::Weights weights = frame_.at(h);
      if (weights.hold() && !watched_) [[likely]] {
        rest_at(h, frame_.pull(weights), Feature::kInside);
        return agrees(h, counters);
      }
      if (!watched_ && cross(h, weights, counters)) return agrees(h, counters);
    } else if (in_clear_ && is_clear(h)) [[likely]] {
      from_ = h;
      return false;
    }
    if (update_slowly(h, counters)) return agrees(h, counters) && !is_on_surface(h);
    return held && regain(h, counters);
  }
  /// A point of the mesh has gone from one place to another between two updates, and all others are where the
  /// mesh has them: a HIP that rests may be met by its triangles. After the last one: points_moved().
  void point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept;
  /// All points are where they are now, and some may be gone: nothing is kept that was known of the surface's
  /// shape. standing(place): the place, or one near it where its point is gone. Work: three rings.
  template <class Standing>
  void points_moved(Standing&& standing) noexcept {
    forget_shape();
    if (!contact_) return;
    const auto& place = stand_.facet.place;
    take_facet({standing(place[0]), standing(place[1]), standing(place[2])});
    for (std::uint32_t i = 0; i < others_count_; ++i) {
      const auto& corner = others_[i].stand.facet.place;
      others_[i].stand.facet = Facet(*mesh_, standing(corner[0]), standing(corner[1]), standing(corner[2]));
    }
  }
  /// Moves of the god object from facet to facet in a frame, at most; what is left is done in the next.
  void bound_moves(int most) noexcept { most_moves_ = most; }
  [[nodiscard]] bool contact() const noexcept { return contact_; }
  /// In this frame the place held was found not to agree with what is around the HIP: the pull without that,
  /// else null.
  [[nodiscard]] const Vec3* corrected_from() const noexcept { return corrected_ ? &uncorrected_ : nullptr; }
  [[nodiscard]] bool bound_hit() const noexcept { return bound_hit_; }
  [[nodiscard]] const Vec3& pull() const noexcept { return pull_; }
  [[nodiscard]] const Facet& facet() const noexcept { return stand_.facet; }
  /// The stand's foot is of the last frame that moved over a facet's border; h + pull() is the god object.
  [[nodiscard]] const Stand& stand() const noexcept { return stand_; }
  /// 1: the outer side is touched, -1: the inner one.
  [[nodiscard]] double side() const noexcept { return side_; }
  /// A further sheet that holds the god object.
  struct Held {
    Stand stand;
    double side = 1.0;
  };
  [[nodiscard]] std::span<const Held> others() const noexcept { return {others_.data(), others_count_}; }

 private:
  /// A pull that has grown so much, squared, is looked at again.
  static constexpr double kGrown = 2.0;
  /// The place held agrees with what is around the HIP, now and then looked at: false where the HIP is free.
  [[nodiscard, gnu::always_inline]] bool agrees(const Vec3& h, StarCounters& counters) noexcept {
    const bool grown = stand_.foot.distance_sq > look_sq_;
    const bool hangs = stand_.foot.feature != Feature::kInside && ++unlooked_ >= geometry::kLookEvery;
    if (!grown && !hangs) [[likely]]
      return true;
    return agree_with(h, counters);
  }
  [[nodiscard]] bool agree_with(const Vec3& h, StarCounters& counters) noexcept;
  /// Just let go: a HIP that is behind the closed sheet next to it never left through it, and is held there.
  [[nodiscard]] bool regain(const Vec3& h, StarCounters& counters) noexcept;
  /// The nearest triangle within `most` of h; false where there is none, or too much to look at.
  [[nodiscard]] bool find_around(const Vec3& h, double most, StarCounters& counters,
                                 Stand& found) const noexcept;
  /// Met, so that the next frame knows the HIP's side; the pull is no more than rounding, and nothing is
  /// felt.
  [[nodiscard]] bool is_on_surface(const Vec3& h) const noexcept {
    return pull_.cwiseAbs().maxCoeff() <= kOnSurface * h.cwiseAbs().maxCoeff();
  }
  void rest_at(const Vec3& h, const Vec3& pull, Feature feature) noexcept {
    pull_ = pull;
    stand_.foot = {h + pull, pull.squaredNorm(), feature};
  }
  /// From facet to facet while the foot is beyond an edge: true where it comes to rest inside a facet, or on
  /// the edge between two. Over the only edge that it is beyond the distance never grows, for that edge is a
  /// part of the next facet too; beyond two of them it goes over the farther, and only counts if it did not.
  bool cross(const Vec3& h, FacetFrame::Weights weights, StarCounters& counters) noexcept;
  /// Reads ahead what lies around a place: where the god object may go next.
  void read_ahead(std::uint32_t place) const noexcept { mesh_->prefetch_ring(place); }
  /// Both sides of an open piece can be touched, of a closed one that where the replay began.
  [[nodiscard]] bool is_free(std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) const noexcept;
  /// The facets around it face the other way.
  [[nodiscard]] bool is_turned_over(const Facet& facet) const noexcept;
  /// Another sheet may go through the facet.
  [[nodiscard]] bool is_crossed(const Facet& facet) const noexcept {
    return mesh_->is_crossed(facet.place[0]) || mesh_->is_crossed(facet.place[1]) ||
           mesh_->is_crossed(facet.place[2]);
  }
  bool update_slowly(const Vec3& h, StarCounters& counters) noexcept;
  /// A free HIP's way up to there was looked at, `all` of it or what a frame may, and it was a part of the
  /// way or will be: whether the hit, or that there is none, stands. The part is halved until it is little
  /// enough, so that a HIP that jumped far is caught up with.
  bool go_on(const Vec3& to, bool all, const Hit& hit) noexcept;
  /// Follows the sheet. False where h is free of it.
  bool follow(const Vec3& h, StarCounters& counters) noexcept;
  /// Follows the sheet, and looks whether the god object went through another on its way: then both hold it.
  bool follow_alone(const Vec3& h, StarCounters& counters) noexcept;
  /// The first triangle of another sheet on the god object's way.
  bool meet_other(const Vec3& from, const Vec3& to, StarCounters& counters, Hit& hit) noexcept;
  /// Several sheets hold: the god object goes to the place nearest to h that is behind none of them. False
  /// where none holds any more.
  bool hold_together(const Vec3& h, StarCounters& counters) noexcept;
  /// The place nearest to `at` on a facet of one of the sheets.
  [[nodiscard]] Vec3 on_facet(std::span<const Held> held, const Vec3& at) const noexcept;
  /// What holds goes on holding, and the god object is at a place on one of its facets.
  void stay_at(const Vec3& at, const Vec3& h) noexcept;
  /// A facet says that h is in front, and h is not next to it. True where the surface around says otherwise:
  /// the facet is turned over.
  [[nodiscard]] bool still_behind(const Vec3& h, double edge_sq) const noexcept;
  /// The HIP is behind the sheet and past its border by more than an edge. True where the god object stays:
  /// the surface goes on within kGapEdges, and either the god object is at home there, nearer to the HIP, or
  /// it waits at the border. Gaps that narrow are what sampling leaves, not what anybody could enter.
  bool bridge(const Vec3& h, double edge, StarCounters& counters) noexcept;
  /// The same where what is ahead is kStepEdges as coarse or more: the gap may be kGapEdges of its edges
  /// wide.
  bool bridge_step(const Vec3& h, double edge, StarCounters& counters) noexcept;
  /// The way ahead of a HIP past a border, unit, along the surface around; its length. Zero where it is at
  /// the border.
  [[nodiscard]] double way_ahead(const Vec3& h, Vec3& ahead) const noexcept;
  /// The god object goes to a place of another facet that holds the HIP as well.
  void move_to(const Facet& facet, const Foot& foot, const Vec3& h) noexcept;
  /// The first triangle that the way from -> to enters from a side that is free. `skip`: places whose
  /// triangles do not count.
  bool first_entry(const Vec3& from, const Vec3& to, const Stand* left, StarCounters& counters,
                   Hit& hit) noexcept;
  void stand_on(const Hit& hit) noexcept;
  void take_facet(const std::array<std::uint32_t, 3>& place) noexcept;
  void forget_blocks() noexcept {
    near_reach_ = -1.0;
    clear_sq_ = -1.0;
  }
  /// Points may be elsewhere.
  void forget_shape() noexcept {
    forget_blocks();
    for (PackedBlock& block : packed_) block.block = kNoPlace;
  }
  /// Which blocks are around the way ahead of a HIP that is at `at` after a step: within kStepsAhead, or
  /// farther around it where there are none.
  bool look_around(const Vec3& at, const Vec3& step, StarCounters& counters) noexcept;
  /// The blocks known are all that meet the segment between the two.
  [[nodiscard]] bool covers(const Vec3& a, const Vec3& b) const noexcept {
    return std::max((a - near_at_).cwiseAbs().maxCoeff(), (b - near_at_).cwiseAbs().maxCoeff()) <=
           near_reach_;
  }
  /// A god object that crossed to another facet: what it will need where it lets go is read before, a part a
  /// frame. The tree above the place; for a HIP that rises near the surface the blocks around, then the
  /// triangles it stands among.
  void get_ready(const Vec3& h, bool rises, StarCounters& counters) noexcept;
  bool find_blocks(const Vec3& at, double reach, std::uint32_t most) noexcept;
  [[nodiscard]] bool is_clear(const Vec3& h) const noexcept {
    return (h - clear_at_).squaredNorm() < clear_sq_;
  }
  /// How far a free HIP may go from h before it can meet anything: to the nearest box known, or to where
  /// others may be.
  void note_clear(const Vec3& h) noexcept;
  [[nodiscard]] const PackedBlock& packed(std::uint32_t block) noexcept;

  const StarMesh* mesh_ = nullptr;
  const StarTree* tree_ = nullptr;
  std::vector<double> free_side_;  ///< of each closed piece
  bool contact_ = false;
  int most_moves_ = kMaxFacetMoves;
  bool bound_hit_ = false, corrected_ = false;
  Vec3 uncorrected_ = Vec3::Zero();
  double side_ = 1.0;
  Vec3 pull_ = Vec3::Zero();
  FacetFrame frame_;
  bool framed_ = false;   ///< frame_ is that of stand_.facet
  bool watched_ = false;  ///< another sheet may go through it: no frame is a quick one
  Stand stand_;
  double look_sq_ = 0.0;  ///< a longer pull, squared, is compared with what is around the HIP
  int unlooked_ = 0;      ///< frames on an edge or corner since it was
  std::array<Held, kMaxHeld - 1> others_;  ///< what holds besides stand_
  std::uint32_t others_count_ = 0;
  Vec3 from_ = Vec3::Zero();  ///< free up to here
  double way_share_ = 1.0;    ///< of the way from there, looked at in one frame

  // Blocks that meet the cube of half edge near_reach_ around near_at_: two nodes' worth of boxes.
  Vec3 near_at_ = Vec3::Zero();
  double near_reach_ = -1.0;
  std::array<BoxNode, kMaxBlocksNear / kFanOut> near_box_;
  std::array<std::uint32_t, kMaxBlocksNear> near_block_{};
  std::uint32_t near_count_ = 0;
  std::uint32_t near_read_ = 0;         ///< of them, asked for: one in a free frame
  std::uint32_t node_read_ = kNoPlace;  ///< of the tree, asked for
  // Nothing is so near to clear_at_.
  Vec3 clear_at_ = Vec3::Zero();
  double clear_sq_ = -1.0;
  bool in_clear_ = false;  ///< from_ is there: who comes from elsewhere may have met something on the way
  // Blocks that the HIP went through lately, the oldest is the next to go.
  std::array<PackedBlock, kPackedBlocks> packed_;
  std::uint32_t next_packed_ = 0;
};

}  // namespace palpate::stars
