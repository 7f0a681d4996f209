// Which side of a model's closed surfaces is free.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/points/point_model.h"

namespace palpate::render {

/// Of each closed piece the side where the HIP was last known to be free: outside, or inside a cavity. A HIP
/// between two shells is inside one and outside the other. Belongs to one thread.
class FreeSides {
 public:
  /// Before the first use. Allocates.
  void attach(const PointModel& model) { sides_.assign(model.closed_pieces, 1.0); }
  /// The HIP is free at `h`. O(n) where the model has closed pieces; allocates nothing.
  void find(const PointModel& model, const Vec3& h) noexcept {
    if (!sides_.empty())
      surface::find_sides(model.points, model.neighbours, model.closed_piece_of, h, sides_);
  }
  /// Of a place whose normal is one-sided: 1 where its piece is touched from outside, else -1.
  [[nodiscard]] double at(const PointModel& model, std::uint32_t place) const noexcept {
    return sides_[model.closed_piece_of.empty() ? 0 : model.closed_piece_of[place]];
  }

 private:
  std::vector<double> sides_;
};

}  // namespace palpate::render
