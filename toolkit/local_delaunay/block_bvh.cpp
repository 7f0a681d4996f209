#include "toolkit/local_delaunay/block_bvh.h"

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <cmath>
#include <limits>

#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/planar_voronoi_cell.h"

namespace palpate::local_delaunay {
namespace {

constexpr float kFar = std::numeric_limits<float>::infinity();
constexpr std::size_t kNodesPerChunk = 256;

void add_to_box(BvhNode& node, std::uint32_t child, const Vec3f& p) noexcept {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    node.low[axis][child] = std::min(node.low[axis][child], p[static_cast<int>(axis)]);
    node.high[axis][child] = std::max(node.high[axis][child], p[static_cast<int>(axis)]);
  }
}

bool is_in_box(const BvhNode& node, std::uint32_t child, const Vec3f& p) noexcept {
  bool in = true;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float x = p[static_cast<int>(axis)];
    in = in && node.low[axis][child] <= x && x <= node.high[axis][child];
  }
  return in;
}

/// Sets the box of `child` to that around all of `below`. False if it is unchanged.
bool cover(BvhNode& node, std::uint32_t child, const BvhNode& below) noexcept {
  bool changed = false;
  const auto put = [&](float& at, float value) {
    changed = changed || at != value;
    at = value;
  };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    put(node.low[axis][child], *std::min_element(below.low[axis].begin(), below.low[axis].end()));
    put(node.high[axis][child], *std::max_element(below.high[axis].begin(), below.high[axis].end()));
  }
  return changed;
}

/// Rounded outward, plus one step for the rounding of the products compared with it.
float below(double x) noexcept {
  return std::nextafter(std::nextafter(static_cast<float>(x), -kFar), -kFar);
}
float above(double x) noexcept {
  return std::nextafter(std::nextafter(static_cast<float>(x), kFar), kFar);
}

/// The corners of a block's triangles, with few repeats, and the sum of the area normals.
struct BlockCorners {
  std::array<std::uint32_t, kBlockPlaces*(1 + kMaxCorners)> place;
  std::size_t count = 0;
  Vec3 area = Vec3::Zero();

  BlockCorners(const LocalDelaunayMesh& mesh, std::uint32_t block) noexcept {
    const std::uint32_t first = block * kBlockPlaces, last = std::min(first + kBlockPlaces, mesh.size());
    for (std::uint32_t lowest = first; lowest < last; ++lowest) add(mesh, lowest);
  }

 private:
  /// Adds the triangles whose lowest corner is the place.
  void add(const LocalDelaunayMesh& mesh, std::uint32_t lowest) noexcept {
    const Ring ring = mesh.ring(lowest);
    if (ring.size == 0) return;
    std::uint32_t higher = 0;  // bit k: ring point k is higher
    for (std::uint32_t k = 0; k < ring.size; ++k)
      higher |= static_cast<std::uint32_t>(ring.of[k] > lowest) << k;
    const std::uint32_t next_higher = higher >> 1 | (higher & 1u) << (ring.size - 1);
    const std::uint32_t sectors = higher & next_higher & ~ring.open;
    if (sectors == 0) return;
    const Vec3 p = mesh.at(lowest);
    for (std::uint32_t left = sectors; left != 0; left &= left - 1) {
      const auto k = static_cast<std::uint32_t>(__builtin_ctz(left));
      area += (mesh.at(ring.of[k]) - p).cross(mesh.at(ring.of[ring.next(k)]) - p);
    }
    place[count++] = lowest;
    const std::uint32_t all = (1u << ring.size) - 1u;
    for (std::uint32_t used = (sectors | sectors << 1 | sectors >> (ring.size - 1)) & all; used != 0;
         used &= used - 1)
      place[count++] = ring.of[static_cast<std::uint32_t>(__builtin_ctz(used))];
  }
};

/// The box around the corners; empty if none.
FloatBox box_of(const LocalDelaunayMesh& mesh, const BlockCorners& corners) noexcept {
  FloatBox box;
#if defined(__SSE2__)
  // The fourth lane holds what follows the coordinates.
  __m128 low = _mm_set1_ps(kFar), high = _mm_set1_ps(-kFar);
  for (std::size_t i = 0; i < corners.count; ++i) {
    const __m128 p = _mm_load_ps(&mesh.place(corners.place[i]).x_mm);
    low = _mm_min_ps(p, low);
    high = _mm_max_ps(p, high);
  }
  std::array<float, 4> lowest, highest;
  _mm_storeu_ps(lowest.data(), low);
  _mm_storeu_ps(highest.data(), high);
  std::copy_n(lowest.begin(), 3, box.low.begin());
  std::copy_n(highest.begin(), 3, box.high.begin());
#else
  box.low.fill(kFar);
  box.high.fill(-kFar);
  for (std::size_t i = 0; i < corners.count; ++i) {
    const PackedVertex& p = mesh.place(corners.place[i]);
    const std::array<float, 3> at = {p.x_mm, p.y_mm, p.z_mm};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], at[axis]);
      box.high[axis] = std::max(box.high[axis], at[axis]);
    }
  }
#endif
  return box;
}

Layer layer_of(const LocalDelaunayMesh& mesh, const BlockCorners& corners) noexcept {
  const double size = corners.area.norm();
  if (!(size > 0.0)) return {{}, -kFar, kFar};
  const Vec3f normal = (corners.area / size).cast<float>();
  const Vec3 along = normal.cast<double>();
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (std::size_t i = 0; i < corners.count; ++i) {
    const double height = along.dot(mesh.at(corners.place[i]));
    low = std::min(low, height);
    high = std::max(high, height);
  }
  return {{normal.x(), normal.y(), normal.z()}, below(low), above(high)};
}

}  // namespace

BlockBvh BlockBvh::build(const LocalDelaunayMesh& mesh, int threads) {
  BlockBvh tree;
  const std::size_t blocks = (mesh.size() + kBlockPlaces - 1) / kBlockPlaces;
  std::size_t count = (blocks + kBvhWidth - 1) / kBvhWidth;
  if (count == 0) return tree;
  tree.layers_.resize(blocks);
  tree.levels_.emplace_back(count, BvhNode::empty());
  parallel_each(count, kNodesPerChunk, threads, [&](std::size_t i) {
    const std::size_t last = std::min<std::size_t>((i + 1) * kBvhWidth, blocks);
    for (std::size_t block = i * kBvhWidth; block < last; ++block)
      tree.fit_block(mesh, static_cast<std::uint32_t>(block));
  });
  while (count > 1) {
    const LargePageVector<BvhNode>& below = tree.levels_.back();
    const std::size_t above = (count + kBvhWidth - 1) / kBvhWidth;
    LargePageVector<BvhNode> level(above, BvhNode::empty());
    for (std::size_t i = 0; i < count; ++i)
      (void)cover(level[i / kBvhWidth], static_cast<std::uint32_t>(i % kBvhWidth), below[i]);
    tree.levels_.push_back(std::move(level));
    count = above;
  }
  const BvhNode& root = tree.levels_.back()[0];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<int>(axis);
    tree.box_mm_.low_mm[at] =
        static_cast<double>(*std::min_element(root.low[axis].begin(), root.low[axis].end()));
    tree.box_mm_.high_mm[at] =
        static_cast<double>(*std::max_element(root.high[axis].begin(), root.high[axis].end()));
  }
  return tree;
}

BlockBvh BlockBvh::none(const LocalDelaunayMesh& mesh) {
  BlockBvh tree;
  tree.all_of_ = &mesh;
  tree.layers_.resize((mesh.size() + kBlockPlaces - 1) / kBlockPlaces);
  std::fill(tree.layers_.begin(), tree.layers_.end(), Layer{{}, -kFar, kFar});
  for (std::uint32_t place = 0; place < mesh.size(); ++place)
    mesh.for_triangles_of(place, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      for (const std::uint32_t corner : {a, b, c}) tree.box_mm_.add(mesh.at(corner));
    });
  return tree;
}

void BlockBvh::fit_block(const LocalDelaunayMesh& mesh, std::uint32_t block) noexcept {
  BvhNode& node = levels_[0][block / kBvhWidth];
  const std::uint32_t child = block % kBvhWidth;
  const BlockCorners corners(mesh, block);
  const FloatBox box = box_of(mesh, corners);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    node.low[axis][child] = box.low[axis];
    node.high[axis][child] = box.high[axis];
  }
  layers_[block] = layer_of(mesh, corners);
}

void BlockBvh::refit(const LocalDelaunayMesh& mesh, std::span<std::uint32_t> blocks) noexcept {
  for (const std::uint32_t block : blocks) fit_block(mesh, block);
  std::size_t count = blocks.size();
  for (std::size_t level = 0; level + 1 < levels_.size(); ++level) {
    // The changed nodes of this level, without repetition; the list is sorted.
    std::size_t nodes = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t node = blocks[i] / kBvhWidth;
      if (nodes == 0 || blocks[nodes - 1] != node) blocks[nodes++] = node;
    }
    // Of these, the nodes whose box changed; boxes above the others stay.
    count = 0;
    for (std::size_t i = 0; i < nodes; ++i)
      if (cover(levels_[level + 1][blocks[i] / kBvhWidth], blocks[i] % kBvhWidth, levels_[level][blocks[i]]))
        blocks[count++] = blocks[i];
  }
}

void BlockBvh::grow(std::uint32_t block, const Vec3& p) noexcept {
  const Vec3f at = p.cast<float>();
  std::uint32_t child = block;
  for (LargePageVector<BvhNode>& level : levels_) {
    BvhNode& node = level[child / kBvhWidth];
    if (is_in_box(node, child % kBvhWidth, at)) break;
    add_to_box(node, child % kBvhWidth, at);
    child /= kBvhWidth;
  }
  Layer& layer = layers_[block];
  const double height = Vec3f(layer.normal[0], layer.normal[1], layer.normal[2]).cast<double>().dot(p);
  layer.low = std::min(layer.low, below(height));
  layer.high = std::max(layer.high, above(height));
}

std::size_t BlockBvh::bytes() const noexcept {
  std::size_t sum = layers_.capacity() * sizeof(Layer);
  for (const auto& level : levels_) sum += level.capacity() * sizeof(BvhNode);
  return sum;
}

}  // namespace palpate::local_delaunay
