// A tree over boxes that follow each other in space, as cells in Morton order do: each node is the box of
// eight consecutive ones. No pointers, 1/7 more boxes.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <palpate/geometry.h>

namespace palpate::prepared {

/// Immutable once built; thread-safe.
class BoxTree {
 public:
  BoxTree() = default;
  explicit BoxTree(std::vector<geometry::Aabb> boxes) {
    levels_.push_back(std::move(boxes));
    while (levels_.back().size() > 1) {
      const std::vector<geometry::Aabb>& below = levels_.back();
      std::vector<geometry::Aabb> level((below.size() + kFan - 1) / kFan);
      for (std::size_t i = 0; i < below.size(); ++i) level[i / kFan].add(below[i]);
      levels_.push_back(std::move(level));
    }
  }

  [[nodiscard]] std::size_t size() const noexcept { return levels_.empty() ? 0 : levels_.front().size(); }
  [[nodiscard]] const geometry::Aabb& box(std::size_t i) const noexcept { return levels_.front()[i]; }
  [[nodiscard]] geometry::Aabb bounds() const noexcept {
    return size() == 0 ? geometry::Aabb() : levels_.back().front();
  }

  /// Calls visit(index) for every box that overlaps or touches `box`, in ascending order.
  template <class Visit>
  void visit_overlapping(const geometry::Aabb& box, Visit&& visit) const {
    if (size() != 0) descend(levels_.size() - 1, 0, box, visit);
  }

 private:
  static constexpr std::size_t kFan = 8;

  template <class Visit>
  void descend(std::size_t level, std::size_t node, const geometry::Aabb& box, Visit& visit) const {
    if (!levels_[level][node].overlaps(box)) return;
    if (level == 0) return visit(node);
    const std::size_t past = std::min((node + 1) * kFan, levels_[level - 1].size());
    for (std::size_t child = node * kFan; child < past; ++child) descend(level - 1, child, box, visit);
  }

  std::vector<std::vector<geometry::Aabb>> levels_;  ///< the boxes first, the root last
};

}  // namespace palpate::prepared
