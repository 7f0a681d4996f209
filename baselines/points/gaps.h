// The size of gaps between points. Rivals' radii must exceed it, so that nothing falls through an uneven
// cloud; a mean spacing is not enough: random points have gaps three times a lattice's, scan lines and
// density steps wider ones.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "baselines/points/point_grid.h"

namespace palpate::baselines {

/// Up to this many mean spacings a cloud counts as even. Gaps: 0.71 spacings on a square lattice, 1 jittered
/// or as blue noise, 1.26 at rims of thin plates, all closed by rivals' radii of 1.5 and more; 1.4 to 1.5 at
/// random, at most 2.5 among 10^7 points.
inline constexpr double kEvenGap = 4.0 / 3.0;

struct Gaps {
  double spacing_mm = 0.0;  ///< natural_spacing_mm()
  /// The gap that 1 % of the surface exceeds: the radius of an empty circle between points, in the local
  /// plane. 0 if no point is surrounded.
  double gap_mm = 0.0;
  bool lines = false;  ///< most points have their nearest eight in one line: scan lines

  /// Stands for the spacing where a proxy must not fall through: the mean spacing, or the gap if over
  /// kEvenGap of them.
  [[nodiscard]] double closing_mm() const noexcept {
    return gap_mm > kEvenGap * spacing_mm ? gap_mm : spacing_mm;
  }
  /// Neighbours for plane fits: the eight nearest, or for scan lines the nearest in each of eight directions.
  [[nodiscard]] std::string neighbours() const { return lines ? "directional-knn" : "auto"; }
};

/// Samples at most kGapSamples points, even by area. Independent of the points' order and the number of
/// threads. O(n).
[[nodiscard]] Gaps measure_gaps(const cloud::Cloud& cloud, int threads);

/// The same as a timed phase; `out`, if given, gets the spacing and what stands for it.
[[nodiscard]] Gaps measured_gaps(const cloud::Cloud& cloud, const render::PrepareContext& context,
                                 render::PrepareReport& report, render::ModelDecisions* out = nullptr);

/// A larger gap at 1 %, in mean spacings, means varying density: random points have 1.4 to 1.5, scan lines
/// 8:1 1.64, the Stanford dragon 2.04, a half 16 times as dense 2.7. One radius is then too small or too
/// large somewhere.
inline constexpr double kOneDensityGap = 1.75;
/// In scan lines neighbours do not show the gap to the next line.
[[nodiscard]] inline bool density_changes(const Gaps& gaps) noexcept {
  return !gaps.lines && gaps.gap_mm > kOneDensityGap * gaps.spacing_mm;
}

/// Bounds on local spacing over the mean one.
struct SpacingRange {
  double least = 1.0, most = 1.0;
};
/// `ratio`: largest allowed ratio of largest to smallest. In lines the lower bound closes the gaps across.
[[nodiscard]] SpacingRange spacing_range(const Gaps& gaps, double ratio) noexcept;
inline constexpr double kUsualRatio = 16.0;

/// Every point's local over mean spacing, by cloud index: the distance of the farthest neighbour (the
/// eighth's over sqrt(2); in lines, of the nearest in eight directions), or that of a point listing it;
/// averaged so that radii change slowly without opening gaps. Independent of the number of threads. O(n log
/// n).
[[nodiscard]] Result<std::vector<float>> local_spacings(const cloud::Cloud& cloud, const Gaps& gaps,
                                                        const SpacingRange& range,
                                                        const render::PrepareContext& context,
                                                        render::PrepareReport& report);

/// Local radii: scales by place, and their extremes. Empty: all 1.
struct PlacedScales {
  LargePageVector<float> by_place;
  double least = 1.0, most = 1.0;
};
/// `order`: of a grid over the cloud of `scale`.
[[nodiscard]] PlacedScales placed_scales(std::span<const float> scale, std::span<const std::uint32_t> order);

}  // namespace palpate::baselines
