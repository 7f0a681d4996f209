#include "toolkit/smooth/blend.h"

#include <algorithm>
#include <cmath>

namespace palpate::render {
namespace {

/// A surface bends no tighter than where this share of its radius is left between it and the node.
constexpr float kLeastBend = 0.2f, kBendFade = 5.0f;
/// By how much curvature may move a foot along the tangent plane, in voxels, beyond where nodes count.
constexpr float kFootRoom = 1.0f;
/// Nodes nearer than half a voxel to two faces of one sheet blend both; farther off the nearer one decides.
constexpr float kNearSquare = 0.25f;
constexpr float kLeastWeight = 1e-6f;
constexpr int kFillRounds = 2 * kBrickNodes;
constexpr float kHalfRow = 3.0f;
constexpr int kLengthSteps = 3;

inline Lanes at_least(const Lanes& x, float low) {
  const Lanes least = {low, low, low, low};
  return x > least ? x : least;
}
inline Lanes at_most(const Lanes& x, float high) {
  const Lanes most = {high, high, high, high};
  return x < most ? x : most;
}
/// 1 / sqrt(1 + x) for x from 0: Newton's steps, which need no root and are rounded alike everywhere. Right
/// to 1e-5 up to a slope of one and better below.
inline Lanes inverse_length(const Lanes& x) {
  Lanes y = 1.0f / (1.0f + 0.5f * x);
  for (int i = 0; i < kLengthSteps; ++i) y = y * (1.5f - 0.5f * (1.0f + x) * y * y);
  return y;
}

}  // namespace

void NodeBlend::clear() {
  sums_ = Sums{};
  faces_ = ridges_ = 0;
}

/// A patch in a brick's voxels, from its middle.
struct NodeBlend::Local {
  Eigen::Vector3f at, u, v, n;
  float uu, uv, vv, trust, support, per_support_sq, sharpen, bend, row_share;
  Local(const Patch& p, const Vec3& middle, double per_voxel) {
    const Quadric& q = p.quadric;
    const double voxel = 1.0 / per_voxel;
    at = ((q.at - middle) * per_voxel).cast<float>();
    u = q.u.cast<float>();
    v = q.v.cast<float>();
    n = q.n.cast<float>();
    uu = static_cast<float>(q.uu * voxel);
    uv = static_cast<float>(q.uv * voxel);
    vv = static_cast<float>(q.vv * voxel);
    trust = static_cast<float>(p.trust);
    support = static_cast<float>(p.support * per_voxel);
    per_support_sq = 1.0f / (support * support);
    // A cubic B-spline blurs by a sixth of the second difference along each axis: what it takes is added
    // beforehand. The distance's Laplacian is minus twice the sum of the height's curvatures.
    sharpen = (uu + vv) / 3.0f;
    const float mean = uu + vv, half = std::hypot(uu - vv, uv);
    const float most = mean + half, least = mean - half;  // the principal curvatures
    bend = std::abs(most) > std::abs(least) ? most : least;
    row_share = std::sqrt(std::max(1.0f - n.z() * n.z(), 0.0f)) * kHalfRow;
  }
};

/// Adds one patch to a row of nodes. The distance is that to the tangent plane at the foot, found by one step
/// from the first guess.
[[gnu::always_inline]] inline void NodeBlend::add_row(const Local& p, float dx, float dy, std::size_t row) {
  const float a0 = dx * p.u.x() + dy * p.u.y(), b0 = dx * p.v.x() + dy * p.v.y();
  const float w0 = dx * p.n.x() + dy * p.n.y();
  for (std::size_t half = 0; half < kRowHalves; ++half) {
    const Lanes dz =
        (half == 0 ? Lanes{-3.0f, -2.0f, -1.0f, 0.0f} : Lanes{1.0f, 2.0f, 3.0f, 3.0f}) - p.at.z();
    const Lanes a = dz * p.u.z() + a0, b = dz * p.v.z() + b0, w = dz * p.n.z() + w0;
    // Slope of the height at (a, b), and the drop along the normal there: the foot is about their product
    // back.
    const Lanes s0 = 2.0f * p.uu * a + p.uv * b, t0 = 2.0f * p.vv * b + p.uv * a;
    const Lanes back = (w - 0.5f * (s0 * a + t0 * b)) / (1.0f + s0 * s0 + t0 * t0);
    const Lanes a1 = a + s0 * back, b1 = b + t0 * back;
    const Lanes rest = at_least(1.0f - (a1 * a1 + b1 * b1) * p.per_support_sq, 0.0f);
    const Lanes s1 = 2.0f * p.uu * a1 + p.uv * b1, t1 = 2.0f * p.vv * b1 + p.uv * a1;
    const Lanes inverse = inverse_length(s1 * s1 + t1 * t1);
    const Lanes f = ((w - 0.5f * (s1 * a1 + t1 * b1)) - (a - a1) * s1 - (b - b1) * t1) * inverse;
    const Lanes near = kNearSquare + f * f;
    const Lanes left = at_most(at_least((1.0f - f * p.bend - kLeastBend) * kBendFade, 0.0f), 1.0f);
    const Lanes weight = p.trust * left * rest * rest * rest / (near * near);
    const Lanes per = weight * inverse;
    const std::size_t i = kRowHalves * row + half;
    sums_.weight[i] += weight;
    sums_.distance[i] += weight * (f + p.sharpen);
    sums_.x[i] += per * (p.n.x() - s1 * p.u.x() - t1 * p.v.x());
    sums_.y[i] += per * (p.n.y() - s1 * p.u.y() - t1 * p.v.y());
    sums_.z[i] += per * (p.n.z() - s1 * p.u.z() - t1 * p.v.z());
  }
}

void NodeBlend::add(const Patch& patch, const Vec3& middle, double per_voxel) {
  const Local p(patch, middle, per_voxel);
  for (int row = 0; row < kNodeRows; ++row) {
    const float dx = static_cast<float>(row / kBrickNodes) - kHalfRow - p.at.x();
    const float dy = static_cast<float>(row % kBrickNodes) - kHalfRow - p.at.y();
    // No node of the row is above the patch, wherever curvature puts its foot.
    const Eigen::Vector3f d(dx, dy, -p.at.z());
    const float along = d.dot(p.n), lateral_sq = d.squaredNorm() - along * along;
    const float reach = p.support + p.row_share + kFootRoom;
    if (lateral_sq > reach * reach) continue;
    add_row(p, dx, dy, static_cast<std::size_t>(row));
  }
}

void NodeBlend::read_sums(Values& to) const {
  for (std::size_t i = 0; i < kBrickCoefficients; ++i) {
    const std::size_t at = i % kBrickNodes, row = kRowHalves * (i / kBrickNodes) + at / 4, lane = at % 4;
    const float weight = sums_.weight[row][lane];
    to.known[i] = weight > kLeastWeight;
    const float per = to.known[i] != 0 ? 1.0f / weight : 0.0f;
    to.distance[i] = sums_.distance[row][lane] * per;
    to.x[i] = sums_.x[row][lane] * per;
    to.y[i] = sums_.y[row][lane] * per;
    to.z[i] = sums_.z[row][lane] * per;
  }
}

void NodeBlend::join(Values& with, const Values& other, bool greater) {
  for (std::size_t i = 0; i < kBrickCoefficients; ++i) {
    if (other.known[i] == 0) continue;
    if (with.known[i] != 0 && (other.distance[i] > with.distance[i]) != greater) continue;
    with.known[i] = 1;
    with.distance[i] = other.distance[i];
    with.x[i] = other.x[i];
    with.y[i] = other.y[i];
    with.z[i] = other.z[i];
  }
}

void NodeBlend::end_face() {
  read_sums(faces_ == 0 ? ridge_ : face_);
  if (faces_ > 0) join(ridge_, face_, true);
  ++faces_;
  sums_ = Sums{};
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
