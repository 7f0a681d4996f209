// Friction as printed (section 3.5.2): moves the god object back along the surface towards its last place.
// Shared by the literal forms.
#pragma once

#include <palpate/vec.h>

namespace palpate::render {

/// Walks from place to place by at most coefficient times depth, the friction cone (the distance is not
/// printed). A per-point coefficient is read at the previous god object, as printed. at(place): its position;
/// around(place, use): calls use(neighbour). At most `steps` moves; allocates nothing.
template <class Place, class At, class Around>
[[nodiscard]] Place roll_back_friction(const Place& god, const Place& held, const Vec3& hip,
                                       double coefficient, int steps, At&& at, Around&& around) noexcept {
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
