#include "baselines/points/local_spacing.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/try.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// On a square lattice the eighth neighbour is so many spacings off: over it, distances are spacings.
constexpr double kEighthSpacings = 1.4142135623730951;  // sqrt 2
/// The largest local spacing, in units of what closes 99 % of the gaps: with radii of 1.5 it closes gaps
/// nearly twice as wide; what is lonelier is an outlier, or stands at a border.
constexpr double kMostClosing = 1.25;
/// A radius of 1.5 spacings closes even gaps (4/3 spacings) down to this share of it: means may take as much.
constexpr double kStillCloses = kEvenGap / 1.5;
/// Means over neighbours: local spacings then differ from one point to the next by some percent.
constexpr int kSmoothings = 3;

/// Where the density steps, the last of the dense points have dense neighbours alone, and only the sparse
/// ones beyond the gap know of it: so a point has the largest of those whose neighbour it is, too.
std::vector<float> smoothed_spacings(const cloud::Cloud& cloud, const neighbourhood::NeighbourTable& table,
                                     double spacing_mm, const SpacingRange& range, int threads) {
  const std::size_t n = cloud.size();
  std::vector<float> own(n), mean(n);
  const auto each = [&](std::vector<float>& out, const auto& value) {
    parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) out[i] = static_cast<float>(value(i));
    });
  };
  each(own, [&](std::size_t i) {
    double most_sq = 0.0;
    for (const std::uint32_t other : table.of[i])
      most_sq = std::max(most_sq, (cloud.local_mm(other) - cloud.local_mm(i)).squaredNorm());
    const double scale = std::sqrt(most_sq) / (kEighthSpacings * spacing_mm);
    return std::clamp(scale > 0.0 ? scale : 1.0, range.least, range.most);  // alone, or in a pile: the mean
  });
  std::vector<float> largest = own;
  for (std::size_t i = 0; i < n; ++i)
    for (const std::uint32_t other : table.of[i]) largest[other] = std::max(largest[other], own[i]);
  std::vector<float> smooth = largest;
  for (int round = 0; round < kSmoothings; ++round) {
    each(mean, [&](std::size_t i) {
      double sum = static_cast<double>(smooth[i]);
      for (const std::uint32_t other : table.of[i]) sum += static_cast<double>(smooth[other]);
      return std::max(kStillCloses * static_cast<double>(largest[i]),
                      sum / static_cast<double>(table.of[i].size() + 1));
    });
    smooth.swap(mean);
  }
  return smooth;
}

}  // namespace

SpacingRange spacing_range(const Gaps& gaps, double ratio) noexcept {
  const double closing = gaps.closing_mm() / gaps.spacing_mm, most = kMostClosing * closing;
  return {gaps.lines ? closing : most / ratio, most};
}

Result<std::vector<float>> local_spacings(const cloud::Cloud& cloud, const Gaps& gaps,
                                          const SpacingRange& range, const render::PrepareContext& context,
                                          render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  phases.begin("neighbours");
  PALPATE_ASSIGN(const auto built, neighbourhood::build_neighbours(
                                       gaps.lines ? "directional-knn" : "exact-knn", cloud, context.threads));
  phases.end();
  phases.begin("radii");
  std::vector<float> scale = smoothed_spacings(cloud, built.table, gaps.spacing_mm, range, context.threads);
  phases.end();
  return scale;
}

PlacedScales placed_scales(std::span<const float> scale, std::span<const std::uint32_t> order) {
  PlacedScales placed;
  if (scale.empty()) return placed;
  placed.by_place.resize(scale.size());
  for (std::size_t place = 0; place < order.size(); ++place) placed.by_place[place] = scale[order[place]];
  const auto [least, most] = std::minmax_element(scale.begin(), scale.end());
  placed.least = static_cast<double>(*least);
  placed.most = static_cast<double>(*most);
  return placed;
}

}  // namespace palpate::baselines
