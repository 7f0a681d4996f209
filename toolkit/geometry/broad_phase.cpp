#include "toolkit/geometry/broad_phase.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

#include "toolkit/geometry/segment_box.h"

namespace palpate::geometry {
namespace {

/// The box, or an empty one if it has a NaN, which would spread to all boxes above.
Aabb sound(const Aabb& box) noexcept {
  return (box.low_mm.array() <= box.high_mm.array()).all() ? box : Aabb{};
}

/// An infinite box has no centre and is sorted at the origin, which only costs speed.
Vec3 sorted_by(const Aabb& box) noexcept {
  const Vec3 centre = 0.5 * box.low_mm + 0.5 * box.high_mm;
  return is_finite(centre) ? centre : Vec3::Zero();
}

double half_surface(const Aabb& box) noexcept {
  const Vec3 e = box.extent_mm();
  return e.x() * e.y() + e.y() * e.z() + e.z() * e.x();
}

}  // namespace

AabbTree::AabbTree(std::uint32_t items, const BoxOf& box_of, std::uint32_t leaf_items)
    : leaf_items_(std::max(leaf_items, 1u)), order_(items), centres_(items) {
  // A split node holds at least leaf_items + 1 items: at most 2 n / (leaf_items + 1) leaves, or one.
  nodes_.reserve(std::size_t{4} * items / (std::size_t{leaf_items_} + 1) + 1);
  build(box_of);
}

std::size_t AabbTree::bytes() const noexcept {
  return nodes_.capacity() * sizeof(Node) + order_.capacity() * sizeof(std::uint32_t) +
         centres_.capacity() * sizeof(Vec3);
}

void AabbTree::build(const BoxOf& box_of) noexcept {
  nodes_.clear();
  std::iota(order_.begin(), order_.end(), 0u);
  if (order_.empty()) return;
  for (std::uint32_t i = 0; i < size(); ++i) centres_[i] = sorted_by(sound(box_of(i)));
  split(0, size());
  refit(box_of);
  built_surface_area_ = inner_surface_area();
}

/// Halves the count, so the recursion depth is at most log2(items) + 1.
std::uint32_t AabbTree::split(std::uint32_t begin, std::uint32_t end) noexcept {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.push_back({{}, begin, end, 0});
  if (end - begin <= leaf_items_) return index;
  Aabb spread;
  for (std::uint32_t i = begin; i < end; ++i) spread.add(centres_[order_[i]]);
  Eigen::Index axis = 0;
  spread.extent_mm().maxCoeff(&axis);
  const std::uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](std::uint32_t a, std::uint32_t b) {
                     const double ca = centres_[a][axis], cb = centres_[b][axis];
                     return ca != cb ? ca < cb : a < b;
                   });
  split(begin, middle);
  const std::uint32_t right = split(middle, end);
  nodes_[index].right = right;
  return index;
}

void AabbTree::refit(const BoxOf& box_of) noexcept {
  for (std::size_t n = nodes_.size(); n-- > 0;) {  // children are stored after their parents
    Node& node = nodes_[n];
    node.box = {};
    if (node.right != 0) {
      node.box.add(nodes_[n + 1].box);
      node.box.add(nodes_[node.right].box);
      continue;
    }
    for (std::uint32_t i = node.begin; i < node.end; ++i) node.box.add(sound(box_of(order_[i])));
  }
}

void AabbTree::rebuild(const BoxOf& box_of) noexcept {
  build(box_of);
}

double AabbTree::inner_surface_area() const noexcept {
  double sum = 0.0;
  for (const Node& node : nodes_)
    if (node.right != 0) sum += half_surface(node.box);
  return sum;
}

double AabbTree::growth() const noexcept {
  const double ratio = inner_surface_area() / built_surface_area_;
  return std::isfinite(ratio) ? ratio : 1.0;
}

namespace {

bool before(const BoxHit& a, const BoxHit& b) noexcept {
  return a.distance_sq_mm2 != b.distance_sq_mm2 ? a.distance_sq_mm2 < b.distance_sq_mm2 : a.item < b.item;
}

/// Keeps the list sorted. A full list drops its last hit or refuses the new one.
void insert(const BoxHit& hit, std::span<BoxHit> list, BoxQuery& query) noexcept {
  std::uint32_t at = query.hits;
  if (at == list.size()) {
    ++query.left_out;
    if (at == 0 || !before(hit, list[at - 1])) return;
    --at;
  } else {
    ++query.hits;
  }
  for (; at > 0 && before(hit, list[at - 1]); --at) list[at] = list[at - 1];
  list[at] = hit;
}

}  // namespace

BroadPhase::BroadPhase(std::span<const Aabb> boxes)
    : tree_(static_cast<std::uint32_t>(boxes.size()), [&](std::uint32_t i) { return boxes[i]; }),
      boxes_(boxes.begin(), boxes.end()) {}

void BroadPhase::update(std::span<const Aabb> boxes) noexcept {
  assert(boxes.size() == boxes_.size());
  std::copy(boxes.begin(), boxes.end(), boxes_.begin());
  const auto box_of = [this](std::uint32_t i) { return boxes_[i]; };
  tree_.refit(box_of);
  if (tree_.growth() <= kRebuildAreaRatio) return;
  tree_.rebuild(box_of);
  ++rebuilds_;
}

BoxQuery BroadPhase::query(const Aabb& region, std::span<BoxHit> list) const noexcept {
  BoxQuery query;
  // An infinite region has no centre.
  const Vec3 middle_mm = region.centre_mm(), centre_mm = is_finite(middle_mm) ? middle_mm : Vec3::Zero();
  tree_.visit(
      [&](const Aabb& box) {
        ++query.nodes;
        return box.overlaps(region);
      },
      [&](std::uint32_t i) {
        insert({i, boxes_[i].distance_sq_mm2(centre_mm)}, list, query);
      });
  return query;
}

void BroadPhase::within(const Aabb& region, std::vector<std::uint32_t>& out) const noexcept {
  out.clear();
  tree_.visit([&](const Aabb& box) { return box.overlaps(region); },
              [&](std::uint32_t i) { out.push_back(i); });
  std::sort(out.begin(), out.end());
}

void BroadPhase::along_segment(const Vec3& from_mm, const Vec3& to_mm, double reach_mm,
                               std::vector<std::uint32_t>& out) const noexcept {
  out.clear();
  const SegmentProbe way(from_mm, to_mm);
  const Vec3 reach = Vec3::Constant(reach_mm);
  tree_.visit(
      [&](const Aabb& box) {
        const Vec3 centre = box.centre_mm();
        if (box.empty()) return false;
        if (!is_finite(centre)) return true;  // an infinite box has no centre and is always met
        return segment_touches_box(way, centre, 0.5 * box.extent_mm() + reach);
      },
      [&](std::uint32_t i) { out.push_back(i); });
  std::sort(out.begin(), out.end());
}

}  // namespace palpate::geometry
