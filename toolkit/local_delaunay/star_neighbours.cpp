#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>

#include "toolkit/core/hardware.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"

#include "toolkit/core/simd.h"
#include "toolkit/local_delaunay/avx2_kernels.h"
#include "toolkit/local_delaunay/block_knn.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"
#include "toolkit/surface/smallest_eigenvector.h"

namespace palpate::local_delaunay {
namespace {

/// Points closer than this share of the distance to the fourth neighbour are merged: facets between them
/// would have noise as direction.
constexpr float kWeldShare = 0.02F;
constexpr std::size_t kScaleRank = 3;  ///< the fourth neighbour
/// Four lattice points lie on one circle, and each sees them slightly differently. Random weights, the same
/// for all viewers and up to this share of the squared spacing, settle the diagonal.
constexpr float kTieShare = 0.01F;
/// Numbers of points for plane fits; the nearest twelve first.
constexpr std::array<std::size_t, 3> kPlaneSizes = {6, 8, kPlaneNear};
/// Below this share of variance across it, a fit is a plane: noise of a quarter of the spacing gives 0.03, a
/// 90-degree crease 0.08, a second sheet one spacing off 0.2.
constexpr double kPlaneShare = 0.1;
/// Points per chunk at about a microsecond each.
constexpr std::size_t kSeenPerChunk = 4096;

/// A power of two that scales with the model, as the exponent bits of a float.
std::uint32_t scale_bits(const UninitializedVector<SortedPoint>& points) noexcept {
  constexpr std::uint32_t kExponent = 0x7F800000u;
  float most = 0.0F;
  for (const SortedPoint& p : points)
    most = std::max({most, std::abs(p.x_mm), std::abs(p.y_mm), std::abs(p.z_mm)});
  return std::bit_cast<std::uint32_t>(most) & kExponent;
}

/// In [0, 1), from the point's coordinates alone, with exponents relative to the model's, so a scaled model
/// is settled alike.
float tie_weight(const SortedPoint& p, std::uint32_t scale) noexcept {
  const auto bits = [scale](float x) {
    return x == 0.0F ? std::uint64_t{0} : std::uint64_t{std::bit_cast<std::uint32_t>(x) - scale};
  };
  std::uint64_t h = bits(p.x_mm) * kGolden64;
  h = (h ^ (h >> 29) ^ bits(p.y_mm)) * kGolden64;
  h = (h ^ (h >> 31) ^ bits(p.z_mm)) * kGolden64;
  return static_cast<float>(h >> 40) * 0x1p-24F;
}

/// A scan line's nearest points may all be on it. Twelve points whose second spread is under a tenth of the
/// first (a border has a quarter) are not enough.
constexpr double kLineMinors = 0.08;  ///< L1 L2 / (L1 + L2)^2
/// In that case this many are searched, and the nearest two in each of eight directions taken.
constexpr std::size_t kRefinementNear = 128;
constexpr std::size_t kDirections = 8;
constexpr std::size_t kOfEachDirection = kNearest / kDirections;

/// Sums over offsets from a point.
struct Moments {
  Vec3 first = Vec3::Zero();
  surface::SymmetricMatrix3 second;
  std::size_t count = 0;

  void add(const Vec3& d) noexcept {
    first += d;
    second.add(d);
    ++count;
  }
  /// Covariance of the offsets and the point itself, times their number.
  [[nodiscard]] surface::SymmetricMatrix3 covariance() const noexcept {
    return second.without(first, 1.0 / static_cast<double>(count + 1));
  }
};

/// The variance along a direction as a share of all: 0 for a plane, a third for a ball.
double share_along(const surface::SymmetricMatrix3& c, const Vec3& n) noexcept {
  const double along = n.x() * (c.xx * n.x() + 2.0 * (c.xy * n.y() + c.xz * n.z())) +
                       n.y() * (c.yy * n.y() + 2.0 * c.yz * n.z()) + c.zz * n.z() * n.z();
  return along / c.trace();
}

/// True if the covariance is that of collinear points.
bool is_line(const surface::SymmetricMatrix3& c) noexcept {
  const double trace = c.trace();
  return c.adjugate().trace() < kLineMinors * trace * trace;
}

/// At crossings and folds: of the planes through the point and two of its nearest ten, the one with most of
/// the nearest points, if it has half; else `otherwise`.
Vec3 normal_of_most(const CandidateTriangulation& candidate, std::uint32_t i,
                    const Vec3& otherwise) noexcept {
  constexpr std::size_t kSpanning = 10, kEnough = 6;
  constexpr double kInPlane = 0.08;   // height over distance: 5 degrees
  constexpr double kLeastSine = 0.3;  // least sine of the angle that spans a plane
  std::array<Vec3, kNearest> at;
  const NearestPoints near = candidate.near[i];
  std::size_t size = 0;
  for (; size < kNearest && near[size] != i; ++size) at[size] = candidate.at(near[size]) - candidate.at(i);
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

/// The surface at a point according to its nearest twelve.
struct Surroundings {
  std::array<surface::SymmetricMatrix3, kPlaneSizes.size()> covariance;  ///< as kPlaneSizes

  Surroundings(const CandidateTriangulation& candidate, std::uint32_t i) noexcept {
    const Vec3 p = candidate.at(i);
    const NearestPoints near = candidate.near[i];
    Moments moments;
    std::size_t size = 0;
    for (std::size_t k = 0; k < kPlaneSizes.size(); ++k) {
      for (; size < kPlaneSizes[k] && near[size] != i; ++size) moments.add(candidate.at(near[size]) - p);
      covariance[k] = moments.covariance();
    }
  }
  [[nodiscard]] bool is_line() const noexcept { return local_delaunay::is_line(covariance.back()); }
  /// The normal from the nearest twelve; from fewer if those fit a plane better (another sheet is near).
  [[nodiscard]] Vec3 normal(const CandidateTriangulation& candidate, std::uint32_t i) const noexcept {
    Vec3 best = Vec3::Zero();
    double least = HUGE_VAL;
    for (std::size_t k = covariance.size(); k-- > 0 && !(least < kPlaneShare);) {
      Vec3 of_these;
      if (!surface::smallest_eigenvector(covariance[k], of_these)) continue;
      const double share = share_along(covariance[k], of_these);
      if (share < least) {
        least = share;
        best = of_these;
      }
    }
    return least < kPlaneShare ? best : normal_of_most(candidate, i, best);
  }
};

/// Fits planes for the places of a block, in vector lanes where possible. False: the points are collinear.
class BlockPlanes {
 public:
  BlockPlanes(CandidateTriangulation& candidate, bool wide) noexcept : candidate_(candidate), wide_(wide) {}
  ~BlockPlanes() = default;
  BlockPlanes(const BlockPlanes&) = delete;
  BlockPlanes& operator=(const BlockPlanes&) = delete;

  void add(std::uint32_t place) noexcept {
    // With fewer than twelve the entries repeat the place itself, so it is fitted alone.
    NearestPoints& row = row_[count_] = candidate_.near[place];
    if (!wide_ || row[kPlaneNear - 1] == place) {
      settle(place);
      return;
    }
    place_[count_] = place;
    near_[count_++] = row.data();
    if (count_ == place_.size()) finish();
  }
  void finish() noexcept {
    if (count_ == 0) return;
    for (std::size_t k = count_; k < place_.size(); ++k) {
      place_[k] = place_[0];
      near_[k] = near_[0];
    }
    PlaneBatch planes;
    fit_four_planes(candidate_.point.data(), place_, near_, planes);
    for (std::size_t k = 0; k < count_; ++k) {
      const bool is_plane = planes.has_normal[k] && !local_delaunay::is_line(planes.covariance[k]) &&
                            share_along(planes.covariance[k], planes.normal[k]) < kPlaneShare;
      if (is_plane)
        candidate_.normal[place_[k]] = planes.normal[k].cast<float>();
      else
        settle(place_[k]);
    }
    count_ = 0;
  }
  [[nodiscard]] bool any_line() const noexcept { return any_line_; }

 private:
  void settle(std::uint32_t place) noexcept {
    const Surroundings around(candidate_, place);
    if (around.is_line()) {
      candidate_.sparse[place] = 1;
      any_line_ = true;
    } else {
      candidate_.normal[place] = around.normal(candidate_, place).cast<float>();
    }
  }

  CandidateTriangulation& candidate_;
  bool wide_;
  bool any_line_ = false;
  std::size_t count_ = 0;
  std::array<std::uint32_t, 4> place_{};
  std::array<NearestPoints, 4> row_{};
  std::array<const std::uint32_t*, 4> near_{};
};

/// Keeps the nearest in each direction of the plane of `count` points, sorted by distance.
void keep_directions(const CandidateTriangulation& candidate, std::uint32_t self,
                     std::span<const std::uint32_t> others, NearestPoints& near) {
  const Vec3 p = candidate.at(self);
  Moments moments;
  for (const std::uint32_t other : others) moments.add(candidate.at(other) - p);
  Vec3 normal;
  if (!surface::smallest_eigenvector(moments.covariance(), normal)) return;
  const Vec3 e = normal.unitOrthogonal(), f = normal.cross(e);
  std::array<std::size_t, kDirections> taken{};
  std::size_t size = 0;
  for (const std::uint32_t other : others) {
    const Vec3 d = candidate.at(other) - p;
    const double u = e.dot(d), v = f.dot(d);
    const std::size_t direction =
        (u > 0.0 ? 1u : 0u) + (v > 0.0 ? 2u : 0u) + (std::abs(u) > std::abs(v) ? 4u : 0u);
    if (taken[direction] == kOfEachDirection) continue;
    ++taken[direction];
    near[size++] = other;
    if (size == kNearest) break;
  }
  for (; size < kNearest; ++size) near[size] = self;
}

}  // namespace

void find_nearest(CandidateTriangulation& candidate, const std::vector<std::uint8_t>& duplicate) {
  candidate.near.resize(candidate.size());
  candidate.normal.resize(candidate.size());
  parallel_each(candidate.size(), kPointsPerChunk, candidate.threads, [&](std::size_t i) {
    candidate.normal[i] = Vec3f::Zero();
    if (duplicate[i] == 0) return;
    NearestPoints none;  // nothing searches them
    none.fill(static_cast<std::uint32_t>(i));
    candidate.near.put(static_cast<std::uint32_t>(i), none);
  });
  find_nearest_of(candidate, duplicate, {});
}

void find_nearest_of(CandidateTriangulation& candidate, const std::vector<std::uint8_t>& duplicate,
                     std::span<const std::uint8_t> wanted) {
  candidate.welded = duplicate;
  candidate.sparse.assign(candidate.size(), 0);
  const BlockKnn places(candidate.point, duplicate, candidate.threads);
  const auto keep = [&candidate](std::uint32_t self, const KnnResult& nearby) {
    NearestPoints near;
    near.fill(self);
    std::copy_n(nearby.place.begin(), nearby.size, near.begin());
    candidate.near.put(self, near);
  };
  std::atomic<bool> any_line = false;
  const std::uint32_t scale = scale_bits(candidate.point);
  const auto see = [&](std::uint32_t i, const KnnResult& nearby, BlockPlanes& planes) {
    keep(i, nearby);
    if (nearby.size == 0) return;
    const float scale_sq = nearby.square[std::min(kScaleRank, nearby.size - 1)];
    candidate.point[i].weight = kTieShare * scale_sq * tie_weight(candidate.point[i], scale);
    for (std::size_t k = 0; k < nearby.size && nearby.square[k] <= kWeldShare * kWeldShare * scale_sq; ++k)
      if (nearby.place[k] < i) candidate.welded[i] = 1;
    planes.add(i);
  };
  const bool wide = has_avx2();
  places.run(kNearest, wanted, candidate.threads, [&](std::uint32_t first, unsigned bits, const auto& found) {
    BlockPlanes planes(candidate, wide);
    for (; bits != 0; bits &= bits - 1) {
      const auto k = static_cast<std::uint32_t>(std::countr_zero(bits));
      see(first + k, found[k], planes);
    }
    planes.finish();
    if (planes.any_line()) any_line.store(true, std::memory_order_relaxed);
  });
  if (!any_line.load()) return;
  places.run(kRefinementNear, candidate.sparse, candidate.threads,
             [&](std::uint32_t first, unsigned bits, const auto& found) {
               for (; bits != 0; bits &= bits - 1) {
                 const auto k = static_cast<std::uint32_t>(std::countr_zero(bits));
                 const std::uint32_t i = first + k;
                 NearestPoints near = candidate.near[i];
                 keep_directions(candidate, i, {found[k].place.data(), found[k].size}, near);
                 candidate.near.put(i, near);
                 candidate.normal[i] = Surroundings(candidate, i).normal(candidate, i).cast<float>();
               }
             });
}

void nearest_from_stars(CandidateTriangulation& candidate) {
  const std::uint32_t scale = scale_bits(candidate.point);
  parallel_each<std::uint32_t>(candidate.size(), kSeenPerChunk, candidate.threads, [&](std::uint32_t i) {
    const Star& star = candidate.star[i];
    const std::size_t size = std::min<std::size_t>(star.size, kNearest);
    std::array<std::pair<float, std::uint32_t>, kNearest> found;
    for (std::size_t j = 0; j < size; ++j) {
      const std::uint32_t other = star.ring[j];
      found[j] = {static_cast<float>((candidate.at(other) - candidate.at(i)).squaredNorm()), other};
    }
    std::sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(size));
    NearestPoints near;
    near.fill(i);
    for (std::size_t j = 0; j < size; ++j) near[j] = found[j].second;
    candidate.near.put(i, near);
    if (size == 0) return;
    const float scale_sq = found[std::min(kScaleRank, size - 1)].first;
    candidate.point[i].weight = kTieShare * scale_sq * tie_weight(candidate.point[i], scale);
  });
}

void keep_farthest(CandidateTriangulation& candidate) {
  UninitializedVector<std::uint32_t> farthest(candidate.size());
  parallel_each<std::uint32_t>(candidate.size(), kPointsPerChunk, candidate.threads,
                               [&](std::uint32_t i) { farthest[i] = farthest_of(candidate, i); });
  candidate.farthest = std::move(farthest);
  candidate.near.release();
}

double share_across(const CandidateTriangulation& candidate, std::uint32_t point) {
  return share_along(Surroundings(candidate, point).covariance.back(),
                     candidate.normal[point].cast<double>());
}

}  // namespace palpate::local_delaunay
