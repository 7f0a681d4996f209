#include "toolkit/smooth/blend.h"

#include <algorithm>

namespace palpate::render {
namespace {

constexpr int kFillRounds = 2 * kBrickNodes;
/// What a cubic B-spline takes of a second difference along an axis.
constexpr float kBlur = 1.0f / 6.0f;
/// Layers are compared with what they are joined to where the surface is within so many voxels: nodes of a
/// cell that it goes through, and some more.
constexpr float kNearSurface = 1.5f;
/// A face may go on beyond its points differently from what else is known there, by so much.
constexpr float kCompared = 0.75f;
constexpr float kSameDistance = 0.35f;
/// A layer may count between nodes, too, where it is so near to counting at one.
constexpr float kAlmostCounts = 0.5f;

/// The least over bodies of the greatest over faces; which face that is.
struct Counted {
  float value = 0.0f;
  std::size_t face = kMostLayers;
};
template <class Has, class Value>
Counted joined(std::size_t faces, const std::array<int, kMostLayers>& body, Has&& has, Value&& value) {
  Counted least;
  for (std::size_t k = 0; k < faces;) {
    Counted most;
    const int own = body[k];
    for (; k < faces && body[k] == own; ++k)
      if (has(k) && (most.face == kMostLayers || value(k) > most.value)) most = {value(k), k};
    if (most.face == kMostLayers) continue;
    if (least.face == kMostLayers || most.value < least.value) least = most;
  }
  return least;
}

}  // namespace

void NodeBlend::begin(const BrickGrid::Coordinate& cube) {
  cube_ = cube;
  faces_ = ridges_ = added_ = 0;
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

void NodeBlend::read_face(std::span<const std::uint32_t> patches, Values& to) {
  tiles_.take_face(patches);
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
}

void NodeBlend::add_face(std::span<const std::uint32_t> patches) {
  if (added_ == 1) keep(0, ridges_ == 0 ? ridge_ : values_);  // of one face alone nothing is kept
  Values& to = faces_ == 0 ? ridge_ : face_;
  read_face(patches, to);
  if (added_ > 0 && added_ < kMostLayers) keep(static_cast<std::size_t>(added_), to);
  ++added_;
  if (faces_ > 0) join(ridge_, face_, true);
  ++faces_;
}

bool NodeBlend::alone(std::size_t k, std::span<const std::uint32_t> patches) {
  Values& v = kept_[k];
  read_face(patches, v);
  if (std::count(v.known.begin(), v.known.end(), std::uint8_t{0}) == kBrickCoefficients) return false;
  fill(v);
  return true;
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
void NodeBlend::fill(Values& v) {
  constexpr std::array<int, 3> kStep{kBrickNodes * kBrickNodes, kBrickNodes, 1};
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
  fill(values_);
  return values_.distance;
}

void NodeBlend::keep(std::size_t k, const Values& face) {
  kept_[k] = face;
  body_[k] = k == 0 ? 0 : ridges_;
}

bool NodeBlend::choose_layers() {
  const auto faces = static_cast<std::size_t>(added_);
  counts_.fill(false);
  for (int x = 1; x + 1 < kBrickNodes; ++x)
    for (int y = 1; y + 1 < kBrickNodes; ++y)
      for (int z = 1; z + 1 < kBrickNodes; ++z) {
        const auto i = static_cast<std::size_t>((x * kBrickNodes + y) * kBrickNodes + z);
        const auto value = [&](std::size_t k) { return kept_[k].distance[i]; };
        const Counted told = joined(
            faces, body_, [&](std::size_t k) { return known_[k][i] != 0; }, value);
        const Counted whole = joined(
            faces, body_, [&](std::size_t k) { return any_[k]; }, value);
        if (told.face == kMostLayers || std::abs(whole.value) > kNearSurface) continue;
        if (std::abs(told.value) < kCompared && std::abs(told.value - whole.value) > kSameDistance)
          return false;
        for (std::size_t k = 0; k < faces; ++k)
          if (any_[k] && std::abs(value(k) - whole.value) < kAlmostCounts) counts_[k] = true;
      }
  return true;
}

std::span<const NodeBlend::Layer> NodeBlend::layers() {
  if (added_ < 2 || added_ > kMostLayers) return {};
  const auto faces = static_cast<std::size_t>(added_);
  for (std::size_t k = 0; k < faces; ++k) {
    known_[k] = kept_[k].known;
    any_[k] = std::count(known_[k].begin(), known_[k].end(), std::uint8_t{0}) < kBrickCoefficients;
    fill(kept_[k]);
  }
  if (!choose_layers()) return {};
  std::size_t count = 0;
  int body = 0;
  for (std::size_t k = 0; k < faces; ++k) {
    if (!counts_[k]) continue;
    if (count > 0) layers_[count - 1].on = body_[k] == body ? Joint::kRidge : Joint::kValley;
    body = body_[k];
    layers_[count].distance = kept_[k].distance;
    layers_[count++].on = Joint::kLast;
  }
  return {layers_.data(), count};
}

}  // namespace palpate::render
