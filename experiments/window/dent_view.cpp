#include "experiments/window/dent_view.h"

#include <algorithm>

namespace palpate::experiments {
namespace {

/// Half a question is for points around the touched place. The other half finds the rest of a dent, which
/// grows outwards by up to 128 points a frame.
constexpr std::size_t kAroundTouch = PointQuestion::kMost / 2;
static_assert(kAroundTouch < PointQuestion::kMost);

Vec3f read_place(const cloud::Cloud& cloud, std::uint32_t point) {
  return {cloud.x_mm[point], cloud.y_mm[point], cloud.z_mm[point]};
}

}  // namespace

std::optional<PointQuestion> DentView::question(std::uint32_t model,
                                                const std::optional<std::uint32_t>& touched,
                                                const search::NeighbourTable& neighbours) {
  PointQuestion asked;
  asked.model = model;
  std::unordered_set<std::uint32_t> in;
  const auto add = [&](std::uint32_t point) {
    if (asked.count < PointQuestion::kMost && in.insert(point).second) asked.point[asked.count++] = point;
  };
  if (touched) {
    add(*touched);
    for (std::size_t at = 0; at < asked.count && asked.count < kAroundTouch; ++at)
      for (const std::uint32_t other : neighbours.of[asked.point[at]])
        if (asked.count < kAroundTouch) add(other);
  }
  for (std::size_t tried = 0; tried < turn_.size() && asked.count < PointQuestion::kMost; ++tried) {
    next_ = (next_ + 1) % turn_.size();
    add(turn_[next_]);
    // Neighbours of a moved point probably moved too: the search reaches the dent's border.
    if (moved_.contains(turn_[next_]))
      for (const std::uint32_t other : neighbours.of[turn_[next_]])
        if (!in_turn_.contains(other)) add(other);
  }
  if (asked.count == 0) return std::nullopt;
  return asked;
}

std::vector<ShiftedPoint> DentView::take(const PointAnswer& answer, const cloud::Cloud& cloud) {
  std::vector<ShiftedPoint> shifted;
  if (!answer.known) {
    for (const auto& [point, place_mm] : moved_) shifted.push_back({point, read_place(cloud, point)});
    moved_.clear();
    return shifted;
  }
  for (std::size_t i = 0; i < answer.of.count; ++i) {
    const std::uint32_t point = answer.of.point[i];
    if (point >= cloud.size()) continue;
    const Vec3f read_mm = read_place(cloud, point);
    const auto known = moved_.find(point);
    const Vec3f before_mm = known == moved_.end() ? read_mm : known->second;
    const Vec3f now_mm = answer.place_mm[i];
    if (now_mm == before_mm) continue;
    shifted.push_back({point, now_mm});
    if (now_mm == read_mm)
      moved_.erase(point);
    else
      moved_[point] = now_mm;
    if (in_turn_.insert(point).second) turn_.push_back(point);
  }
  return shifted;
}

}  // namespace palpate::experiments
