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

/// Where the nodes of a row stand from its middle, in voxels.
inline NodeRow row_places() {
  NodeRow z;
  z << -3.0f, -2.0f, -1.0f, 0.0f, 1.0f, 2.0f, 3.0f, 3.0f;
  return z;
}

}  // namespace

void NodeBlend::clear() {
  for (auto* field : {&weight_, &sum_, &sum_x_, &sum_y_, &sum_z_}) field->fill(NodeRow::Zero());
}

/// A patch in a brick's voxels, from its middle.
struct NodeBlend::Local {
  Eigen::Vector3f at, u, v, n;
  float uu, uv, vv, support, per_support_sq, sharpen, bend, row_share;
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
  const NodeRow dz = row_places() - p.at.z();
  const NodeRow a = dz * p.u.z() + (dx * p.u.x() + dy * p.u.y());
  const NodeRow b = dz * p.v.z() + (dx * p.v.x() + dy * p.v.y());
  const NodeRow w = dz * p.n.z() + (dx * p.n.x() + dy * p.n.y());
  // Slope of the height at (a, b), and the drop along the normal there: the foot lies about their product
  // back.
  const NodeRow s0 = 2.0f * p.uu * a + p.uv * b, t0 = 2.0f * p.vv * b + p.uv * a;
  const NodeRow h0 = w - 0.5f * (s0 * a + t0 * b);
  const NodeRow back = h0 / (1.0f + s0 * s0 + t0 * t0);
  const NodeRow a1 = a + s0 * back, b1 = b + t0 * back;
  const NodeRow s1 = 2.0f * p.uu * a1 + p.uv * b1, t1 = 2.0f * p.vv * b1 + p.uv * a1;
  const NodeRow inverse = (1.0f + s1 * s1 + t1 * t1).sqrt().inverse();
  const NodeRow f = ((w - 0.5f * (s1 * a1 + t1 * b1)) - (a - a1) * s1 - (b - b1) * t1) * inverse;
  const NodeRow rest = (1.0f - (a1 * a1 + b1 * b1) * p.per_support_sq).max(0.0f);
  const NodeRow near = kNearSquare + f * f;
  const NodeRow left = ((1.0f - f * p.bend - kLeastBend) * kBendFade).max(0.0f).min(1.0f);
  const NodeRow weight = left * rest * rest * rest / (near * near);
  weight_[row] += weight;
  sum_[row] += weight * (f + p.sharpen);
  const NodeRow per = weight * inverse;
  sum_x_[row] += per * (p.n.x() - s1 * p.u.x() - t1 * p.v.x());
  sum_y_[row] += per * (p.n.y() - s1 * p.u.y() - t1 * p.v.y());
  sum_z_[row] += per * (p.n.z() - s1 * p.u.z() - t1 * p.v.z());
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

int NodeBlend::read_sums() {
  int missing = 0;
  for (std::size_t i = 0; i < kBrickCoefficients; ++i) {
    const std::size_t row = i / kBrickNodes;
    const auto lane = static_cast<Eigen::Index>(i % kBrickNodes);
    const float weight = weight_[row][lane];
    known_[i] = weight > kLeastWeight;
    missing += known_[i] == 0;
    const float per = known_[i] != 0 ? 1.0f / weight : 0.0f;
    distance_[i] = sum_[row][lane] * per;
    x_[i] = sum_x_[row][lane] * per;
    y_[i] = sum_y_[row][lane] * per;
    z_[i] = sum_z_[row][lane] * per;
  }
  return missing;
}

/// Nodes that no patch reaches go on from the nodes beside them, along their gradients.
void NodeBlend::fill(int missing) {
  constexpr std::array<int, 3> kStep{kBrickNodes * kBrickNodes, kBrickNodes, 1};
  for (int round = 0; round < kFillRounds && missing > 0; ++round) {
    std::array<std::uint8_t, kBrickCoefficients> now = known_;
    for (int i = 0; i < kBrickCoefficients; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (known_[k] != 0) continue;
      float count = 0.0f, f = 0.0f;
      Eigen::Vector3f g = Eigen::Vector3f::Zero();
      for (int axis = 0; axis < 3; ++axis) {
        const int at = i / kStep[static_cast<std::size_t>(axis)] % kBrickNodes;
        for (int side = -1; side <= 1; side += 2) {
          if (at + side < 0 || at + side >= kBrickNodes) continue;
          const auto j = static_cast<std::size_t>(i + side * kStep[static_cast<std::size_t>(axis)]);
          if (known_[j] == 0) continue;
          const Eigen::Vector3f gj(x_[j], y_[j], z_[j]);
          f += distance_[j] - static_cast<float>(side) * gj[axis];
          g += gj;
          count += 1.0f;
        }
      }
      if (count == 0.0f) continue;
      distance_[k] = f / count;
      x_[k] = g.x() / count;
      y_[k] = g.y() / count;
      z_[k] = g.z() / count;
      now[k] = 1;
      --missing;
    }
    known_ = now;
  }
}

const std::array<float, kBrickCoefficients>& NodeBlend::finish() {
  fill(read_sums());
  return distance_;
}

}  // namespace palpate::render
