// Where the points of a model are that gives way. The window asks about those around the touched place and
// those it has seen move, so many a picture; the servo answers between two frames.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "experiments/window/feed.h"
#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::experiments {

/// A point that stands elsewhere than it did in the picture before.
struct ShiftedPoint {
  std::uint32_t point = 0;  ///< of the cloud
  Vec3f place_mm = Vec3f::Zero();
};

/// Of one model. The window's thread.
class DentView {
 public:
  /// The next question: about the points around `touched`, link by link outwards, as far as room is; then in
  /// turn about those that were seen to move and what is beside them, so that a dent is found to its border
  /// and what is taken back is seen to go. Nothing where there is nothing to ask. Work bounded by
  /// PointQuestion::kMost.
  [[nodiscard]] std::optional<PointQuestion> question(std::uint32_t model,
                                                      const std::optional<std::uint32_t>& touched,
                                                      const neighbourhood::NeighbourTable& neighbours);
  /// What an answer changes in the picture. One that is not known puts everything back.
  [[nodiscard]] std::vector<ShiftedPoint> take(const PointAnswer& answer, const cloud::Cloud& cloud);
  /// Points that stand elsewhere than they were read.
  [[nodiscard]] std::size_t shifted() const noexcept { return moved_.size(); }

 private:
  std::unordered_map<std::uint32_t, Vec3f> moved_;
  std::vector<std::uint32_t> turn_;  // all that ever moved, asked again and again
  std::unordered_set<std::uint32_t> in_turn_;
  std::size_t next_ = 0;
};

}  // namespace palpate::experiments
