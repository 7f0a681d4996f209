#include "toolkit/geometry/broad_phase.h"

#include <algorithm>
#include <cassert>

#include "toolkit/geometry/segment_box.h"

namespace palpate::geometry {
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
