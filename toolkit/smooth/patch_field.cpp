#include "toolkit/smooth/patch_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace palpate::render {
namespace {

/// A second face is looked for in so many times the area: where chance left a void beside an edge its points
/// are farther.
constexpr double kWideSq = 4.0;
/// How fast a point's say falls with its distance beyond that of the nearest one: in spacings, by the
/// difference of the squares, which is that along the surface at any height above it.
constexpr double kWidth = 1.1;
/// A weight is (1 - t / kEnd)^kEnd, as exp(-t) near 0 and nothing from t = kEnd on.
constexpr double kEnd = 4.0;
/// Patches that differ by more than these, of the width and of a unit normal, from what most say have little
/// say: other faces at an edge.
constexpr double kOtherDistance = 0.35, kOtherNormal = 0.6;
constexpr int kRobustRounds = 3;
/// Patches that say the same to so many widths and 8 degrees need no vote.
constexpr double kAlike = 0.05, kAlikeCosine = 0.99;
/// A patch is of a face that leaves it this share of its say; a second face counts from this share of all on.
constexpr double kOfFace = 0.3;
constexpr double kSecondFace = 0.15;
/// Patches that face so far away from the one that counts most are of no face with it, only beside it: the
/// far side of a plate, or of a groove.
constexpr double kOtherSheet = -0.2;
/// The foot of a quadric's normal is found in so many Newton steps: off a patch by its own radius of
/// curvature at most, the third mends less than a thousandth.
constexpr int kFootSteps = 3;
/// A foot is found that is this share of the distances off, squared: the distance is then right to its
/// square.
constexpr double kFootError = 1e-8;
/// Beyond the centre of curvature there is no nearest place: steps are halved below this determinant.
constexpr double kLeastDeterminant = 0.1;
/// Points that crowd in one place have no spacing of their own: of the cloud's this share is taken.
constexpr double kLeastSpacing = 1e-3;
/// Far from everything, and its square still a number.
constexpr float kNowhere = 1e18f;
/// A foot that is so many times as far off as the place itself, squared, is none.
constexpr double kFarthestFoot = 16.0;
/// The first look for a nearest point, in spacings, and how much wider each next is.
constexpr double kFirstLook = 2.0, kWider = 1.6;

[[nodiscard]] double falling(double t) noexcept {
  const double rest = std::max(1.0 - t / kEnd, 0.0), sq = rest * rest;
  return sq * sq;
}

}  // namespace

FieldValue distance_to(const Quadric& q, const Vec3& place) noexcept {
  const Vec3 d = place - q.at;
  const double a = d.dot(q.u), b = d.dot(q.v), h = d.dot(q.n);
  double u = a, v = b;
  for (int i = 0; i < kFootSteps; ++i) {
    const double off = h - (q.uu * u * u + q.uv * u * v + q.vv * v * v);
    const double gu = 2.0 * q.uu * u + q.uv * v, gv = 2.0 * q.vv * v + q.uv * u;
    const double ru = a - u + off * gu, rv = b - v + off * gv;
    if (ru * ru + rv * rv < kFootError * (a * a + b * b + h * h)) break;
    const double uu = 1.0 + gu * gu - 2.0 * off * q.uu, uv = gu * gv - off * q.uv,
                 vv = 1.0 + gv * gv - 2.0 * off * q.vv;
    const double determinant = uu * vv - uv * uv;
    if (determinant > kLeastDeterminant) {
      u += (vv * ru - uv * rv) / determinant;
      v += (uu * rv - uv * ru) / determinant;
    } else {
      u += 0.5 * ru;
      v += 0.5 * rv;
    }
  }
  // Beyond the centre of curvature there may be no foot: the tangent plane tells the side.
  if (!(u * u + v * v < kFarthestFoot * (a * a + b * b + h * h))) return {h, q.n};
  const double gu = 2.0 * q.uu * u + q.uv * v, gv = 2.0 * q.vv * v + q.uv * u;
  const double per = 1.0 / std::sqrt(1.0 + gu * gu + gv * gv);
  const double off = h - (q.uu * u * u + q.uv * u * v + q.vv * v * v);
  return {(off - gu * (a - u) - gv * (b - v)) * per, (q.n - gu * q.u - gv * q.v) * per};
}

void PatchField::add(std::uint32_t point) {
  const PointPatches& mine = of_[point];
  if (!(mine.share[0] > 0.0f)) return;
  Near near{};
  for (std::size_t k = 0; k < kPatchesOfPoint && mine.patch[k] != PointPatches::kNone; ++k) {
    std::uint32_t& slot = slot_[mine.patch[k]];
    if (slot == kNone) {
      slot = static_cast<std::uint32_t>(used_.size());
      used_.push_back(mine.patch[k]);
    }
    near.slot[k] = slot;
    near.share[k] = mine.share[k];
  }
  const Vec3 d = points_[point] - middle_;
  const std::size_t lane = near_.size() % kAtOnce;
  // Lanes that no point fills are as far as none is.
  if (lane == 0) {
    Places& next = places_.emplace_back();
    next.x = next.y = next.z = Lanes{} + kNowhere;
  }
  places_.back().x[lane] = static_cast<float>(d.x());
  places_.back().y[lane] = static_cast<float>(d.y());
  places_.back().z[lane] = static_cast<float>(d.z());
  near_.push_back(near);
}

bool PatchField::begin(const Vec3& middle, double reach_mm, double most_mm) {
  middle_ = middle;
  for (const std::uint32_t p : used_) slot_[p] = kNone;
  used_.clear();
  near_.clear();
  places_.clear();
  // The nearest point that follows any patch.
  double nearest = std::numeric_limits<double>::infinity();
  for (double look = reach_mm + kFirstLook * points_.spacing_mm();; look *= kWider) {
    const double radius = std::min(look, most_mm);
    points_.in_ball(middle, radius, [&](std::uint32_t i, const Vec3&, double sq) {
      if (sq >= nearest || of_[i].patch[0] == PointPatches::kNone) return;
      nearest = sq;
      width_ = kWidth * std::max(points_.spacing_near(i), kLeastSpacing * points_.spacing_mm());
    });
    if (nearest < std::numeric_limits<double>::infinity()) break;
    if (look >= most_mm) return false;
  }
  // The nearest point of any place asked about is that near, and those that have a say beside it.
  const double farthest = std::sqrt(nearest) + reach_mm;
  const double radius = reach_mm + std::sqrt(farthest * farthest + kEnd * kWideSq * width_ * width_);
  points_.in_ball(middle, radius, [&](std::uint32_t i, const Vec3&, double) { add(i); });
  sq_.resize(places_.size());
  said_.clear();
  if (near_.empty()) return false;
  weight_.assign(used_.size(), 0.0);
  wide_.assign(used_.size(), 0.0);
  face_.assign(used_.size(), 0);
  return true;
}

FieldValue PatchField::at(const Vec3& at) {
  const Lanes ax = Lanes{} + static_cast<float>(at.x()), ay = Lanes{} + static_cast<float>(at.y()),
              az = Lanes{} + static_cast<float>(at.z());
  Lanes lanes_least = Lanes{} + std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const Lanes dx = places_[i].x - ax, dy = places_[i].y - ay, dz = places_[i].z - az;
    const Lanes sq = dx * dx + dy * dy + dz * dz;
    sq_[i] = sq;
    lanes_least = sq < lanes_least ? sq : lanes_least;
  }
  float least = lanes_least[0];
  for (std::size_t k = 1; k < kAtOnce; ++k) least = std::min(least, lanes_least[k]);
  const auto per_sq = static_cast<float>(1.0 / (width_ * width_)),
             end = least + static_cast<float>(kEnd * kWideSq * width_ * width_);
  telling_.clear();
  for (std::size_t i = 0; i < sq_.size(); ++i) {
    const auto within = sq_[i] <= Lanes{} + end;
    if ((within[0] | within[1] | within[2] | within[3]) == 0) continue;
    for (std::size_t k = 0; k < kAtOnce; ++k) {
      if (within[k] == 0) continue;
      const std::size_t point = i * kAtOnce + k;
      const auto off = static_cast<double>((sq_[i][k] - least) * per_sq);
      const double weight = falling(off), wide = falling(off / kWideSq);
      telling_.push_back({static_cast<std::uint32_t>(point), wide});
      const Near& near = near_[point];
      for (std::size_t j = 0; j < kPatchesOfPoint && near.share[j] > 0.0f; ++j) {
        weight_[near.slot[j]] += weight * static_cast<double>(near.share[j]);
        wide_[near.slot[j]] += wide * static_cast<double>(near.share[j]);
      }
    }
  }
  const Vec3 place = middle_ + at;
  for (const Said& s : said_) face_[s.slot] = 0;
  said_.clear();
  std::size_t top = 0;
  for (std::uint32_t s = 0; s < used_.size(); ++s) {
    if (!(wide_[s] > 0.0)) continue;
    const FieldValue value = distance_to(patches_[used_[s]].quadric, place);
    if (said_.empty() || weight_[s] > said_[top].weight) top = said_.size();
    said_.push_back({s, 0, weight_[s], wide_[s], value.distance_mm, value.normal});
    weight_[s] = wide_[s] = 0.0;
  }
  // Squares of lengths that single precision has no number for: nothing is near.
  if (said_.empty()) return {static_cast<double>(kNowhere), Vec3(Vec3::UnitZ())};
  // Another sheet's patches have no say in the face.
  const Said first = said_[top];
  double all = 0.0, all_wide = 0.0;
  bool alike = true;
  for (Said& s : said_) {
    const double cosine = s.normal.dot(first.normal);
    if (cosine < kOtherSheet) s.weight = 0.0;
    all += s.weight;
    all_wide += s.wide;
    alike = alike && cosine > kAlikeCosine && std::abs(s.distance - first.distance) < kAlike * width_;
  }
  if (alike) return mean_of_all(all);
  const FieldValue face = agree(1);
  const Said* other = nullptr;
  for (const Said& s : said_)
    if (s.face == 0 && (other == nullptr || s.wide > other->wide)) other = &s;
  if (other == nullptr || !(other->wide > kSecondFace * all_wide)) return face;
  for (Said& s : said_) s.weight = s.wide;
  const FieldValue beside = agree(2);
  // Over an edge the points of each face lie below the other, in a corner above it.
  double above = 0.0;
  for (const Telling& t : telling_) {
    const int own = face_[near_[t.point].slot[0]];
    if (own == 0) continue;
    const Places& from = places_[t.point / kAtOnce];
    const std::size_t lane = t.point % kAtOnce;
    const Vec3 to = Vec3(static_cast<double>(from.x[lane]), static_cast<double>(from.y[lane]),
                         static_cast<double>(from.z[lane])) -
                    at;
    const FieldValue& other_face = own == 1 ? beside : face;
    above += t.weight * (other_face.distance_mm + other_face.normal.dot(to));
  }
  return (beside.distance_mm > face.distance_mm) == (above < 0.0) ? beside : face;
}

FieldValue PatchField::mean_of_all(double weights) const {
  double mean = 0.0;
  Vec3 normal = Vec3::Zero();
  for (const Said& s : said_) {
    mean += s.weight * s.distance;
    normal += s.weight * s.normal;
  }
  return {mean / weights, normal.normalized()};
}

/// What most of those say that are of no face yet; they are of `face` from now on.
FieldValue PatchField::agree(int face) {
  FieldValue out;
  double sum = 0.0, mean = 0.0;
  Vec3 normal = Vec3::Zero();
  const Said* top = nullptr;
  for (const Said& s : said_) {
    if (s.face != 0) continue;
    if (top == nullptr || s.weight > top->weight) top = &s;
    sum += s.weight;
    mean += s.weight * s.distance;
    normal += s.weight * s.normal;
  }
  out = face == 1 ? FieldValue{mean / sum, normal.normalized()} : FieldValue{top->distance, top->normal};
  const double per_distance = 1.0 / (kOtherDistance * width_);
  const auto share_of = [&](const Said& s) {
    const double off = (s.distance - out.distance_mm) * per_distance;
    return falling(off * off) *
           falling((s.normal - out.normal).squaredNorm() / (kOtherNormal * kOtherNormal));
  };
  for (int round = 0; round < kRobustRounds; ++round) {
    sum = mean = 0.0;
    normal = Vec3::Zero();
    for (const Said& s : said_) {
      if (s.face != 0) continue;
      const double weight = s.weight * share_of(s);
      sum += weight;
      mean += weight * s.distance;
      normal += weight * s.normal;
    }
    if (!(sum > 0.0)) break;  // none agrees with the mean: it stands
    out = {mean / sum, normal.normalized()};
  }
  for (Said& s : said_)
    if (s.face == 0 && share_of(s) > kOfFace) face_[s.slot] = static_cast<std::uint8_t>(s.face = face);
  return out;
}

}  // namespace palpate::render
