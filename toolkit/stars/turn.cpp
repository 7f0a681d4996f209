#include "toolkit/stars/turn.h"

#include <Eigen/Geometry>  // cross products
#include <algorithm>

namespace palpate::stars {
namespace {

/// Sets of points with, for each, whether it runs the other way around than its set's first.
class Sides {
 public:
  explicit Sides(std::size_t n) : up_(n) {
    for (std::uint32_t i = 0; i < n; ++i) up_[i] = i << 1;
  }
  struct Root {
    std::uint32_t set;
    std::uint32_t turned;
  };
  Root find(std::uint32_t i) noexcept {
    std::uint32_t turned = 0;
    for (;;) {
      const std::uint32_t link = up_[i], parent = link >> 1;
      if (parent == i) return {i, turned};
      const std::uint32_t above = up_[parent];
      // Each point on the way is hung one higher.
      up_[i] = (above & ~1u) | ((link ^ above) & 1u);
      if (above >> 1 == parent) return {parent, turned ^ (link & 1u)};
      turned ^= up_[i] & 1u;
      i = above >> 1;
    }
  }
  /// False where they are of one set already and disagree.
  bool join(std::uint32_t a, std::uint32_t b, std::uint32_t turned) noexcept {
    const Root ra = find(a), rb = find(b);
    const std::uint32_t between = ra.turned ^ rb.turned ^ turned;
    if (ra.set == rb.set) return between == 0;
    // The lower one stays on top: the same for every order of joining.
    if (ra.set < rb.set)
      up_[rb.set] = ra.set << 1 | between;
    else
      up_[ra.set] = rb.set << 1 | between;
    return true;
  }

 private:
  std::vector<std::uint32_t> up_;  ///< parent << 1 | turned against it; below 2^31 points
};

/// Whether the star has the sector b -> c (0) or c -> b (1).
std::uint32_t way(const Star& star, std::uint32_t b, std::uint32_t c) noexcept {
  for (std::uint32_t k = 0; k < star.size; ++k)
    if (star.ring[k] == b && star.has_sector(k) && star.ring[star.next(k)] == c) return 0;
  return 1;
}

void open_sector(Star& star, std::uint32_t b, std::uint32_t c) noexcept {
  for (std::uint32_t k = 0; k < star.size; ++k) {
    const std::uint32_t x = star.ring[k], y = star.ring[star.next(k)];
    if (!star.has_sector(k) || !((x == b && y == c) || (x == c && y == b))) continue;
    star.open |= 1u << k;
    star.agreed &= ~(1u << k);
    return;
  }
}

void reverse(Star& star) noexcept {
  const std::uint32_t n = star.size;
  std::reverse(star.ring.begin(), star.ring.begin() + n);
  std::uint32_t open = 0;
  // Sector k, between k and k + 1, is now between n - 2 - k and n - 1 - k.
  for (std::uint32_t k = 0; k < n; ++k)
    if (!star.has_sector(k)) open |= 1u << (k + 1 == n ? n - 1 : n - 2 - k);
  star.open = open;
  star.agreed = ~open & (n == 32 ? ~0u : (1u << n) - 1u);
}

/// visit(i, b, c) for each triangle once, from its lowest point.
template <class Visit>
void for_triangles(const Draft& draft, Visit&& visit) {
  for (std::uint32_t i = 0; i < draft.size(); ++i) {
    const Star& star = draft.star[i];
    for (std::uint32_t k = 0; k < star.size; ++k) {
      const std::uint32_t b = star.ring[k], c = star.ring[star.next(k)];
      if (star.has_sector(k) && i < b && i < c) visit(i, b, c);
    }
  }
}

}  // namespace

Pieces turn_stars(Draft& draft) {
  const std::size_t n = draft.size();
  Sides sides(n);
  Pieces pieces;
  std::vector<std::array<std::uint32_t, 3>> torn;
  // What all three stars agreed on goes first: it is seldom wrong.
  const auto join = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const bool one = sides.join(a, b, way(draft.star[b], c, a));
    const bool two = sides.join(a, c, way(draft.star[c], a, b));
    if (!one || !two) torn.push_back({a, b, c});
  };
  for (const bool first : {true, false})
    for_triangles(draft, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const bool sure = (draft.doubtful[a] | draft.doubtful[b] | draft.doubtful[c]) == 0;
      if (sure == first) join(a, b, c);
    });
  for (const auto& t : torn)
    for (std::size_t k = 0; k < 3; ++k) open_sector(draft.star[t[k]], t[(k + 1) % 3], t[(k + 2) % 3]);
  pieces.torn = torn.size();

  std::vector<std::uint32_t> piece_of_root(n, kNoPoint);
  pieces.of.assign(n, kNoPoint);
  for (std::uint32_t i = 0; i < n; ++i) {
    if (draft.star[i].sectors() == 0) continue;
    const Sides::Root root = sides.find(i);
    if (root.turned != 0) reverse(draft.star[i]);
    if (piece_of_root[root.set] == kNoPoint) {
      piece_of_root[root.set] = static_cast<std::uint32_t>(pieces.closed.size());
      pieces.closed.push_back(1);
    }
    const std::uint32_t piece = piece_of_root[root.set];
    pieces.of[i] = piece;
    if (draft.star[i].open != 0) pieces.closed[piece] = 0;
  }
  std::vector<double> volume(pieces.closed.size(), 0.0);
  for_triangles(draft, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (pieces.closed[pieces.of[a]] != 0)
      volume[pieces.of[a]] += draft.at(a).dot(draft.at(b).cross(draft.at(c)));
  });
  for (std::uint32_t i = 0; i < n; ++i)
    if (pieces.of[i] != kNoPoint && volume[pieces.of[i]] < 0.0) reverse(draft.star[i]);
  return pieces;
}

}  // namespace palpate::stars
