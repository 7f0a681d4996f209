#include <array>
#include <bit>
#include <cmath>
#include <optional>

#include "toolkit/core/parallel.h"
#include "toolkit/stars/draft.h"
#include "toolkit/stars/wide_cell.h"
#include "toolkit/stars/wide_near.h"

namespace palpate::stars {
namespace {

/// Rounds in which a cell that reaches beyond the ball of the nearest is cut with the nearest of its
/// neighbours too.
constexpr int kWiderRounds = 2;
/// At first a neighbour that rises by more than 37 degrees is left out: another sheet's, a spacing away, is,
/// and what is left out at a crease is mended afterwards.
constexpr double kFirstSteepest = 0.6;
/// And one of a sheet that goes through this one: its plane is turned by more than 60 degrees, and points
/// that rise less than 9 degrees from this one lie on both sides of it, by a quarter of how far they are.
constexpr double kTurned = 0.5, kInSheet = 0.15, kBeyond = 0.25;
constexpr float kSurelyAlong = 0.501F;  ///< in floats: not turned so far
/// Points a chunk where each takes about a microsecond.
constexpr std::size_t kStarsPerChunk = 4096;

/// The neighbours of a point as the cutting sees them.
class FlatNeighbours {
 public:
  FlatNeighbours(const Draft& draft, std::uint32_t point, const Layout& layout)
      : draft_(draft),
        normal_(layout.normal),
        steepest_sq_(layout.steepest * layout.steepest),
        near_(draft.near[point]),
        point_(point),
        apart_(layout.apart),
        flat_(layout.flat),
        p_(draft.at(point)),
        weight_(static_cast<double>(draft.point[point].weight)) {
    e_ = layout.normal.unitOrthogonal();
    f_ = layout.normal.cross(e_);
  }
  /// Whether the cell lost something to the neighbour. Most do not reach it; the layout leaves others out.
  bool cut(FlatCell& cell, std::uint32_t other) noexcept {
    const Placed& placed = draft_.point[other];
    const Vec3 d = placed.at() - p_;
    const double square = d.squaredNorm();
    const double weights = weight_ - static_cast<double>(placed.weight);
    const auto reaches = [&](double length_sq) {
      const double half_square = 0.5 * (length_sq + weights);
      return !(half_square > 0.0 && half_square * half_square >= cell.reach_sq() * length_sq);
    };
    if (!flat_ && !reaches(square)) return false;
    if (draft_.welded[other] != 0) return false;
    if (apart_ && crosses(other, d)) {
      crossed_ = true;
      return false;
    }
    const double height = normal_.dot(d);
    if (height * height > steepest_sq_ * square) return false;
    const double u = e_.dot(d), v = f_.dot(d);
    const double in_plane = u * u + v * v;
    if (!(in_plane > 0.0)) return false;
    if (flat_) return reaches(in_plane) && cell.cut({u, v, 0.5 * (in_plane + weights)}, other);
    const double unfold = std::sqrt(square / in_plane);
    return cell.cut({u * unfold, v * unfold, 0.5 * (square + weights)}, other);
  }
  /// For cut_four(): of nobody where some of the nearest may be left out.
  [[nodiscard]] FlatFrame frame() const noexcept {
    FlatFrame frame = {p_, normal_, e_, f_, weight_, steepest_sq_, near_.data(), 0};
    const Vec3f n = normal_.cast<float>();
    unsigned doubtful = flat_ ? 1u : 0u;  // without a branch for each
    for (; frame.count < kNear && near_[frame.count] != point_; ++frame.count) {
      const std::uint32_t other = near_[frame.count];
      const Vec3f& theirs = draft_.normal[other];
      const float along = n.x() * theirs.x() + n.y() * theirs.y() + n.z() * theirs.z();
      const unsigned turned = std::abs(along) > kSurelyAlong ? 0u : 1u;
      doubtful |= draft_.welded[other] | (apart_ ? turned : 0u);
    }
    if (doubtful != 0) frame.count = 0;
    return frame;
  }
  /// Whether one was left out as on a sheet that crosses.
  [[nodiscard]] bool crossed() const noexcept { return crossed_; }
  [[nodiscard]] const Vec3& at() const noexcept { return p_; }

 private:
  /// Whether the sheet of `other`, which is at d, goes through this one: it is turned by more than 60
  /// degrees, and this one's points lie on both sides of it. At a crease they lie on one.
  [[nodiscard]] bool crosses(std::uint32_t other, const Vec3& d) const noexcept {
    const Vec3 theirs = draft_.normal[other].cast<double>();
    if (theirs == Vec3::Zero() || !(std::abs(normal_.dot(theirs)) < kTurned)) return false;
    const double here = -theirs.dot(d), there = kBeyond * d.norm();
    bool before = here<-there, behind = here> there;
    for (const std::uint32_t k : near_) {
      if (k == point_) break;
      const Vec3 r = draft_.at(k) - p_;
      const double length = r.norm();
      if (std::abs(normal_.dot(r)) > kInSheet * length) continue;
      const double height = here + theirs.dot(r);
      before = before || height < -kBeyond * length;
      behind = behind || height > kBeyond * length;
    }
    return before && behind;
  }

  const Draft& draft_;
  Vec3 normal_;
  double steepest_sq_;
  const Near& near_;
  std::uint32_t point_;
  bool apart_;
  bool crossed_ = false;
  bool flat_;
  Vec3 p_, e_, f_;
  double weight_;
};

Star star_of(const FlatCell& cell, double reach) noexcept {
  Star star;
  const std::size_t n = cell.size();
  for (std::size_t j = 0; j < n; ++j) {
    if (cell.side(j) == kOpenSide) continue;
    // Sector k lies at the corner where this edge ends and the next one begins.
    const std::size_t end = cell.next(j);
    const bool open = cell.side(end) == kOpenSide || cell.corner_sq(end) > reach * reach;
    star.open |= static_cast<std::uint32_t>(open) << star.size;
    star.ring[star.size++] = cell.side(j);
  }
  // Two corners that fall together leave one neighbour twice in a row, or less than a triangle.
  if (star.size < 2) star = {};
  return star;
}

/// A corner whose circle leaves the ball of the nearest, `known_sq`, may have a point in it that is not among
/// them: the nearest of the corner's neighbours are asked. False where they change nothing.
bool cut_wider(const Draft& draft, std::uint32_t point, FlatNeighbours& flat, double known_sq,
               FlatCell& cell) noexcept {
  std::array<std::uint32_t, kMaxCorners> around;
  std::size_t count = 0;
  const auto far = [&](std::size_t c) { return 4.0 * cell.corner_sq(c) > known_sq; };
  for (std::size_t j = 0; j < cell.size(); ++j)
    if (cell.side(j) != kOpenSide && (far(j) || far(cell.next(j)))) around[count++] = cell.side(j);
  const double most_sq = 4.0 * cell.reach_sq();
  bool changed = false;
  for (std::size_t a = 0; a < count; ++a) {
    const Near& near = draft.near[around[a]];
    for (unsigned left = places_between(draft.point.data(), near.data(), flat.at(), known_sq, most_sq);
         left != 0; left &= left - 1) {
      const std::uint32_t other = near[static_cast<std::size_t>(std::countr_zero(left))];
      if (other != point && !cell.has_side(other)) changed = flat.cut(cell, other) || changed;
    }
  }
  return changed;
}

/// A star that is being laid out.
class LayingOut {
 public:
  LayingOut(const Draft& draft, std::uint32_t point, const Layout& layout)
      : draft_(draft),
        point_(point),
        flat_(draft, point, layout),
        around_sq_(ball_sq(draft, point)),
        reach_(kReachPerBall * std::sqrt(around_sq_)),
        begun_(reach_ > 0.0 && layout.normal != Vec3::Zero()) {}

  [[nodiscard]] bool has_begun() const noexcept { return begun_; }
  [[nodiscard]] FlatFrame frame() const noexcept { return begun_ ? flat_.frame() : FlatFrame{}; }
  void start(FlatCell& cell) const noexcept { cell.start(begun_ ? reach_ : 0.0); }
  /// The star of a cell that the first `cut` of the nearest were asked for.
  [[nodiscard]] Star finish(FlatCell& cell, std::size_t cut, std::span<const std::uint32_t> more) noexcept {
    if (!begun_) return {};
    const Near& near = draft_.near[point_];
    for (std::size_t k = cut; k < kNear && near[k] != point_; ++k) flat_.cut(cell, near[k]);
    for (const std::uint32_t other : more)
      if (!cell.has_side(other)) flat_.cut(cell, other);
    const double known_sq = draft_.sparse[point_] != 0 ? 0.0 : around_sq_;
    for (int round = 0; round < kWiderRounds && 4.0 * cell.reach_sq() > known_sq; ++round)
      if (!cut_wider(draft_, point_, flat_, known_sq, cell)) break;
    return star_of(cell, reach_);
  }
  [[nodiscard]] bool crossed() const noexcept { return flat_.crossed(); }

 private:
  const Draft& draft_;
  std::uint32_t point_;
  FlatNeighbours flat_;
  double around_sq_, reach_;
  bool begun_;
};

/// The first star of each of up to four points.
void lay_out_four(Draft& draft, std::span<const std::uint32_t> points) noexcept {
  std::array<std::optional<LayingOut>, 4> making;
  std::array<FlatFrame, 4> frames;
  std::array<FlatCell, 4> cells;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const std::uint32_t i = points[k];
    making[k].emplace(draft, i, Layout{draft.normal[i].cast<double>(), kFirstSteepest, true});
    making[k]->start(cells[k]);
    frames[k] = making[k]->frame();
  }
  const std::array<std::size_t, 4> cut = cut_four(draft.point.data(), frames, cells);
  for (std::size_t k = 0; k < points.size(); ++k) {
    draft.star[points[k]] = making[k]->finish(cells[k], cut[k], {});
    if (making[k]->crossed()) draft.crossed[points[k]] = 1;
  }
}

}  // namespace

Star lay_out(const Draft& draft, std::uint32_t point, const Layout& layout,
             std::span<const std::uint32_t> more, std::uint8_t* crossed) {
  LayingOut making(draft, point, layout);
  FlatCell cell;
  making.start(cell);
  const Star star = making.finish(cell, 0, more);
  if (crossed != nullptr && making.crossed()) *crossed = 1;
  return star;
}

std::uint32_t agreed_sectors(const Draft& draft, std::uint32_t point, const Star& star) {
  std::array<std::uint32_t, kMaxCorners> at;  // where the point stands in the rings of its own ring
  for (std::uint32_t k = 0; k < star.size; ++k) at[k] = draft.star[star.ring[k]].find(point);
  std::uint32_t agreed = 0;
  for (std::uint32_t k = 0; k < star.size; ++k) {
    if (!star.has_sector(k)) continue;
    const std::uint32_t next = star.next(k), b = star.ring[k], c = star.ring[next];
    if (b != c && draft.star[b].holds(at[k], c) && draft.star[c].holds(at[next], b)) agreed |= 1u << k;
  }
  return agreed;
}

void make_stars(Draft& draft) {
  draft.star.resize(draft.size());
  draft.crossed.assign(draft.size(), 0);
  draft.rough.assign(draft.size(), 0);
  make_stars_of(draft, {}, {});
}

void make_stars_of(Draft& draft, std::span<const std::uint8_t> wanted, std::span<const std::uint8_t> asked) {
  const auto chunks = [&draft](auto&& use) {
    parallel_chunks(draft.size(), kStarsPerChunk, draft.threads, use);
  };
  chunks([&](std::size_t begin, std::size_t end) {
    std::array<std::uint32_t, 4> four;
    std::size_t count = 0;
    for (std::size_t k = begin; k < end; ++k) {
      if (!wanted.empty() && wanted[k] == 0) continue;
      if (draft.welded[k] != 0)
        draft.star[k] = {};
      else
        four[count++] = static_cast<std::uint32_t>(k);
      if (count < four.size()) continue;
      lay_out_four(draft, four);
      count = 0;
    }
    lay_out_four(draft, {four.data(), count});
  });
  chunks([&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      if (!asked.empty() && asked[k] == 0) continue;
      const auto i = static_cast<std::uint32_t>(k);
      draft.star[i].agreed = agreed_sectors(draft, i, draft.star[i]);
    }
  });
}

}  // namespace palpate::stars
