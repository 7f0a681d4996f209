// How large the gaps between points are: what the radii of rivals must exceed, so that nothing falls through
// an uneven cloud. A mean spacing does not tell: points strewn at random leave gaps three times as wide as a
// lattice with the same mean, scan lines and steps in density wider ones.
#pragma once

#include "baselines/points/point_grid.h"

namespace palpate::baselines {

struct Gaps {
  double spacing_mm = 0.0;  ///< natural_spacing_mm()
  /// The gap that 1 % of the surface's parts exceed: a gap is the radius of an empty circle between points,
  /// in the plane of the points around. 0 where no point is surrounded by others.
  double gap_mm = 0.0;
  bool lines = false;  ///< most points have their nearest eight in one line: a scanner's

  /// What stands for the spacing where a proxy must not fall between points: the mean spacing, or the gap
  /// where that is more. On a square lattice the gap is 0.71 spacings and changes nothing. At random it is
  /// some 1.7: the largest of 10^7 points is then 2.5 spacings, and 1.5 of these units, the least multiple
  /// that any rival uses, are 2.5 too.
  [[nodiscard]] double closing_mm() const noexcept { return gap_mm > spacing_mm ? gap_mm : spacing_mm; }
};

/// Asks at most kGapSamples points, evenly by area. Independent of the order of the points, the same for any
/// number of threads. O(n).
[[nodiscard]] Gaps measure_gaps(const cloud::Cloud& cloud, int threads);

/// The same, timed as a phase and said: the spacing, and what stands for it.
[[nodiscard]] Gaps measured_gaps(const cloud::Cloud& cloud, const render::PrepareContext& context,
                                 render::PrepareReport& report);
void say_gaps(const Gaps& gaps, render::ModelDecisions& out);

}  // namespace palpate::baselines
