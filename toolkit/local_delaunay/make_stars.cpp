#include <array>
#include <bit>
#include <cmath>
#include <optional>

#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/avx2_kernels.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"

namespace palpate::local_delaunay {
namespace {

/// Rounds of cutting with neighbours' neighbours, for cells that reach beyond the ball of the nearest.
constexpr int kWiderRounds = 2;
/// First pass: leaves out neighbours that rise by more than 37 degrees, such as another sheet's one spacing
/// away. Losses at creases are repaired later.
constexpr double kFirstSteepest = 0.6;
/// It also leaves out neighbours on a crossing sheet: their plane is turned by more than 60 degrees, and
/// points that rise less than 9 degrees from this one lie on both sides of it, by a quarter of their
/// distance.
constexpr double kTurned = 0.5, kInSheet = 0.15, kBeyond = 0.25;
constexpr float kSurelyAlong = 0.501F;  ///< float bound below which a plane is turned too far
/// Points per chunk at about a microsecond each.
constexpr std::size_t kStarsPerChunk = 4096;

/// A point's neighbours as the cell cutting sees them.
class PlanarNeighbours {
 public:
  PlanarNeighbours(const CandidateTriangulation& candidate, std::uint32_t point, const PlanarLayout& layout)
      : candidate_(candidate),
        normal_(layout.normal),
        steepest_sq_(layout.steepest * layout.steepest),
        near_(candidate.near[point]),
        point_(point),
        apart_(layout.apart),
        flat_(layout.flat),
        p_(candidate.at(point)),
        weight_(static_cast<double>(candidate.point[point].weight)) {
    e_ = layout.normal.unitOrthogonal();
    f_ = layout.normal.cross(e_);
  }
  /// True if the neighbour cut the cell. Most are out of reach; the layout excludes others.
  bool cut(PlanarVoronoiCell& cell, std::uint32_t other) noexcept {
    const SortedPoint& placed = candidate_.point[other];
    const Vec3 d = placed.at() - p_;
    const double square = d.squaredNorm();
    const double weights = weight_ - static_cast<double>(placed.weight);
    const auto reaches = [&](double length_sq) {
      const double half_square = 0.5 * (length_sq + weights);
      return !(half_square > 0.0 && half_square * half_square >= cell.reach_sq() * length_sq);
    };
    if (!flat_ && !reaches(square)) return false;
    if (candidate_.welded[other] != 0) return false;
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
  /// For cut_four(); valid only if no nearest point is to be left out.
  [[nodiscard]] PlanarFrame frame() const noexcept {
    PlanarFrame frame = {p_, normal_, e_, f_, weight_, steepest_sq_, near_.data(), 0};
    const Vec3f n = normal_.cast<float>();
    unsigned doubtful = flat_ ? 1u : 0u;  // branch-free over the neighbours
    for (; frame.count < kNearest && near_[frame.count] != point_; ++frame.count) {
      const std::uint32_t other = near_[frame.count];
      const Vec3f& theirs = candidate_.normal[other];
      const float along = n.x() * theirs.x() + n.y() * theirs.y() + n.z() * theirs.z();
      const unsigned turned = std::abs(along) > kSurelyAlong ? 0u : 1u;
      doubtful |= candidate_.welded[other] | (apart_ ? turned : 0u);
    }
    if (doubtful != 0) frame.count = 0;
    return frame;
  }
  /// True if a neighbour on a crossing sheet was left out.
  [[nodiscard]] bool crossed() const noexcept { return crossed_; }
  [[nodiscard]] const Vec3& at() const noexcept { return p_; }
  [[nodiscard]] const NearestPoints& near() const noexcept { return near_; }

 private:
  /// True if the sheet of `other`, at d, crosses this one: turned by more than 60 degrees, with this sheet's
  /// points on both sides. At a crease they are on one side.
  [[nodiscard]] bool crosses(std::uint32_t other, const Vec3& d) const noexcept {
    const Vec3 theirs = candidate_.normal[other].cast<double>();
    if (theirs == Vec3::Zero() || !(std::abs(normal_.dot(theirs)) < kTurned)) return false;
    const double here = -theirs.dot(d), there = kBeyond * d.norm();
    bool before = here<-there, behind = here> there;
    for (const std::uint32_t k : near_) {
      if (k == point_) break;
      const Vec3 r = candidate_.at(k) - p_;
      const double length = r.norm();
      if (std::abs(normal_.dot(r)) > kInSheet * length) continue;
      const double height = here + theirs.dot(r);
      before = before || height < -kBeyond * length;
      behind = behind || height > kBeyond * length;
    }
    return before && behind;
  }

  const CandidateTriangulation& candidate_;
  Vec3 normal_;
  double steepest_sq_;
  NearestPoints near_;
  std::uint32_t point_;
  bool apart_;
  bool crossed_ = false;
  bool flat_;
  Vec3 p_, e_, f_;
  double weight_;
};

Star star_of(const PlanarVoronoiCell& cell, double reach) noexcept {
  Star star;
  const std::size_t n = cell.size();
  for (std::size_t j = 0; j < n; ++j) {
    if (cell.side(j) == kOpenSide) continue;
    // Sector k is the corner where this edge ends and the next begins.
    const std::size_t end = cell.next(j);
    const bool open = cell.side(end) == kOpenSide || cell.corner_sq(end) > reach * reach;
    star.open |= static_cast<std::uint32_t>(open) << star.size;
    star.ring[star.size++] = cell.side(j);
  }
  // Coincident corners may repeat a neighbour, or leave no triangle.
  if (star.size < 2) star = {};
  return star;
}

/// A corner whose circle leaves the ball of the nearest, `known_sq`, may contain further points: tries the
/// nearest of the corner's neighbours. False if they change nothing.
bool cut_wider(const CandidateTriangulation& candidate, std::uint32_t point, PlanarNeighbours& flat,
               double known_sq, PlanarVoronoiCell& cell) noexcept {
  std::array<std::uint32_t, kMaxCorners> around;
  std::size_t count = 0;
  const auto far = [&](std::size_t c) { return 4.0 * cell.corner_sq(c) > known_sq; };
  for (std::size_t j = 0; j < cell.size(); ++j)
    if (cell.side(j) != kOpenSide && (far(j) || far(cell.next(j)))) around[count++] = cell.side(j);
  const double most_sq = 4.0 * cell.reach_sq();
  bool changed = false;
  for (std::size_t a = 0; a < count; ++a) {
    const NearestPoints near = candidate.near[around[a]];
    for (unsigned left = points_between(candidate.point.data(), near.data(), flat.at(), known_sq, most_sq);
         left != 0; left &= left - 1) {
      const std::uint32_t other = near[static_cast<std::size_t>(std::countr_zero(left))];
      if (other != point && !cell.has_side(other)) changed = flat.cut(cell, other) || changed;
    }
  }
  return changed;
}

/// Builds a star in its plane.
class PlanarStarBuilder {
 public:
  PlanarStarBuilder(const CandidateTriangulation& candidate, std::uint32_t point, const PlanarLayout& layout)
      : candidate_(candidate),
        point_(point),
        flat_(candidate, point, layout),
        around_sq_(ball_sq(candidate, point)),
        reach_(kReachPerBall * std::sqrt(around_sq_)),
        begun_(reach_ > 0.0 && layout.normal != Vec3::Zero()) {}

  [[nodiscard]] bool has_begun() const noexcept { return begun_; }
  [[nodiscard]] PlanarFrame frame() const noexcept { return begun_ ? flat_.frame() : PlanarFrame{}; }
  void start(PlanarVoronoiCell& cell) const noexcept { cell.start(begun_ ? reach_ : 0.0); }
  /// The star of a cell already cut by the first `cut` neighbours.
  [[nodiscard]] Star finish(PlanarVoronoiCell& cell, std::size_t cut,
                            std::span<const std::uint32_t> more) noexcept {
    if (!begun_) return {};
    const NearestPoints& near = flat_.near();
    for (std::size_t k = cut; k < kNearest && near[k] != point_; ++k) flat_.cut(cell, near[k]);
    for (const std::uint32_t other : more)
      if (!cell.has_side(other)) flat_.cut(cell, other);
    const double known_sq = candidate_.sparse[point_] != 0 ? 0.0 : around_sq_;
    for (int round = 0; round < kWiderRounds && 4.0 * cell.reach_sq() > known_sq; ++round)
      if (!cut_wider(candidate_, point_, flat_, known_sq, cell)) break;
    return star_of(cell, reach_);
  }
  [[nodiscard]] bool crossed() const noexcept { return flat_.crossed(); }

 private:
  const CandidateTriangulation& candidate_;
  std::uint32_t point_;
  PlanarNeighbours flat_;
  double around_sq_, reach_;
  bool begun_;
};

/// The first star of each of up to four points.
void four_stars_in_plane(CandidateTriangulation& candidate, std::span<const std::uint32_t> points) noexcept {
  std::array<std::optional<PlanarStarBuilder>, 4> making;
  std::array<PlanarFrame, 4> frames;
  std::array<PlanarVoronoiCell, 4> cells;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const std::uint32_t i = points[k];
    making[k].emplace(candidate, i, PlanarLayout{candidate.normal[i].cast<double>(), kFirstSteepest, true});
    making[k]->start(cells[k]);
    frames[k] = making[k]->frame();
  }
  const std::array<std::size_t, 4> cut = cut_four(candidate.point.data(), frames, cells);
  for (std::size_t k = 0; k < points.size(); ++k) {
    candidate.star.put(points[k], making[k]->finish(cells[k], cut[k], {}));
    if (making[k]->crossed()) candidate.crossed[points[k]] = 1;
  }
}

}  // namespace

Star star_in_plane(const CandidateTriangulation& candidate, std::uint32_t point, const PlanarLayout& layout,
                   std::span<const std::uint32_t> more, std::uint8_t* crossed) {
  PlanarStarBuilder making(candidate, point, layout);
  PlanarVoronoiCell cell;
  making.start(cell);
  const Star star = making.finish(cell, 0, more);
  if (crossed != nullptr && making.crossed()) *crossed = 1;
  return star;
}

std::uint32_t agreed_sectors(const CandidateTriangulation& candidate, std::uint32_t point, const Star& star) {
  std::array<std::uint32_t, kMaxCorners> at;  // the point's index in its ring points' rings
  for (std::uint32_t k = 0; k < star.size; ++k) at[k] = candidate.star.find(star.ring[k], point);
  std::uint32_t agreed = 0;
  for (std::uint32_t k = 0; k < star.size; ++k) {
    if (!star.has_sector(k)) continue;
    const std::uint32_t next = star.next(k), b = star.ring[k], c = star.ring[next];
    if (b != c && candidate.star.holds(b, at[k], c) && candidate.star.holds(c, at[next], b))
      agreed |= 1u << k;
  }
  return agreed;
}

void make_stars(CandidateTriangulation& candidate) {
  candidate.star.resize(candidate.size());
  candidate.crossed.assign(candidate.size(), 0);
  candidate.rough.assign(candidate.size(), 0);
  make_stars_of(candidate, {}, {});
}

void make_stars_of(CandidateTriangulation& candidate, std::span<const std::uint8_t> wanted,
                   std::span<const std::uint8_t> asked) {
  const auto chunks = [&candidate](auto&& use) {
    parallel_chunks(candidate.size(), kStarsPerChunk, candidate.threads, use);
  };
  chunks([&](std::size_t begin, std::size_t end) {
    std::array<std::uint32_t, 4> four;
    std::size_t count = 0;
    for (std::size_t k = begin; k < end; ++k) {
      if (!wanted.empty() && wanted[k] == 0) continue;
      if (candidate.welded[k] != 0)
        candidate.star.put(k, {});
      else
        four[count++] = static_cast<std::uint32_t>(k);
      if (count < four.size()) continue;
      four_stars_in_plane(candidate, four);
      count = 0;
    }
    four_stars_in_plane(candidate, {four.data(), count});
  });
  chunks([&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      if (!asked.empty() && asked[k] == 0) continue;
      const auto i = static_cast<std::uint32_t>(k);
      candidate.star.set_agreed(i, agreed_sectors(candidate, i, candidate.star[i]));
    }
  });
}

}  // namespace palpate::local_delaunay
