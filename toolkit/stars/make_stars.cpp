#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/stars/draft.h"
#include "toolkit/stars/near_places.h"
#include "toolkit/surface/least_direction.h"

namespace palpate::stars {
namespace {

/// Points nearer to one another than this share of the distance to the fourth neighbour are one: a facet
/// between them would have a direction of noise alone.
constexpr float kWeldShare = 0.02F;
constexpr std::size_t kScaleRank = 3;  ///< the fourth neighbour
/// Four points of a lattice lie on one circle, and each of them lays them out a little differently. Weights
/// by chance, the same for all that look, of up to this share of the square of the spacing settle which
/// diagonal it is.
constexpr float kTieShare = 0.01F;
/// Rounds in which a cell that reaches beyond the ball of the nearest is cut with the nearest of its
/// neighbours too.
constexpr int kWiderRounds = 2;
/// Points a plane is fitted to: the nearest twelve at first.
constexpr std::array<std::size_t, 3> kPlaneSizes = {6, 8, 12};
/// Less than this part of the variance across it is a plane: noise of a quarter of the spacing makes 0.03, a
/// crease of 90 degrees 0.08, a second sheet a spacing off a fifth.
constexpr double kPlaneShare = 0.1;
/// At first a neighbour that rises by more than 37 degrees is left out: another sheet's, a spacing away, is,
/// and what is left out at a crease is mended afterwards.
constexpr double kFirstSteepest = 0.6;
/// And one of a sheet that goes through this one: its plane is turned by more than 60 degrees, and points
/// that rise less than 9 degrees from this one lie on both sides of it, by a quarter of how far they are.
constexpr double kTurned = 0.5, kInSheet = 0.15, kBeyond = 0.25;
/// Points a chunk where each takes about a microsecond.
constexpr std::size_t kStarsPerChunk = 4096;

/// A power of two that grows with the model: as a float's exponent, where it stands in a float's bits.
std::uint32_t scale_bits(const std::vector<Placed>& points) noexcept {
  constexpr std::uint32_t kExponent = 0x7F800000u;
  float most = 0.0F;
  for (const Placed& p : points)
    most = std::max({most, std::abs(p.x_mm), std::abs(p.y_mm), std::abs(p.z_mm)});
  return std::bit_cast<std::uint32_t>(most) & kExponent;
}

/// Between 0 and 1, of the point's place alone, with exponents counted from the model's: so that a model
/// twice as large is settled alike.
float tie_weight(const Placed& p, std::uint32_t scale) noexcept {
  const auto bits = [scale](float x) {
    return x == 0.0F ? std::uint64_t{0} : std::uint64_t{std::bit_cast<std::uint32_t>(x) - scale};
  };
  std::uint64_t h = bits(p.x_mm) * kGolden64;
  h = (h ^ (h >> 29) ^ bits(p.y_mm)) * kGolden64;
  h = (h ^ (h >> 31) ^ bits(p.z_mm)) * kGolden64;
  return static_cast<float>(h >> 40) * 0x1p-24F;
}

/// The nearest points of a scan line may all be the line's own: where twelve of them have a second spread of
/// less than a tenth of the first (a border's have a quarter), these are not enough.
constexpr double kLineMinors = 0.08;  ///< L1 L2 / (L1 + L2)^2
/// Then so many are looked at, and of each of eight directions the nearest two taken.
constexpr std::size_t kWideNear = 128;
constexpr std::size_t kDirections = 8;
constexpr std::size_t kOfEachDirection = kNear / kDirections;

/// Sums over offsets from a point.
struct Moments {
  Vec3 first = Vec3::Zero();
  surface::Symmetric second;
  std::size_t count = 0;

  void add(const Vec3& d) noexcept {
    first += d;
    second.xx += d.x() * d.x();
    second.xy += d.x() * d.y();
    second.xz += d.x() * d.z();
    second.yy += d.y() * d.y();
    second.yz += d.y() * d.z();
    second.zz += d.z() * d.z();
    ++count;
  }
  /// Of the offsets and of the point itself, times their number.
  [[nodiscard]] surface::Symmetric covariance() const noexcept {
    const double share = 1.0 / static_cast<double>(count + 1);
    const Vec3& m = first;
    return {second.xx - share * m.x() * m.x(), second.xy - share * m.x() * m.y(),
            second.xz - share * m.x() * m.z(), second.yy - share * m.y() * m.y(),
            second.yz - share * m.y() * m.z(), second.zz - share * m.z() * m.z()};
  }
};

/// The variance along a direction as a part of all: nothing for points of a plane, a third for a ball.
double share_along(const surface::Symmetric& c, const Vec3& n) noexcept {
  const double along = n.x() * (c.xx * n.x() + 2.0 * (c.xy * n.y() + c.xz * n.z())) +
                       n.y() * (c.yy * n.y() + 2.0 * c.yz * n.z()) + c.zz * n.z() * n.z();
  return along / c.trace();
}

/// Where sheets cross or fold: the plane through the point and two of its nearest ten that most of the
/// nearest lie in, if half of them do; else `otherwise`.
Vec3 normal_of_most(const Draft& draft, std::uint32_t i, const Vec3& otherwise) noexcept {
  constexpr std::size_t kSpanning = 10, kEnough = 6;
  constexpr double kInPlane = 0.08;   // height for distance: 5 degrees
  constexpr double kLeastSine = 0.3;  // of the angle that spans a plane
  std::array<Vec3, kNear> at;
  std::size_t size = 0;
  for (; size < kNear && draft.near[i][size] != i; ++size)
    at[size] = draft.at(draft.near[i][size]) - draft.at(i);
  Vec3 best = otherwise;
  std::size_t most = kEnough - 1;
  double least = HUGE_VAL;
  for (std::size_t a = 0; a < std::min(size, kSpanning); ++a)
    for (std::size_t b = a + 1; b < std::min(size, kSpanning); ++b) {
      const Vec3 n = at[a].cross(at[b]);
      const double square = n.squaredNorm();
      if (!(square > kLeastSine * kLeastSine * at[a].squaredNorm() * at[b].squaredNorm())) continue;
      std::size_t in_plane = 0;
      double off = 0.0;
      for (std::size_t k = 0; k < size; ++k) {
        const double height = n.dot(at[k]);
        const double off_sq = height * height / (square * at[k].squaredNorm());
        if (!(off_sq < kInPlane * kInPlane)) continue;
        ++in_plane;
        off += off_sq;
      }
      if (in_plane < most || (in_plane == most && !(off < least)) || in_plane < kEnough) continue;
      most = in_plane;
      least = off;
      best = n / std::sqrt(square);
    }
  return best;
}

/// What the nearest twelve say of the surface at a point.
struct Surroundings {
  std::array<surface::Symmetric, kPlaneSizes.size()> covariance;  ///< as kPlaneSizes

  Surroundings(const Draft& draft, std::uint32_t i) noexcept {
    const Vec3 p = draft.at(i);
    const Near& near = draft.near[i];
    Moments moments;
    std::size_t size = 0;
    for (std::size_t k = 0; k < kPlaneSizes.size(); ++k) {
      for (; size < kPlaneSizes[k] && near[size] != i; ++size) moments.add(draft.at(near[size]) - p);
      covariance[k] = moments.covariance();
    }
  }
  [[nodiscard]] bool is_line() const noexcept {
    const surface::Symmetric& c = covariance.back();
    const double trace = c.trace();
    return c.adjugate().trace() < kLineMinors * trace * trace;
  }
  /// Of the nearest twelve; where these are no plane (another sheet's are among them) of fewer, if those are
  /// more of one.
  [[nodiscard]] Vec3 normal(const Draft& draft, std::uint32_t i) const noexcept {
    Vec3 best = Vec3::Zero();
    double least = HUGE_VAL;
    for (std::size_t k = covariance.size(); k-- > 0 && !(least < kPlaneShare);) {
      Vec3 of_these;
      if (!surface::least_direction(covariance[k], of_these)) continue;
      const double share = share_along(covariance[k], of_these);
      if (share < least) {
        least = share;
        best = of_these;
      }
    }
    return least < kPlaneShare ? best : normal_of_most(draft, i, best);
  }
};

/// The nearest in each direction of the plane of `count` points, sorted by distance.
void keep_directions(const Draft& draft, std::uint32_t self, std::span<const std::uint32_t> others,
                     Near& near) {
  const Vec3 p = draft.at(self);
  Moments moments;
  for (const std::uint32_t other : others) moments.add(draft.at(other) - p);
  Vec3 normal;
  if (!surface::least_direction(moments.covariance(), normal)) return;
  const Vec3 e = normal.unitOrthogonal(), f = normal.cross(e);
  std::array<std::size_t, kDirections> taken{};
  std::size_t size = 0;
  for (const std::uint32_t other : others) {
    const Vec3 d = draft.at(other) - p;
    const double u = e.dot(d), v = f.dot(d);
    const std::size_t direction =
        (u > 0.0 ? 1u : 0u) + (v > 0.0 ? 2u : 0u) + (std::abs(u) > std::abs(v) ? 4u : 0u);
    if (taken[direction] == kOfEachDirection) continue;
    ++taken[direction];
    near[size++] = other;
    if (size == kNear) break;
  }
  for (; size < kNear; ++size) near[size] = self;
}

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
  /// Whether one was left out as on a sheet that crosses.
  [[nodiscard]] bool crossed() const noexcept { return crossed_; }
  [[nodiscard]] double square(std::uint32_t other) const noexcept {
    return (draft_.at(other) - p_).squaredNorm();
  }

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
  for (std::size_t a = 0; a < count; ++a)
    for (const std::uint32_t other : draft.near[around[a]]) {
      if (other == point) continue;
      const double square = flat.square(other);
      if (square > known_sq && square <= most_sq && !cell.has_side(other))
        changed = flat.cut(cell, other) || changed;
    }
  return changed;
}

}  // namespace

void find_near(Draft& draft, const std::vector<std::uint8_t>& doubled) {
  draft.near.resize(draft.size());
  draft.normal.assign(draft.size(), Vec3f::Zero());
  find_near_of(draft, doubled, {});
}

void find_near_of(Draft& draft, const std::vector<std::uint8_t>& doubled,
                  std::span<const std::uint8_t> wanted) {
  draft.welded = doubled;
  draft.sparse.assign(draft.size(), 0);
  const NearPlaces places(draft.point, doubled, draft.threads);
  const auto keep = [&draft](std::uint32_t self, const Nearby& nearby) {
    Near& near = draft.near[self];
    std::copy_n(nearby.place.begin(), nearby.size, near.begin());
    std::fill(near.begin() + static_cast<std::ptrdiff_t>(nearby.size), near.end(), self);
  };
  std::atomic<bool> any_line = false;
  const std::uint32_t scale = scale_bits(draft.point);
  places.run(kNear, wanted, draft.threads, [&](std::uint32_t i, const Nearby& nearby) {
    keep(i, nearby);
    if (nearby.size == 0) return;
    const float scale_sq = nearby.square[std::min(kScaleRank, nearby.size - 1)];
    draft.point[i].weight = kTieShare * scale_sq * tie_weight(draft.point[i], scale);
    for (std::size_t k = 0; k < nearby.size && nearby.square[k] <= kWeldShare * kWeldShare * scale_sq; ++k)
      if (nearby.place[k] < i) draft.welded[i] = 1;
    const Surroundings around(draft, i);
    draft.sparse[i] = static_cast<std::uint8_t>(around.is_line());
    if (draft.sparse[i] != 0)
      any_line.store(true, std::memory_order_relaxed);
    else
      draft.normal[i] = around.normal(draft, i).cast<float>();
  });
  if (!any_line.load()) return;
  places.run(kWideNear, draft.sparse, draft.threads, [&](std::uint32_t i, const Nearby& nearby) {
    keep_directions(draft, i, {nearby.place.data(), nearby.size}, draft.near[i]);
    draft.normal[i] = Surroundings(draft, i).normal(draft, i).cast<float>();
  });
}

void near_of_stars(Draft& draft) {
  const std::uint32_t scale = scale_bits(draft.point);
  parallel_chunks(draft.size(), kStarsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const auto i = static_cast<std::uint32_t>(k);
      const Star& star = draft.star[i];
      const std::size_t size = std::min<std::size_t>(star.size, kNear);
      std::array<std::pair<float, std::uint32_t>, kNear> found;
      for (std::size_t j = 0; j < size; ++j) {
        const std::uint32_t other = star.ring[j];
        found[j] = {static_cast<float>((draft.at(other) - draft.at(i)).squaredNorm()), other};
      }
      std::sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(size));
      Near& near = draft.near[i];
      near.fill(i);
      for (std::size_t j = 0; j < size; ++j) near[j] = found[j].second;
      if (size == 0) continue;
      const float scale_sq = found[std::min(kScaleRank, size - 1)].first;
      draft.point[i].weight = kTieShare * scale_sq * tie_weight(draft.point[i], scale);
    }
  });
}

Star lay_out(const Draft& draft, std::uint32_t point, const Layout& layout,
             std::span<const std::uint32_t> more, std::uint8_t* crossed) {
  const double around_sq = ball_sq(draft, point);
  const double reach = reach_per_ball(draft) * std::sqrt(around_sq);
  if (!(reach > 0.0) || layout.normal == Vec3::Zero()) return {};
  FlatNeighbours flat(draft, point, layout);
  FlatCell cell;
  cell.start(reach);
  for (const std::uint32_t other : draft.near[point]) {
    if (other == point) break;
    flat.cut(cell, other);
  }
  for (const std::uint32_t other : more)
    if (!cell.has_side(other)) flat.cut(cell, other);
  const double known_sq = draft.sparse[point] != 0 ? 0.0 : around_sq;
  for (int round = 0; round < kWiderRounds && 4.0 * cell.reach_sq() > known_sq; ++round)
    if (!cut_wider(draft, point, flat, known_sq, cell)) break;
  if (crossed != nullptr && flat.crossed()) *crossed = 1;
  return star_of(cell, reach);
}

double share_across(const Draft& draft, std::uint32_t point) {
  return share_along(Surroundings(draft, point).covariance.back(), draft.normal[point].cast<double>());
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
  const bool apart = !draft.without.crossings;
  const auto those = [&draft](std::span<const std::uint8_t> marked, auto&& use) {
    parallel_chunks(draft.size(), kStarsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k)
        if (marked.empty() || marked[k] != 0) use(static_cast<std::uint32_t>(k));
    });
  };
  those(wanted, [&](std::uint32_t i) {
    draft.star[i] = {};
    if (draft.welded[i] == 0)
      draft.star[i] =
          lay_out(draft, i, {draft.normal[i].cast<double>(), kFirstSteepest, apart}, {}, &draft.crossed[i]);
  });
  those(asked, [&](std::uint32_t i) { draft.star[i].agreed = agreed_sectors(draft, i, draft.star[i]); });
}

}  // namespace palpate::stars
