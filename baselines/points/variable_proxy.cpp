#include "baselines/points/variable_proxy.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "baselines/points/gaps.h"
#include "baselines/points/rival.h"
#include "baselines/points/shell_walk.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// On a square lattice the eighth neighbour is so many spacings off: over it, distances are spacings.
constexpr double kEighthSpacings = 1.4142135623730951;  // sqrt 2
/// The shells in radii: as stream-proxy's defaults.
constexpr double kTouchRadii = 4.0 / 3.0, kNormalRadii = 2.0;
/// The largest local spacing, in units of what closes 99 % of the gaps: with radii of 1.5 it closes gaps
/// nearly twice as wide; what is lonelier is an outlier, or stands at a border.
constexpr double kMostClosing = 1.25;
/// A radius of 1.5 spacings closes even gaps (4/3 spacings) down to this share of it: means may take as much.
constexpr double kStillCloses = kEvenGap / 1.5;
/// Means over neighbours: local spacings then differ from one point to the next by some percent.
constexpr int kSmoothings = 3;

class VariableProxy : public RivalModel {
 public:
  static constexpr RivalText kText{"variable-proxy",
                                   "a spherical proxy whose radius follows the local density of the points",
                                   "Kumari, Sreeni and Chaudhuri 2013 and 2020, from public descriptions; "
                                   "density by the eighth neighbour, "
                                   "steps, offset: ours",
                                   3.7, 333.0};  // sinusoid of a million
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs();
  static Status decide(VariableProxy& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report,
                       render::ModelDecisions& out);
  static Status prepare(VariableProxy& model, const render::ModelInput& input, const Options& options,
                        const render::PrepareContext& context, render::PrepareReport& report);
  [[nodiscard]] std::string work_bound() const;

  void let_go(const Vec3& h) noexcept {
    walk_->let_go(h);
    state.release();
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept;

 private:
  using Grid = partition::UniformGrid;

  PointGrid points_;
  LargeVector<float> scale_;  ///< by place: local spacings over the mean spacing
  std::unique_ptr<ShellWalk<Grid>> walk_;
  Shells shells_;  ///< at scale 1
  bool felt_offset_ = false;
  double least_ = 1.0, most_ = 1.0;  ///< of the scales; this and what follows: for preparation
  double spacing_mm_ = 0.0;
  bool lines_ = false;
};

std::vector<OptionSpec> VariableProxy::specs() {
  using enum OptionKind;
  return {
      {"radius",
       kNumber,
       "1.5",
       "of the proxy, in local spacings: larger is smoother, and rounder",
       {},
       0.1,
       16.0},
      {"ratio", kNumber, "16", "the largest radius over the smallest, at most", {}, 1.0, 64.0},
      offset_spec(),
  };
}

Status VariableProxy::decide(VariableProxy& model, const render::ModelInput& input, const Options& options,
                             const render::PrepareContext& context, render::PrepareReport& report,
                             render::ModelDecisions& out) {
  const Gaps gaps = measured_gaps(*input.cloud, context, report);
  model.spacing_mm_ = gaps.spacing_mm;
  model.lines_ = gaps.lines;
  model.most_ = kMostClosing * gaps.closing_mm() / gaps.spacing_mm;
  // In lines neighbours tell little of the gaps across: nothing is smaller than what closes them.
  model.least_ = gaps.lines ? gaps.closing_mm() / gaps.spacing_mm : model.most_ / options.number("ratio");
  const double radius = options.number("radius") * gaps.spacing_mm;
  model.shells_ = {radius, kTouchRadii * radius, kNormalRadii * radius, true};
  model.felt_offset_ = options.text("offset") == "kept";
  say_gaps(gaps, out);
  out.decisions.push_back({"proxy",
                           fmt::format("{:.4g} to {:.4g} mm", model.least_ * radius, model.most_ * radius),
                           fmt::format("{:.3g} local spacings, by the {}", options.number("radius"),
                                       gaps.lines ? "nearest in eight directions" : "eighth neighbour")});
  out.decisions.push_back(said_offset(model.felt_offset_));
  say_grid(*input.cloud, gaps.spacing_mm, model.shells_.r3, out);
  out.bytes += sizeof(float) * out.points + NearPoints<Grid>::bytes_for(true);
  return Done{};
}

/// The local spacing of every point over the mean one, by the cloud's index: the farthest neighbour's
/// distance, or that of a point that it is a neighbour of: where the density steps, the last of the dense
/// points have dense neighbours alone, and only the sparse ones beyond the gap know of it. Then means, so
/// that radii change slowly, but never so small that a gap opens.
std::vector<float> local_scales(const cloud::Cloud& cloud, const neighbourhood::NeighbourTable& table,
                                double spacing_mm, double least, double most, int threads) {
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
    return std::clamp(scale > 0.0 ? scale : 1.0, least, most);  // alone, or in a pile: the mean
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

Status VariableProxy::prepare(VariableProxy& model, const render::ModelInput& input,
                              const Options& /*options*/, const render::PrepareContext& context,
                              render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  phases.begin("neighbours");
  auto built = neighbourhood::build_neighbours(model.lines_ ? "directional-knn" : "exact-knn", *input.cloud,
                                               context.threads);
  if (!built) return std::move(built).error();
  phases.end();
  phases.begin("radii");
  const std::vector<float> scale =
      local_scales(*input.cloud, built->table, model.spacing_mm_, model.least_, model.most_, context.threads);
  phases.end();
  phases.begin("grid");
  partition::PartitionOptions grid;
  grid.cell_mm = model.shells_.r3;
  model.points_ = build_points_in<Grid>(*input.cloud, grid, context.threads);
  const auto order = model.points_.grid.order();
  model.scale_.resize(scale.size());
  for (std::size_t place = 0; place < order.size(); ++place) model.scale_[place] = scale[order[place]];
  model.points_.grid.drop_order();
  const auto [least, most] = std::minmax_element(scale.begin(), scale.end());
  model.walk_ = std::make_unique<ShellWalk<Grid>>(model.points_, model.shells_, model.scale_,
                                                  static_cast<double>(*least), static_cast<double>(*most));
  phases.end();
  report.bytes += model.points_.bytes() + model.scale_.capacity() * sizeof(float) + model.walk_->bytes();
  report.notes.push_back(fmt::format("radii {:.4g} to {:.4g} mm",
                                     model.shells_.r1 * static_cast<double>(*least),
                                     model.shells_.r1 * static_cast<double>(*most)));
  return Done{};
}

std::string VariableProxy::work_bound() const {
  return fmt::format(
      "at most {} steps over at most {} points at hand, found in the cells within the largest radius each "
      "time the proxy is half the smallest further (all their points are looked at: the fullest cell holds "
      "{}); flights of at most {} pieces of {:.0f} cells",
      kMaxShellSteps, kMaxNear, points_.points.empty() ? 0 : points_.grid.max_points_per_cell(), kMaxPieces,
      kPieceCells);
}

RivalAnswer VariableProxy::update(const Vec3& h, render::FrameCounters& counters) noexcept {
  const bool finished = walk_->walk(h, counters);
  return walk_->answer(h, finished, felt_offset_);
}

}  // namespace

render::RendererInfo variable_proxy_info() {
  return rival_info<VariableProxy>();
}

}  // namespace palpate::baselines
