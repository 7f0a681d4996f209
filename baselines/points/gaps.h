// How large the gaps between points are: what the radii of rivals must exceed, so that nothing falls through
// an uneven cloud. A mean spacing does not tell: points strewn at random leave gaps three times as wide as a
// lattice with the same mean, scan lines and steps in density wider ones.
#pragma once

#include <string>

#include "baselines/points/point_grid.h"

namespace palpate::baselines {

/// Up to so many mean spacings a cloud counts as even. On a square lattice the gap is 0.71 spacings, jittered
/// or as blue noise 1, around the rims of a thin plate 1.26; rivals' radii are 1.5 spacings and more, and
/// close these. At random it is 1.4 to 1.5; the largest gap of 10^7 such points is 2.5 spacings.
inline constexpr double kEvenGap = 4.0 / 3.0;

struct Gaps {
  double spacing_mm = 0.0;  ///< natural_spacing_mm()
  /// The gap that 1 % of the surface's parts exceed: a gap is the radius of an empty circle between points,
  /// in the plane of the points around. 0 where no point is surrounded by others.
  double gap_mm = 0.0;
  bool lines = false;  ///< most points have their nearest eight in one line: a scanner's

  /// What stands for the spacing where a proxy must not fall between points: the mean spacing, or the gap
  /// where that is more than kEvenGap of them.
  [[nodiscard]] double closing_mm() const noexcept {
    return gap_mm > kEvenGap * spacing_mm ? gap_mm : spacing_mm;
  }
  /// How the neighbours are found that planes are fitted to: the eight nearest, or, where these are in one
  /// line, the nearest in each of eight directions.
  [[nodiscard]] std::string neighbours() const { return lines ? "directional-knn" : "auto"; }
};

/// Asks at most kGapSamples points, evenly by area. Independent of the order of the points, the same for any
/// number of threads. O(n).
[[nodiscard]] Gaps measure_gaps(const cloud::Cloud& cloud, int threads);

/// The same, timed as a phase and said: the spacing, and what stands for it.
[[nodiscard]] Gaps measured_gaps(const cloud::Cloud& cloud, const render::PrepareContext& context,
                                 render::PrepareReport& report);
void say_gaps(const Gaps& gaps, render::ModelDecisions& out);

}  // namespace palpate::baselines
