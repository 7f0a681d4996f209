#include "toolkit/spline_sdf/patch_field.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toolkit/core/simd.h"

namespace palpate::spline_sdf {
namespace {

/// Area factor for finding a second face: its points are farther where chance left a void at an edge.
constexpr float kWideSq = 4.0f;
/// Fall-off of a point's weight in spacings, by squared distance minus that of the nearest: the tangential
/// distance, at any height.
constexpr double kWidth = 1.1;
/// The weight (1 - t / kEnd)^kEnd approximates exp(-t) and ends at t = kEnd.
constexpr float kEnd = 4.0f;
/// Patches that differ from the weighted mean by more than these (in widths, and of unit normals) lose
/// weight: other faces at an edge.
constexpr float kOtherDistance = 0.35f, kOtherNormal = 0.6f;
constexpr int kRobustRounds = 3;
/// Patches that agree within this many widths and 8 degrees need no vote.
constexpr float kAlike = 0.05f, kAlikeCosine = 0.99f;
/// A patch belongs to a face that leaves it this share of its weight; a second face counts from this share of
/// the total.
constexpr float kOfFace = 0.3f, kSecondFace = 0.15f;
/// Patches facing this far away from the strongest one are another sheet, such as a plate's far side or a
/// groove's.
constexpr float kOtherSheet = -0.2f;
/// Newton steps to the closest point on a quadric. Within the radius of curvature the third corrects less
/// than a thousandth.
constexpr int kClosestSteps = 3;
/// Steps are no longer than at this determinant: beyond the centre of curvature no nearest place exists.
constexpr float kMinDeterminant = 0.1f;
/// Least spacing of coincident points, as a share of the cloud's.
constexpr double kMinSpacing = 1e-3;
/// A closest point farther than this many times the place's distance, squared, is invalid.
constexpr float kMaxClosestDistanceSq = 16.0f;
/// First search radius for a nearest point, in spacings, and its growth.
constexpr double kFirstSearch = 2.0, kWider = 1.6;

using Near = PatchDistanceField::Near;

/// A mean of patches; `normal` is of unit length.
struct alignas(kLanesAlignment) FieldMean {
  NodeLanes distance{};
  NodePlaces normal;
};

/// Sums of weights and of weighted patches.
struct alignas(kLanesAlignment) FieldSums {
  NodeLanes weight{}, distance{};
  NodePlaces normal;
  [[gnu::always_inline]] inline void add(const Near::Patch& p, const NodeLanes& w) noexcept {
    weight += w;
    distance += w * p.distance;
    normal.x += w * p.normal.x, normal.y += w * p.normal.y, normal.z += w * p.normal.z;
  }
  /// Replaces the mean where anything was added.
  [[gnu::always_inline]] inline void put_mean(FieldMean& out) const noexcept {
    const NodeLanes none{};
    const auto known = weight > none;
    const NodeLanes per = 1.0f / (known ? weight : none + 1.0f);
    NodeLanes per_length = normal.x * normal.x + normal.y * normal.y + normal.z * normal.z;
    one_over_root(per_length);
    out.distance = known ? distance * per : out.distance;
    out.normal.x = known ? normal.x * per_length : out.normal.x;
    out.normal.y = known ? normal.y * per_length : out.normal.y;
    out.normal.z = known ? normal.z * per_length : out.normal.z;
  }
};

[[gnu::always_inline]] inline void fall_off(NodeLanes& t) noexcept {
  const NodeLanes none{}, left = 1.0f - t * (1.0f / kEnd);
  const NodeLanes rest = left > none ? left : none, sq = rest * rest;
  t = sq * sq;
}

/// The share of its weight that a patch keeps beside a mean.
[[gnu::always_inline]] inline void share_beside(const Near::Patch& p, const FieldMean& mean,
                                                NodeLanes& share) noexcept {
  const NodeLanes off = (p.distance - mean.distance) * (1.0f / kOtherDistance);
  const NodeLanes dx = p.normal.x - mean.normal.x, dy = p.normal.y - mean.normal.y,
                  dz = p.normal.z - mean.normal.z;
  NodeLanes by_distance = off * off,
            by_normal = (dx * dx + dy * dy + dz * dz) * (1.0f / (kOtherNormal * kOtherNormal));
  fall_off(by_distance);
  fall_off(by_normal);
  share = by_distance * by_normal;
}

/// The weights of near points, and through them of patches, by distance.
[[gnu::always_inline]] inline void weigh(const NodePlaces& at, Near& near) noexcept {
  const NodeLanes none{};
  NodeLanes least = none + std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < near.points.size(); ++i) {
    const Near::Point& p = near.points[i];
    const NodeLanes dx = p.x - at.x, dy = p.y - at.y, dz = p.z - at.z;
    const NodeLanes sq = dx * dx + dy * dy + dz * dz;
    near.distances[i].sq = sq;
    least = sq < least ? sq : least;
  }
  const NodeLanes end = least + kEnd * kWideSq;
  near.contributors = 0;
  for (std::size_t i = 0; i < near.points.size(); ++i) {
    if (!any_lane(near.distances[i].sq <= end)) continue;
    const Near::Point& p = near.points[i];
    NodeLanes weight = near.distances[i].sq - least, wide = weight * (1.0f / kWideSq);
    fall_off(weight);
    fall_off(wide);
    near.contributions[near.contributors++] = {wide, static_cast<std::uint32_t>(i)};
    for (std::size_t j = 0; j < kPatchesOfPoint && p.share[j] > 0.0f; ++j) {
      Near::Patch& patch = near.patches[p.slot[j]];
      patch.weight += weight * p.share[j];
      patch.wide += wide * p.share[j];
    }
  }
}

/// The distances of the patches that have weight.
[[gnu::always_inline]] inline void measure_patches(const NodePlaces& at, Near& near) noexcept {
  const NodeLanes none{};
  near.heard.clear();
  for (std::uint32_t s = 0; s < near.patches.size(); ++s) {
    Near::Patch& p = near.patches[s];
    if (!any_lane(p.wide > none)) continue;
    near.heard.push_back(s);
    const QuadricLanes& q = near.quadrics[s];
    QuadricClosest closest;
    find_closest(q, at, kClosestSteps, kMinDeterminant, closest);
    // Without a closest point the tangent plane gives the side.
    const auto has_closest =
        closest.u * closest.u + closest.v * closest.v <
        kMaxClosestDistanceSq * (closest.a * closest.a + closest.b * closest.b + closest.h * closest.h);
    const NodeLanes gu = has_closest ? closest.gu : none, gv = has_closest ? closest.gv : none;
    const NodeLanes per = has_closest ? closest.per_slope : none + 1.0f;
    p.distance = has_closest ? closest.distance : closest.h;
    p.normal.x = (q.nx - gu * q.ux - gv * q.vx) * per;
    p.normal.y = (q.ny - gu * q.uy - gv * q.vy) * per;
    p.normal.z = (q.nz - gu * q.uz - gv * q.vz) * per;
    p.face = NodeBits{};
  }
}

/// The consensus of patches without a face, from the mean given; assigns them to `face`.
[[gnu::always_inline]] inline void agree(Near& near, int face, FieldMean& mean) noexcept {
  const NodeLanes none{};
  NodeLanes share;
  // A round without agreement keeps the mean.
  for (int round = 0; round < kRobustRounds; ++round) {
    FieldSums sums;
    for (const std::uint32_t s : near.heard) {
      const Near::Patch& p = near.patches[s];
      share_beside(p, mean, share);
      sums.add(p, p.face == 0 ? (face == 1 ? p.weight : p.wide) * share : none);
    }
    sums.put_mean(mean);
  }
  for (const std::uint32_t s : near.heard) {
    Near::Patch& p = near.patches[s];
    share_beside(p, mean, share);
    p.face = ((p.face == 0) & (share > none + kOfFace)) ? NodeBits{} + face : p.face;
  }
}

/// Positive where each face's points lie above the other, as in a corner; negative across an edge.
[[gnu::always_inline]] inline void points_above(const NodePlaces& at, const Near& near,
                                                const FieldMean& first, const FieldMean& second,
                                                NodeLanes& above) noexcept {
  const NodeLanes none{};
  above = none;
  for (std::size_t i = 0; i < near.contributors; ++i) {
    const Near::Contribution& c = near.contributions[i];
    const Near::Point& p = near.points[c.point];
    const NodeBits& own = near.patches[p.slot[0]].face;
    const NodeLanes dx = p.x - at.x, dy = p.y - at.y, dz = p.z - at.z;
    const NodeLanes off_first =
        first.distance + first.normal.x * dx + first.normal.y * dy + first.normal.z * dz;
    const NodeLanes off_second =
        second.distance + second.normal.x * dx + second.normal.y * dy + second.normal.z * dz;
    above += own == 0 ? none : c.weight * (own == 1 ? off_second : off_first);
  }
}

[[gnu::always_inline]] inline void blend(FieldMean& mean, const FieldMean& other,
                                         const NodeBits& take) noexcept {
  mean.distance = take ? other.distance : mean.distance;
  mean.normal.x = take ? other.normal.x : mean.normal.x;
  mean.normal.y = take ? other.normal.y : mean.normal.y;
  mean.normal.z = take ? other.normal.z : mean.normal.z;
}

/// Takes a patch where its weight is the largest so far.
[[gnu::always_inline]] inline void keep_largest(const Near::Patch& p, const NodeLanes& weight,
                                                NodeLanes& most, FieldMean& out) noexcept {
  const auto more = weight > most;
  most = more ? weight : most;
  out.distance = more ? p.distance : out.distance;
  out.normal.x = more ? p.normal.x : out.normal.x;
  out.normal.y = more ? p.normal.y : out.normal.y;
  out.normal.z = more ? p.normal.z : out.normal.z;
}

[[gnu::always_inline]] inline void field_at(const NodePlaces& at, Near& near, FieldMean& out) noexcept {
  const NodeLanes none{};
  weigh(at, near);
  measure_patches(at, near);
  NodeLanes most = none;
  FieldMean top;
  for (const std::uint32_t s : near.heard) keep_largest(near.patches[s], near.patches[s].weight, most, top);
  // Patches of another sheet do not affect the face.
  NodeLanes all_wide = none;
  NodeBits differ{};
  FieldSums sums;
  for (const std::uint32_t s : near.heard) {
    Near::Patch& p = near.patches[s];
    const NodeLanes cosine =
        p.normal.x * top.normal.x + p.normal.y * top.normal.y + p.normal.z * top.normal.z;
    p.weight = cosine < none + kOtherSheet ? none : p.weight;
    sums.add(p, p.weight);
    all_wide += p.wide;
    const NodeLanes off = p.distance - top.distance;
    differ |= (p.wide > none) & ((cosine <= none + kAlikeCosine) | (off * off >= none + kAlike * kAlike));
  }
  sums.put_mean(out);
  if (any_lane(differ)) {
    FieldMean first = out;
    agree(near, 1, first);
    blend(out, first, differ);
    FieldMean beside = first;
    most = none;
    for (const std::uint32_t s : near.heard) {
      const Near::Patch& p = near.patches[s];
      keep_largest(p, p.face == 0 ? p.wide : none, most, beside);
    }
    if (any_lane(differ & (most > none))) {
      agree(near, 2, beside);
      NodeLanes second = none, above;
      for (const std::uint32_t s : near.heard)
        second += near.patches[s].face == 2 ? near.patches[s].wide : none;
      const NodeBits counts = differ & (second > kSecondFace * all_wide);
      if (any_lane(counts)) {
        points_above(at, near, first, beside, above);
        blend(out, beside, counts & ((beside.distance > first.distance) == (above < none)));
      }
    }
  }
  for (const std::uint32_t s : near.heard) near.patches[s].weight = near.patches[s].wide = none;
}
void field_at_narrow(const NodePlaces& at, Near& near, FieldMean& out) noexcept {
  field_at(at, near, out);
}
#if defined(__x86_64__)
PALPATE_AVX2 void field_at_wide(const NodePlaces& at, Near& near, FieldMean& out) noexcept {
  field_at(at, near, out);
}
#else
constexpr auto field_at_wide = &field_at_narrow;
#endif

}  // namespace

void PatchDistanceField::add(std::uint32_t point) {
  const PointPatches& mine = of_[point];
  if (!(mine.share[0] > 0.0f)) return;
  const Vec3 d = (points_[point] - middle_) / near_.width_mm;
  Near::Point p{static_cast<float>(d.x()), static_cast<float>(d.y()), static_cast<float>(d.z()), {}, {}};
  for (std::size_t k = 0; k < kPatchesOfPoint && mine.patch[k] != PointPatches::kNone; ++k) {
    std::uint32_t& slot = slot_[mine.patch[k]];
    if (slot == kNone) {
      slot = static_cast<std::uint32_t>(used_.size());
      used_.push_back(mine.patch[k]);
      near_.quadrics.emplace_back(patches_[mine.patch[k]].quadric, middle_, near_.width_mm);
    }
    p.slot[k] = slot;
    p.share[k] = mine.share[k];
  }
  near_.points.push_back(p);
}

bool PatchDistanceField::begin(const Vec3& middle, double reach_mm, double most_mm) {
  middle_ = middle;
  for (const std::uint32_t p : used_) slot_[p] = kNone;
  used_.clear();
  near_.points.clear();
  near_.quadrics.clear();
  double& width = near_.width_mm;
  // The nearest point that follows any patch.
  double nearest = std::numeric_limits<double>::infinity();
  for (double look = reach_mm + kFirstSearch * points_.spacing_mm();; look *= kWider) {
    const double radius = std::min(look, most_mm);
    points_.in_ball(middle, radius, [&](std::uint32_t i, const Vec3&, double sq) {
      if (sq >= nearest || of_[i].patch[0] == PointPatches::kNone) return;
      nearest = sq;
      width = kWidth * std::max(points_.spacing_near(i), kMinSpacing * points_.spacing_mm());
    });
    if (nearest < std::numeric_limits<double>::infinity()) break;
    if (look >= most_mm) return false;
  }
  // Bounds the nearest point of any queried place, and its contributors.
  const double farthest = std::sqrt(nearest) + reach_mm;
  const double radius =
      reach_mm + std::sqrt(farthest * farthest + static_cast<double>(kEnd * kWideSq) * width * width);
  points_.in_ball(middle, radius, [&](std::uint32_t i, const Vec3&, double) { add(i); });
  near_.distances.resize(near_.points.size());
  near_.contributions.resize(std::max(near_.contributions.size(), near_.points.size()));
  near_.patches.assign(used_.size(), {});
  return !near_.points.empty();
}

void PatchDistanceField::evaluate(const NodePlaces& at_mm, FieldLanes& out) {
  const auto width = static_cast<float>(near_.width_mm), per = static_cast<float>(1.0 / near_.width_mm);
  FieldMean mean;
  (has_avx2() ? &field_at_wide : &field_at_narrow)({at_mm.x * per, at_mm.y * per, at_mm.z * per}, near_,
                                                   mean);
  out.distance_mm = mean.distance * width;
  out.normal = mean.normal;
}

}  // namespace palpate::spline_sdf
