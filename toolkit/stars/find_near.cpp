#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>

#include "toolkit/core/hash.h"
#include "toolkit/core/lanes.h"
#include "toolkit/core/parallel.h"
#include "toolkit/stars/draft.h"
#include "toolkit/stars/near_places.h"
#include "toolkit/stars/wide_near.h"
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
/// Points a plane is fitted to: the nearest twelve at first.
constexpr std::array<std::size_t, 3> kPlaneSizes = {6, 8, kPlaneNear};
/// Less than this part of the variance across it is a plane: noise of a quarter of the spacing makes 0.03, a
/// crease of 90 degrees 0.08, a second sheet a spacing off a fifth.
constexpr double kPlaneShare = 0.1;
/// Points a chunk where each takes about a microsecond.
constexpr std::size_t kSeenPerChunk = 4096;

/// A power of two that grows with the model: as a float's exponent, where it stands in a float's bits.
std::uint32_t scale_bits(const UnsetVector<Placed>& points) noexcept {
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
    second.add(d);
    ++count;
  }
  /// Of the offsets and of the point itself, times their number.
  [[nodiscard]] surface::Symmetric covariance() const noexcept {
    return second.without(first, 1.0 / static_cast<double>(count + 1));
  }
};

/// The variance along a direction as a part of all: nothing for points of a plane, a third for a ball.
double share_along(const surface::Symmetric& c, const Vec3& n) noexcept {
  const double along = n.x() * (c.xx * n.x() + 2.0 * (c.xy * n.y() + c.xz * n.z())) +
                       n.y() * (c.yy * n.y() + 2.0 * c.yz * n.z()) + c.zz * n.z() * n.z();
  return along / c.trace();
}

/// Whether points of this covariance lie along a line.
bool is_line(const surface::Symmetric& c) noexcept {
  const double trace = c.trace();
  return c.adjugate().trace() < kLineMinors * trace * trace;
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
  [[nodiscard]] bool is_line() const noexcept { return stars::is_line(covariance.back()); }
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

/// The planes of places of a block whose nearest are known, four at a time where there are lanes for it.
/// False: it lies on a line.
class BlockPlanes {
 public:
  BlockPlanes(Draft& draft, bool wide) noexcept : draft_(draft), wide_(wide) {}
  ~BlockPlanes() = default;
  BlockPlanes(const BlockPlanes&) = delete;
  BlockPlanes& operator=(const BlockPlanes&) = delete;

  void add(std::uint32_t place) noexcept {
    // Of fewer than twelve, places to fill up with are the place's own: one by one.
    if (!wide_ || draft_.near[place][kPlaneNear - 1] == place) {
      settle(place);
      return;
    }
    place_[count_] = place;
    near_[count_++] = draft_.near[place].data();
    if (count_ == place_.size()) finish();
  }
  void finish() noexcept {
    if (count_ == 0) return;
    for (std::size_t k = count_; k < place_.size(); ++k) {
      place_[k] = place_[0];
      near_[k] = near_[0];
    }
    FourPlanes planes;
    four_planes(draft_.point.data(), place_, near_, planes);
    for (std::size_t k = 0; k < count_; ++k) {
      const bool is_plane = planes.has_normal[k] && !stars::is_line(planes.covariance[k]) &&
                            share_along(planes.covariance[k], planes.normal[k]) < kPlaneShare;
      if (is_plane)
        draft_.normal[place_[k]] = planes.normal[k].cast<float>();
      else
        settle(place_[k]);
    }
    count_ = 0;
  }
  [[nodiscard]] bool any_line() const noexcept { return any_line_; }

 private:
  void settle(std::uint32_t place) noexcept {
    const Surroundings around(draft_, place);
    if (around.is_line()) {
      draft_.sparse[place] = 1;
      any_line_ = true;
    } else {
      draft_.normal[place] = around.normal(draft_, place).cast<float>();
    }
  }

  Draft& draft_;
  bool wide_;
  bool any_line_ = false;
  std::size_t count_ = 0;
  std::array<std::uint32_t, 4> place_{};
  std::array<const std::uint32_t*, 4> near_{};
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

}  // namespace

void find_near(Draft& draft, const std::vector<std::uint8_t>& doubled) {
  draft.near.resize(draft.size());
  draft.normal.resize(draft.size());
  parallel_chunks(draft.size(), kPointsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      draft.normal[i] = Vec3f::Zero();
      if (doubled[i] != 0) draft.near[i].fill(static_cast<std::uint32_t>(i));  // nobody looks for them
    }
  });
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
  const auto see = [&](std::uint32_t i, const Nearby& nearby, BlockPlanes& planes) {
    keep(i, nearby);
    if (nearby.size == 0) return;
    const float scale_sq = nearby.square[std::min(kScaleRank, nearby.size - 1)];
    draft.point[i].weight = kTieShare * scale_sq * tie_weight(draft.point[i], scale);
    for (std::size_t k = 0; k < nearby.size && nearby.square[k] <= kWeldShare * kWeldShare * scale_sq; ++k)
      if (nearby.place[k] < i) draft.welded[i] = 1;
    planes.add(i);
  };
  const bool wide = wide_lanes();
  places.run(kNear, wanted, draft.threads, [&](std::uint32_t first, unsigned bits, const auto& found) {
    BlockPlanes planes(draft, wide);
    for (; bits != 0; bits &= bits - 1) {
      const auto k = static_cast<std::uint32_t>(std::countr_zero(bits));
      see(first + k, found[k], planes);
    }
    planes.finish();
    if (planes.any_line()) any_line.store(true, std::memory_order_relaxed);
  });
  if (!any_line.load()) return;
  places.run(kWideNear, draft.sparse, draft.threads,
             [&](std::uint32_t first, unsigned bits, const auto& found) {
               for (; bits != 0; bits &= bits - 1) {
                 const auto k = static_cast<std::uint32_t>(std::countr_zero(bits));
                 const std::uint32_t i = first + k;
                 keep_directions(draft, i, {found[k].place.data(), found[k].size}, draft.near[i]);
                 draft.normal[i] = Surroundings(draft, i).normal(draft, i).cast<float>();
               }
             });
}

void near_of_stars(Draft& draft) {
  const std::uint32_t scale = scale_bits(draft.point);
  parallel_chunks(draft.size(), kSeenPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
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

double share_across(const Draft& draft, std::uint32_t point) {
  return share_along(Surroundings(draft, point).covariance.back(), draft.normal[point].cast<double>());
}

}  // namespace palpate::stars
