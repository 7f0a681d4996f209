// Internal to stars: what the stars do not agree on is settled triangle by triangle, so that every edge has
// at most two triangles and every point one fan, or fans apart.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/stars/draft.h"

namespace palpate::stars {

/// Loops of more edges are holes or borders: around a hole as wide as the widest circle that a triangle may
/// have, 3.4 mean spacings, stand some twenty points.
inline constexpr std::size_t kMaxLoop = 20;

struct FillReport {
  std::size_t voted = 0;   ///< triangles that one or two of their three stars had
  std::size_t filled = 0;  ///< triangles put into small loops
};

/// Afterwards every star's sectors are agreed, and what is not is open. Points whose stars agreed keep them.
/// The same for any number of threads. O(n), and O(m log m) in the m triangles in doubt.
FillReport fill_gaps(Draft& draft);

/// Of stars whose sectors are all agreed: takes the triangles of `points` away and fills the loops that are
/// left. Their number.
std::size_t fill_without(Draft& draft, const std::vector<std::uint32_t>& points);

}  // namespace palpate::stars
