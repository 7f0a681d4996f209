// Friction as printed (section 3.5.2): the god object moves back along the surface towards that of the frame
// before. Shared by the literal forms.
#pragma once

#include "toolkit/core/vec.h"

namespace palpate::render {

/// How far is not printed; here as far as the coefficient times the depth, the friction cone, from place to
/// place. A coefficient per point is that of the previous god object, as printed.
/// at(place): its position; around(place, use): calls use(other) for its neighbours. Moves at most `steps`
/// times; allocates nothing.
template <class Place, class At, class Around>
[[nodiscard]] Place roll_back(const Place& god, const Place& held, const Vec3& hip, double coefficient,
                              int steps, At&& at, Around&& around) noexcept {
  const Vec3 g = at(god), aim = at(held);
  const double most_sq = coefficient * coefficient * (g - hip).squaredNorm();
  Place place = god;
  double left_sq = (aim - g).squaredNorm();
  for (; steps > 0; --steps) {
    Place next = place;
    around(place, [&](const Place& other) {
      const double sq = (at(other) - aim).squaredNorm();
      if (!(sq < left_sq)) return;
      left_sq = sq;
      next = other;
    });
    if (next == place || !((at(next) - g).squaredNorm() <= most_sq)) break;
    place = next;
  }
  return place;
}

}  // namespace palpate::render
