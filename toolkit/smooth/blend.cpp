#include "toolkit/smooth/blend.h"

#include <algorithm>
#include <cmath>

namespace palpate::render {
namespace {

constexpr float kLeastWeight = 1e-6f;
constexpr float kRowReach = 3.0f;
constexpr int kFillRounds = 2 * kBrickNodes;
/// What a cubic B-spline takes of a second difference along an axis.
constexpr float kBlur = 1.0f / 6.0f;

RowPatch in_brick(const Patch& p, const Vec3& middle, double per_voxel) {
  const Quadric& q = p.quadric;
  const double voxel = 1.0 / per_voxel;
  const auto floats = [](const Vec3& x) {
    return std::array<float, 3>{static_cast<float>(x.x()), static_cast<float>(x.y()),
                                static_cast<float>(x.z())};
  };
  RowPatch out;
  out.at = floats((q.at - middle) * per_voxel);
  out.u = floats(q.u);
  out.v = floats(q.v);
  out.n = floats(q.n);
  out.uu = static_cast<float>(q.uu * voxel);
  out.uv = static_cast<float>(q.uv * voxel);
  out.vv = static_cast<float>(q.vv * voxel);
  out.trust = static_cast<float>(p.trust);
  out.support = static_cast<float>(p.support * per_voxel);
  out.per_support_sq = 1.0f / (out.support * out.support);
  // A cubic B-spline blurs by a sixth of the second difference along each axis: what it takes is added
  // beforehand. The distance's Laplacian is minus twice the sum of the height's curvatures.
  out.sharpen = (out.uu + out.vv) / 3.0f;
  const float mean = out.uu + out.vv, half = std::hypot(out.uu - out.vv, out.uv);
  const float most = mean + half, least = mean - half;  // the principal curvatures
  out.bend = std::abs(most) > std::abs(least) ? most : least;
  out.row_share = std::sqrt(std::max(1.0f - out.n[2] * out.n[2], 0.0f)) * kRowReach;
  return out;
}

}  // namespace

void NodeBlend::clear() {
  sums_ = RowSums{};
  faces_ = ridges_ = 0;
}

void NodeBlend::add(const Patch& patch, const Vec3& middle, double per_voxel) {
  RowPatch row = in_brick(patch, middle, per_voxel);
  if (without_.sharpening) row.sharpen = 0.0f;
  if (without_.blend)
    take_most(row);
  else
    add_to_rows(row, sums_);
}

void NodeBlend::take_most(const RowPatch& patch) {
  RowSums one{};
  add_to_rows(patch, one);
  for (std::size_t i = 0; i < one.weight.size(); ++i) {
    if (!(one.weight[i] > sums_.weight[i])) continue;
    sums_.weight[i] = one.weight[i];
    sums_.distance[i] = one.distance[i];
    sums_.x[i] = one.x[i];
    sums_.y[i] = one.y[i];
    sums_.z[i] = one.z[i];
  }
}

void NodeBlend::read_sums(Values& to) const {
  for (std::size_t i = 0; i < kBrickCoefficients; ++i) {
    const std::size_t from = kRowLanes * (i / kBrickNodes) + i % kBrickNodes;
    const float weight = sums_.weight[from];
    to.known[i] = weight > kLeastWeight;
    const float per = to.known[i] != 0 ? 1.0f / weight : 0.0f;
    to.distance[i] = sums_.distance[from] * per;
    to.x[i] = sums_.x[from] * per;
    to.y[i] = sums_.y[from] * per;
    to.z[i] = sums_.z[from] * per;
  }
}

/// What the spline makes of the kink of two faces at a node, each gone on from there along its gradient.
float NodeBlend::blurred_crease(const Values& a, const Values& b, std::size_t i, bool greater) const {
  if (without_.sharpening) return 0.0f;
  const auto joined = [&](float x, float y) { return (x > y) == greater ? x : y; };
  const float fa = a.distance[i], fb = b.distance[i], here = joined(fa, fb);
  const auto along = [&](float ga, float gb) {
    return joined(fa + ga, fb + gb) + joined(fa - ga, fb - gb) - 2.0f * here;
  };
  return kBlur * (along(a.x[i], b.x[i]) + along(a.y[i], b.y[i]) + along(a.z[i], b.z[i]));
}

void NodeBlend::join(Values& with, const Values& other, bool greater) const {
  for (std::size_t i = 0; i < kBrickCoefficients; ++i) {
    if (other.known[i] == 0) continue;
    const bool both = with.known[i] != 0;
    const float blurred = both ? blurred_crease(with, other, i, greater) : 0.0f;
    if (!both || (other.distance[i] > with.distance[i]) == greater) {
      with.known[i] = 1;
      with.distance[i] = other.distance[i];
      with.x[i] = other.x[i];
      with.y[i] = other.y[i];
      with.z[i] = other.z[i];
    }
    with.distance[i] -= blurred;
  }
}

void NodeBlend::end_face() {
  read_sums(faces_ == 0 ? ridge_ : face_);
  if (faces_ > 0) join(ridge_, face_, true);
  ++faces_;
  sums_ = RowSums{};
}

void NodeBlend::end_ridge() {
  if (ridges_ == 0)
    values_ = ridge_;
  else
    join(values_, ridge_, false);
  ++ridges_;
  faces_ = 0;
}

/// Nodes that no patch reaches go on from the nodes beside them, along their gradients.
void NodeBlend::fill() {
  constexpr std::array<int, 3> kStep{kBrickNodes * kBrickNodes, kBrickNodes, 1};
  Values& v = values_;
  auto missing = std::count(v.known.begin(), v.known.end(), std::uint8_t{0});
  for (int round = 0; round < kFillRounds && missing > 0; ++round) {
    std::array<std::uint8_t, kBrickCoefficients> now = v.known;
    for (int i = 0; i < kBrickCoefficients; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (v.known[k] != 0) continue;
      float count = 0.0f, f = 0.0f;
      Eigen::Vector3f g = Eigen::Vector3f::Zero();
      for (int axis = 0; axis < 3; ++axis) {
        const int at = i / kStep[static_cast<std::size_t>(axis)] % kBrickNodes;
        for (int side = -1; side <= 1; side += 2) {
          if (at + side < 0 || at + side >= kBrickNodes) continue;
          const int beside = i + side * kStep[static_cast<std::size_t>(axis)];
          const auto j = static_cast<std::size_t>(beside);
          if (v.known[j] == 0) continue;
          const Eigen::Vector3f gj(v.x[j], v.y[j], v.z[j]);
          f += v.distance[j] - static_cast<float>(side) * gj[axis];
          g += gj;
          count += 1.0f;
        }
      }
      if (count == 0.0f) continue;
      v.distance[k] = f / count;
      v.x[k] = g.x() / count;
      v.y[k] = g.y() / count;
      v.z[k] = g.z() / count;
      now[k] = 1;
      --missing;
    }
    v.known = now;
  }
}

const std::array<float, kBrickCoefficients>& NodeBlend::finish() {
  fill();
  return values_.distance;
}

}  // namespace palpate::render
