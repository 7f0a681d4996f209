// Tracks the moved points of a deformable model. The window asks about some points per picture, around the
// touched place and those seen to move; the servo answers between frames.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include <palpate/cloud.h>
#include "experiments/window/feed.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::experiments {

/// A point that moved since the previous picture.
struct ShiftedPoint {
  std::uint32_t point = 0;  ///< index in the cloud
  Vec3f place_mm = Vec3f::Zero();
};

/// Tracks one model. For the window's thread.
class DentView {
 public:
  /// The next question. It holds points around `touched`, outwards link by link, then in turn those seen to
  /// move and their neighbours, to find a dent's border and its recovery. Empty if nothing is to be asked.
  /// Work bounded by PointQuestion::kMost.
  [[nodiscard]] std::optional<PointQuestion> question(std::uint32_t model,
                                                      const std::optional<std::uint32_t>& touched,
                                                      const search::NeighbourTable& neighbours);
  /// An answer's changes to the picture. An unknown answer puts every point back.
  [[nodiscard]] std::vector<ShiftedPoint> take(const PointAnswer& answer, const cloud::Cloud& cloud);
  /// Number of points away from their read position.
  [[nodiscard]] std::size_t shifted() const noexcept { return moved_.size(); }

 private:
  std::unordered_map<std::uint32_t, Vec3f> moved_;
  std::vector<std::uint32_t> turn_;  // every point that ever moved, asked in turn
  std::unordered_set<std::uint32_t> in_turn_;
  std::size_t next_ = 0;
};

}  // namespace palpate::experiments
