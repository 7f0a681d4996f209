#include "baselines/points/variable_proxy.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "baselines/points/gaps.h"
#include "baselines/points/local_spacing.h"
#include "baselines/points/rival.h"
#include "baselines/points/shell_walk.h"
#include "toolkit/core/try.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// The shells in radii: as stream-proxy's defaults.
constexpr double kTouchRadii = 4.0 / 3.0, kNormalRadii = 2.0;

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
  PlacedScales scales_;  ///< local spacings over the mean spacing
  std::unique_ptr<ShellWalk<Grid>> walk_;
  Shells shells_;  ///< at scale 1
  bool felt_offset_ = false;
  int walk_steps_ = kMaxShellSteps;
  SpacingRange range_;  ///< of the scales; this and what follows: for preparation
  Gaps gaps_;
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
      shell_steps_spec(),
  };
}

Status VariableProxy::decide(VariableProxy& model, const render::ModelInput& input, const Options& options,
                             const render::PrepareContext& context, render::PrepareReport& report,
                             render::ModelDecisions& out) {
  model.gaps_ = measured_gaps(*input.cloud, context, report);
  const Gaps& gaps = model.gaps_;
  model.range_ = spacing_range(gaps, options.number("ratio"));
  const double radius = options.number("radius") * gaps.spacing_mm;
  model.shells_ = {radius, kTouchRadii * radius, kNormalRadii * radius, true};
  model.felt_offset_ = options.text("offset") == "kept";
  model.walk_steps_ = static_cast<int>(options.integer("walk_steps"));
  say_gaps(gaps, out);
  out.decisions.push_back(
      {"proxy", fmt::format("{:.4g} to {:.4g} mm", model.range_.least * radius, model.range_.most * radius),
       fmt::format("{:.3g} local spacings, by the {}", options.number("radius"),
                   gaps.lines ? "nearest in eight directions" : "eighth neighbour")});
  out.decisions.push_back(said_offset(model.felt_offset_));
  say_grid(*input.cloud, gaps.spacing_mm, model.shells_.r3, out);
  out.bytes += sizeof(float) * out.points + NearPoints<Grid>::bytes_for(true);
  return Done{};
}

Status VariableProxy::prepare(VariableProxy& model, const render::ModelInput& input,
                              const Options& /*options*/, const render::PrepareContext& context,
                              render::PrepareReport& report) {
  PALPATE_ASSIGN(const std::vector<float> scale,
                 local_spacings(*input.cloud, model.gaps_, model.range_, context, report));
  render::PreparePhases phases(report, context);
  phases.begin("grid");
  partition::PartitionOptions grid;
  grid.cell_mm = model.shells_.r3;
  model.points_ = build_points_in<Grid>(*input.cloud, grid, context.threads);
  model.scales_ = placed_scales(scale, model.points_.grid.order());
  model.points_.grid.drop_order();
  const auto [least, most] = std::pair(model.scales_.least, model.scales_.most);
  model.walk_ =
      std::make_unique<ShellWalk<Grid>>(model.points_, model.shells_, model.scales_.by_place, least, most);
  model.walk_->bound_steps(model.walk_steps_);
  phases.end();
  report.bytes +=
      model.points_.bytes() + model.scales_.by_place.capacity() * sizeof(float) + model.walk_->bytes();
  report.notes.push_back(
      fmt::format("radii {:.4g} to {:.4g} mm", model.shells_.r1 * least, model.shells_.r1 * most));
  return Done{};
}

std::string VariableProxy::work_bound() const {
  return fmt::format(
      "at most {} steps over at most {} points at hand, found in the cells within the largest radius each "
      "time the proxy is half the smallest further (all their points are looked at: the fullest cell holds "
      "{}); flights of at most {} pieces of {:.0f} cells",
      walk_steps_, kMaxNear, points_.points.empty() ? 0 : points_.grid.max_points_per_cell(), kMaxPieces,
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
