// Where one curvature ends and another begins, as that of a rounded edge beside a flat face: there is no
// crease, and no quadric follows both sides. On clean points two quadrics do that touch along a line.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

struct Seam {
  std::uint32_t before = 0, beyond = 0;  ///< patches of its sides, in the list that they were added to
  Vec3 at = Vec3::Zero();                ///< on the line, mm
  Vec3 across = Vec3::Zero();            ///< unit, along the surface: where it leads is beyond the line
};

struct Seams {
  static constexpr std::uint32_t kNone = 0xffffffffu;
  std::size_t plain = 0;          ///< patches that are no side of a seam: the first ones of the list
  std::vector<std::uint32_t> of;  ///< of each of them: the seam that was found under it, or kNone
  /// Of each of them: of no side, as a seam passes under it and was not found there, or a second one does.
  std::vector<std::uint8_t> crossed;
  std::vector<Seam> all;
};

/// Whether a seam is along the line of another one: the same way to 12 degrees, and not far off it.
[[nodiscard]] bool along_line(const Seam& line, const Seam& seam, double spacing);

/// Looks for seams under the patches that clean points kept small, and adds the patches of their sides to the
/// list. `none`: looks for none. The same for any number of threads. O(patches).
[[nodiscard]] Seams find_seams(const SmoothPoints& points, std::vector<Patch>& patches, bool none,
                               int threads);

}  // namespace palpate::render
