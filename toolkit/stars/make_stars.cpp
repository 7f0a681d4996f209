#include <algorithm>
#include <bit>
#include <cmath>

#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/neighbourhood/knn_engine.h"
#include "toolkit/stars/draft.h"
#include "toolkit/surface/least_direction.h"

namespace palpate::stars {
namespace {

/// Points nearer to one another than this share of the distance to the fourth neighbour are one: a facet
/// between them would have a direction of noise alone.
constexpr double kWeldShare = 0.02;
constexpr std::size_t kScaleRank = 3;  ///< the fourth neighbour
/// Four points of a lattice lie on one circle, and each of them lays them out a little differently. Weights
/// by chance, the same for all that look, of up to this share of the square of the spacing settle which
/// diagonal it is.
constexpr double kTieShare = 0.01;
/// Rounds in which a cell that reaches beyond the ball of the nearest is cut with the nearest of its
/// neighbours too.
constexpr int kWiderRounds = 2;
/// Points a plane is fitted to at first: the nearest twelve.
constexpr std::size_t kPlanePoints = 12;
constexpr std::array<std::size_t, 3> kPlaneSizes = {kPlanePoints, 8, 6};
/// Less than this part of the variance across it is a plane: noise of a quarter of the spacing makes 0.03, a
/// crease of 90 degrees 0.08, a second sheet a spacing off a fifth.
constexpr double kPlaneShare = 0.1;
/// At first a neighbour that rises by more than 37 degrees is left out: another sheet's, a spacing away, is,
/// and what is left out at a crease is mended afterwards.
constexpr double kFirstSteepest = 0.6;
/// Points a chunk where each takes about a microsecond.
constexpr std::size_t kStarsPerChunk = 4096;

/// Between 0 and 1, of the point's place alone; of the digits and not the exponents, so that a model twice as
/// large is settled alike.
double tie_weight(const cloud::Cloud& cloud, std::uint32_t i) noexcept {
  constexpr std::uint32_t kExponent = 0x7F800000u;
  const auto bits = [](float x) {
    return static_cast<std::uint64_t>(std::bit_cast<std::uint32_t>(x) & ~kExponent);
  };
  std::uint64_t h = bits(cloud.x_mm[i]) * kGolden64;
  h = (h ^ (h >> 29) ^ bits(cloud.y_mm[i])) * kGolden64;
  h = (h ^ (h >> 31) ^ bits(cloud.z_mm[i])) * kGolden64;
  return static_cast<double>(h >> 40) * 0x1p-24;
}

/// The kMost nearest of the kept candidates, nearest first.
template <std::size_t kMost>
class Nearest {
 public:
  void take(const neighbourhood::Scratch& scratch, std::uint32_t self) {
    found_.clear();
    for (std::size_t k = 0; k < scratch.count; ++k)
      if (scratch.index[k] != self) found_.emplace_back(scratch.square[k], scratch.index[k]);
    const auto most = found_.begin() + static_cast<std::ptrdiff_t>(std::min(found_.size(), kMost));
    if (most != found_.end()) std::nth_element(found_.begin(), most, found_.end());
    found_.erase(most, found_.end());
    std::sort(found_.begin(), found_.end());
    index_.clear();
    for (const auto& [square, index] : found_) index_.push_back(index);
  }
  /// Infinite while there are fewer.
  [[nodiscard]] double worst() const noexcept {
    return found_.size() < kMost ? neighbourhood::kEverything : found_.back().first;
  }
  [[nodiscard]] std::span<const std::uint32_t> indices() const noexcept { return index_; }

 private:
  std::vector<std::pair<double, std::uint32_t>> found_;  ///< squared distance, index
  std::vector<std::uint32_t> index_;
};

/// use(point, its kMost nearest) for every wanted point.
template <std::size_t kMost, class Use>
void run_nearest(const neighbourhood::KnnEngine& engine, std::span<const std::uint8_t> wanted, Use&& use) {
  const neighbourhood::Kernels& kernel = neighbourhood::kernels();
  neighbourhood::NeighbourTable unused;
  engine.run(
      [&](std::uint32_t self, const Vec3& p, const neighbourhood::Candidates& candidates, double radius_mm,
          neighbourhood::Neighbours&, neighbourhood::Scratch& scratch) {
        const double covered = radius_mm * radius_mm;
        static thread_local Nearest<kMost> nearest;
        for (double guess = scratch.guess;; guess = neighbourhood::larger_guess(guess)) {
          const bool all = !(guess < covered);
          kernel.keep_ball(candidates, p, all ? neighbourhood::kEverything : guess, scratch);
          nearest.take(scratch, self);
          if (!all && !(nearest.worst() <= guess)) continue;
          scratch.guess = neighbourhood::kGuessRoom * nearest.worst();
          if (nearest.worst() >= covered && radius_mm != neighbourhood::kEverything) return false;
          use(self, nearest.indices());
          return true;
        }
      },
      unused, wanted);
}

/// The nearest points of a scan line may all be the line's own: where twelve of them have a second spread of
/// less than a tenth of the first (a border's have a quarter), these are not enough.
constexpr double kLineMinors = 0.08;  ///< L1 L2 / (L1 + L2)^2
/// Then so many are looked at, and of each of eight directions the nearest two taken.
constexpr std::size_t kWideNear = 128;
constexpr std::size_t kDirections = 8;
constexpr std::size_t kOfEachDirection = kNear / kDirections;

/// Of `count` offsets from a point, and of the point itself.
surface::Symmetric covariance_of(const Vec3* at, std::size_t count) noexcept {
  Vec3 mean = Vec3::Zero();
  for (std::size_t k = 0; k < count; ++k) mean += at[k];
  mean /= static_cast<double>(count + 1);
  surface::Symmetric c;
  const auto add = [&c](const Vec3& d) {
    c.xx += d.x() * d.x();
    c.xy += d.x() * d.y();
    c.xz += d.x() * d.z();
    c.yy += d.y() * d.y();
    c.yz += d.y() * d.z();
    c.zz += d.z() * d.z();
  };
  add(-mean);
  for (std::size_t k = 0; k < count; ++k) add(at[k] - mean);
  return c;
}

std::size_t offsets_of(const Draft& draft, std::uint32_t i, std::array<Vec3, kPlanePoints>& at) noexcept {
  const Vec3 p = draft.at(i);
  std::size_t count = 0;
  for (; count < kPlanePoints && draft.near[i][count] != i; ++count)
    at[count] = draft.at(draft.near[i][count]) - p;
  return count;
}

bool is_line(const surface::Symmetric& c) noexcept {
  const double trace = c.trace();
  return c.adjugate().trace() < kLineMinors * trace * trace;
}

/// The variance along a direction as a part of all: nothing for points of a plane, a third for a ball.
double share_along(const surface::Symmetric& c, const Vec3& n) noexcept {
  const double along = n.x() * (c.xx * n.x() + 2.0 * (c.xy * n.y() + c.xz * n.z())) +
                       n.y() * (c.yy * n.y() + 2.0 * c.yz * n.z()) + c.zz * n.z() * n.z();
  return along / c.trace();
}

/// Of the nearest twelve; where these are no plane (another sheet's are among them) of fewer, if those are
/// more of one.
Vec3 plane_normal(const Draft& draft, std::uint32_t i) noexcept {
  std::array<Vec3, kPlanePoints> at;
  const std::size_t all = offsets_of(draft, i, at);
  Vec3 best = Vec3::Zero();
  double least = HUGE_VAL;
  for (const std::size_t wanted : kPlaneSizes) {
    const surface::Symmetric c = covariance_of(at.data(), std::min(wanted, all));
    Vec3 normal;
    if (!surface::least_direction(c, normal)) continue;
    const double share = share_along(c, normal);
    if (share < least) {
      least = share;
      best = normal;
    }
    if (least < kPlaneShare) break;
  }
  return best;
}

/// The nearest in each direction of the plane of `count` points, sorted by distance.
void keep_directions(const Draft& draft, std::uint32_t self, std::span<const std::uint32_t> others,
                     Near& near) {
  const Vec3 p = draft.at(self);
  std::array<Vec3, kWideNear> at;
  std::size_t count = 0;
  for (const std::uint32_t other : others) at[count++] = draft.at(other) - p;
  Vec3 normal;
  if (!surface::least_direction(covariance_of(at.data(), count), normal)) return;
  const Vec3 e = normal.unitOrthogonal(), f = normal.cross(e);
  std::array<std::size_t, kDirections> taken{};
  std::size_t size = 0;
  for (std::size_t k = 0; k < count && size < kNear; ++k) {
    const double u = e.dot(at[k]), v = f.dot(at[k]);
    const std::size_t direction =
        (u > 0.0 ? 1u : 0u) + (v > 0.0 ? 2u : 0u) + (std::abs(u) > std::abs(v) ? 4u : 0u);
    if (taken[direction] == kOfEachDirection) continue;
    ++taken[direction];
    near[size++] = others[k];
  }
  for (; size < kNear; ++size) near[size] = self;
}

/// The neighbours of a point as the cutting sees them.
class FlatNeighbours {
 public:
  FlatNeighbours(const Draft& draft, std::uint32_t point, const Layout& layout)
      : draft_(draft), layout_(layout), p_(draft.at(point)) {
    e_ = layout.normal.unitOrthogonal();
    f_ = layout.normal.cross(e_);
    weight_ = weight(point);
  }
  /// False where the layout leaves it out.
  bool flatten(std::uint32_t other, FlatPoint& flat) const noexcept {
    if (draft_.welded[other] != 0) return false;
    const Vec3 d = draft_.at(other) - p_;
    const double square = d.squaredNorm();
    const double height = layout_.normal.dot(d);
    if (height * height > layout_.steepest * layout_.steepest * square) return false;
    const double u = e_.dot(d), v = f_.dot(d);
    const double in_plane = u * u + v * v;
    if (!(in_plane > 0.0)) return false;
    const double unfold = std::sqrt(square / in_plane);
    flat = {u * unfold, v * unfold, 0.5 * (square + weight_ - weight(other))};
    return true;
  }

 private:
  [[nodiscard]] double weight(std::uint32_t i) const noexcept {
    return kTieShare * static_cast<double>(draft_.scale_sq[i]) * tie_weight(*draft_.cloud, i);
  }
  const Draft& draft_;
  const Layout& layout_;
  Vec3 p_, e_, f_;
  double weight_;
};

Star star_of(const FlatCell& cell, double reach) noexcept {
  Star star;
  const std::size_t n = cell.size();
  for (std::size_t j = 0; j < n; ++j) {
    if (cell[j].side == kOpenSide) continue;
    // Sector k lies at the corner where this edge ends and the next one begins.
    const FlatCell::Corner& end = cell[j + 1 == n ? 0 : j + 1];
    const bool open = end.side == kOpenSide || end.u * end.u + end.v * end.v > reach * reach;
    star.open |= static_cast<std::uint32_t>(open) << star.size;
    star.ring[star.size++] = cell[j].side;
  }
  // Two corners that fall together leave one neighbour twice in a row, or less than a triangle.
  if (star.size < 2) star = {};
  return star;
}

}  // namespace

void find_near(Draft& draft) {
  const cloud::Cloud& cloud = *draft.cloud;
  const std::size_t n = cloud.size();
  draft.near.resize(n);
  draft.normal.resize(n);
  draft.scale_sq.resize(n);
  draft.welded.assign(n, 0);
  draft.sparse.assign(n, 0);
  const neighbourhood::KnnEngine engine(cloud, draft.threads);
  run_nearest<kNear>(engine, {}, [&](std::uint32_t self, std::span<const std::uint32_t> nearest) {
    Near& near = draft.near[self];
    std::copy(nearest.begin(), nearest.end(), near.begin());
    std::fill(near.begin() + static_cast<std::ptrdiff_t>(nearest.size()), near.end(), self);
  });
  std::vector<std::size_t> lines((n + kPointsPerChunk - 1) / kPointsPerChunk, 0);
  parallel_chunks(n, kPointsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const auto i = static_cast<std::uint32_t>(k);
      const double scale_sq = (draft.at(draft.near[i][kScaleRank]) - draft.at(i)).squaredNorm();
      draft.scale_sq[i] = static_cast<float>(scale_sq);
      for (const std::uint32_t other : draft.near[i]) {
        if ((draft.at(other) - draft.at(i)).squaredNorm() > kWeldShare * kWeldShare * scale_sq) break;
        if (other < i) draft.welded[i] = 1;
      }
      std::array<Vec3, kPlanePoints> at;
      draft.sparse[i] = is_line(covariance_of(at.data(), offsets_of(draft, i, at)));
      lines[begin / kPointsPerChunk] += draft.sparse[i];
    }
  });
  if (std::any_of(lines.begin(), lines.end(), [](std::size_t count) { return count > 0; }))
    run_nearest<kWideNear>(engine, draft.sparse,
                           [&](std::uint32_t self, std::span<const std::uint32_t> nearest) {
                             keep_directions(draft, self, nearest, draft.near[self]);
                           });
  parallel_chunks(n, kPointsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      draft.normal[i] = plane_normal(draft, static_cast<std::uint32_t>(i)).cast<float>();
  });
}

Star lay_out(const Draft& draft, std::uint32_t point, const Layout& layout,
             std::span<const std::uint32_t> more) {
  const Near& near = draft.near[point];
  const Vec3 p = draft.at(point);
  const double around_sq = ball_sq(draft, point);
  const double reach = kReachPerBall * std::sqrt(around_sq);
  if (!(reach > 0.0) || layout.normal == Vec3::Zero()) return {};
  const FlatNeighbours flat_of(draft, point, layout);
  FlatCell cell;
  cell.start(reach);
  FlatPoint flat;
  const auto cut = [&](std::uint32_t other) {
    if (flat_of.flatten(other, flat)) cell.cut(flat, other);
  };
  for (const std::uint32_t other : near) {
    if (other == point) break;
    cut(other);
  }
  for (const std::uint32_t other : more)
    if (!cell.has_side(other)) cut(other);
  const double known_sq = draft.sparse[point] != 0 ? 0.0 : around_sq;
  for (int round = 0; round < kWiderRounds; ++round) {
    // A corner whose circle leaves the ball may have a point in it that is not among the nearest.
    const double reach_sq = cell.reach_sq();
    if (4.0 * reach_sq <= known_sq) break;
    std::array<std::uint32_t, kMaxCorners> around;
    std::size_t count = 0;
    const auto far = [&](std::size_t c) {
      return 4.0 * (cell[c].u * cell[c].u + cell[c].v * cell[c].v) > known_sq;
    };
    for (std::size_t j = 0; j < cell.size(); ++j)
      if (cell[j].side != kOpenSide && (far(j) || far(j + 1 == cell.size() ? 0 : j + 1)))
        around[count++] = cell[j].side;
    for (std::size_t a = 0; a < count; ++a)
      for (const std::uint32_t other : draft.near[around[a]]) {
        if (other == point) continue;
        const double square = (draft.at(other) - p).squaredNorm();
        if (square > known_sq && square <= 4.0 * reach_sq && !cell.has_side(other)) cut(other);
      }
  }
  return star_of(cell, reach);
}

std::uint32_t agreed_sectors(const Draft& draft, std::uint32_t point, const Star& star) {
  std::uint32_t agreed = 0;
  for (std::uint32_t k = 0; k < star.size; ++k) {
    if (!star.has_sector(k)) continue;
    const std::uint32_t b = star.ring[k], c = star.ring[star.next(k)];
    if (b != c && draft.star[b].holds(point, c) && draft.star[c].holds(point, b)) agreed |= 1u << k;
  }
  return agreed;
}

void make_stars(Draft& draft) {
  const std::size_t n = draft.size();
  draft.star.resize(n);
  parallel_chunks(n, kStarsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const auto i = static_cast<std::uint32_t>(k);
      draft.star[i] = {};
      if (draft.welded[i] == 0)
        draft.star[i] = lay_out(draft, i, {draft.normal[i].cast<double>(), kFirstSteepest});
    }
  });
  parallel_chunks(n, kStarsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const auto i = static_cast<std::uint32_t>(k);
      draft.star[i].agreed = agreed_sectors(draft, i, draft.star[i]);
    }
  });
}

}  // namespace palpate::stars
