// How far apart points are from place to place: what proxies whose size follows the density are scaled by.
#pragma once

#include <span>
#include <vector>

#include "baselines/points/gaps.h"

namespace palpate::baselines {

/// Up to so many mean spacings the gap that 1 % exceed says that a cloud has one density: points at random
/// have 1.4 to 1.5, scan lines 8:1 1.64. Beyond it there are sparse places among dense ones (the Stanford
/// dragon 2.04, one half 16 times as dense 2.7), and one radius is too small for these or too large for
/// those.
inline constexpr double kOneDensityGap = 1.75;
/// Of scan lines neighbours tell nothing of the gap to the next line.
[[nodiscard]] inline bool density_changes(const Gaps& gaps) noexcept {
  return !gaps.lines && gaps.gap_mm > kOneDensityGap * gaps.spacing_mm;
}

/// Local spacings over the mean one, between these.
struct SpacingRange {
  double least = 1.0, most = 1.0;
};
/// `ratio`: the largest over the smallest, at most. In lines nothing is smaller than what closes the gaps
/// across.
[[nodiscard]] SpacingRange spacing_range(const Gaps& gaps, double ratio) noexcept;
inline constexpr double kUsualRatio = 16.0;

/// The local spacing of every point over the mean one, by the cloud's index: the farthest neighbour's
/// distance (the eighth's over the root of 2; in lines, of the nearest in eight directions), or that of a
/// point that it is a neighbour of, then means, so that radii change slowly, but never so small that a gap
/// opens. The same for any number of threads. O(n log n).
[[nodiscard]] Result<std::vector<float>> local_spacings(const cloud::Cloud& cloud, const Gaps& gaps,
                                                        const SpacingRange& range,
                                                        const render::PrepareContext& context,
                                                        render::PrepareReport& report);

/// Local radii: scales by place, and their ends. Without any all are 1.
struct PlacedScales {
  LargeVector<float> by_place;
  double least = 1.0, most = 1.0;
};
/// `order`: of a grid of the cloud that `scale` is of.
[[nodiscard]] PlacedScales placed_scales(std::span<const float> scale, std::span<const std::uint32_t> order);

}  // namespace palpate::baselines
