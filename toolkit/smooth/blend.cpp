#include "toolkit/smooth/blend.h"

#include <algorithm>

namespace palpate::render {
namespace {

constexpr int kFillRounds = 2 * kBrickNodes;
/// What a cubic B-spline takes of a second difference along an axis.
constexpr float kBlur = 1.0f / 6.0f;

}  // namespace

void NodeBlend::begin(const BrickGrid::Coordinate& cube) {
  cube_ = cube;
  faces_ = ridges_ = 0;
}

/// `first`: the brick's node that the tile begins with; `kRow`: nodes of a row. What is beyond the brick's
/// nodes is left.
template <int kRow>
void NodeBlend::read_rows(const Tile& tile, const std::array<int, 3>& first, Values& to) {
  const int past_x = std::min(kBrickNodes - first[0], kTileNodes);
  const int past_y = std::min(kBrickNodes - first[1], kTileNodes);
  for (int x = 0; x < past_x; ++x)
    for (int y = 0; y < past_y; ++y) {
      const auto from = static_cast<std::size_t>((x * kTileNodes + y) * kTileNodes);
      const auto at =
          static_cast<std::size_t>(((first[0] + x) * kBrickNodes + first[1] + y) * kBrickNodes + first[2]);
      const auto copy = [&](const auto& values, auto& out) {
        for (std::size_t z = 0; z < std::size_t{kRow}; ++z) out[at + z] = values[from + z];
      };
      copy(tile.distance, to.distance);
      copy(tile.x, to.x);
      copy(tile.y, to.y);
      copy(tile.z, to.z);
      copy(tile.known, to.known);
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

void NodeBlend::add_face(std::span<const std::uint32_t> patches) {
  tiles_.take_face(patches);
  Values& to = faces_ == 0 ? ridge_ : face_;
  // A brick's nodes begin one before its cells, as the tiles do.
  for (int corner = 0; corner < 8; ++corner) {
    const std::array<int, 3> on{corner / 4, corner / 2 % 2, corner % 2};
    const std::array<int, 3> first{kTileNodes * on[0], kTileNodes * on[1], kTileNodes * on[2]};
    const Tile& tile = tiles_.at({cube_[0] + on[0], cube_[1] + on[1], cube_[2] + on[2]});
    if (on[2] == 0)
      read_rows<kTileNodes>(tile, first, to);
    else
      read_rows<kBrickNodes - kTileNodes>(tile, first, to);
  }
  if (faces_ > 0) join(ridge_, face_, true);
  ++faces_;
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
