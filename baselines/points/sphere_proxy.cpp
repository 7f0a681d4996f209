#include "baselines/points/sphere_proxy.h"

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "baselines/points/ball_walk.h"
#include "baselines/points/gaps.h"
#include "baselines/points/rival.h"
#include "baselines/points/thinned.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// Cells of two radii: the balls at hand are then found in 27 of them.
constexpr double kCellRadii = 2.0;

class SphereProxy : public RivalModel {
 public:
  static constexpr RivalText kText{
      "sphere-proxy", "every point a ball: a spherical proxy that slides and rests among the points",
      "CHAI3D 3.3's point clouds (cMultiPoint with its finger proxy); Ruspini et al. 1997; exact, ours", 0.97,
      437.0};
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs();
  static Status decide(SphereProxy& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report,
                       render::ModelDecisions& out);
  static Status prepare(SphereProxy& model, const render::ModelInput& input, const Options& options,
                        const render::PrepareContext& context, render::PrepareReport& report);
  [[nodiscard]] std::string work_bound() const;

  void let_go(const Vec3& h) noexcept {
    walk_->reset(h);
    state.release();
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept;

 private:
  PointGrid points_;
  std::unique_ptr<BallWalk> walk_;
  double radius_mm_ = 0.0;
  bool felt_offset_ = false;
};

std::vector<OptionSpec> SphereProxy::specs() {
  using enum OptionKind;
  return {
      {"radius",
       kNumber,
       "4",
       "of the proxy, in mean spacings: larger is smoother, and rounder",
       {},
       0.1,
       16.0,
       {{"radius_mm", {"0"}}}},
      {"radius_mm", kNumber, "0", "the same in mm; 0: by radius", {}, 0.0, 1e12},
      {"offset",
       kChoice,
       "removed",
       "the radius by which the proxy stays off the points: removed (the HIP is a point) or kept, as in the "
       "source (the tool is a sphere)",
       {"removed", "kept"}},
  };
}

Status SphereProxy::decide(SphereProxy& model, const render::ModelInput& input, const Options& options,
                           const render::PrepareContext& context, render::PrepareReport& report,
                           render::ModelDecisions& out) {
  const double given_mm = options.number("radius_mm");
  double spacing = 0.0;
  if (!(given_mm > 0.0)) {
    const Gaps gaps = measured_gaps(*input.cloud, context, report);
    say_gaps(gaps, out);
    spacing = gaps.closing_mm();
  }
  model.radius_mm_ = given_mm > 0.0 ? given_mm : options.number("radius") * spacing;
  model.felt_offset_ = options.text("offset") == "kept";
  out.decisions.push_back(
      {"proxy", fmt::format("ball of {:.4g} mm", model.radius_mm_),
       given_mm > 0.0 ? "as given" : fmt::format("{:.3g} spacings", options.number("radius")),
       given_mm > 0.0});
  out.decisions.push_back(model.felt_offset_
                              ? render::Decision{"offset", "kept", "as given: the tool is a ball", true}
                              : render::Decision{"offset", "removed", "the HIP is a point"});
  say_grid(*input.cloud, spacing, kCellRadii * model.radius_mm_, out);
  out.bytes += NearPoints<partition::UniformGrid>::bytes_for(false);
  return Done{};
}

Status SphereProxy::prepare(SphereProxy& model, const render::ModelInput& input, const Options& /*options*/,
                            const render::PrepareContext& context, render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  phases.begin("grid");
  model.points_ = build_point_grid(*input.cloud, kCellRadii * model.radius_mm_, context.threads);
  model.walk_ = std::make_unique<BallWalk>(model.points_, model.radius_mm_);
  const auto& grid = model.points_.grid;
  if (may_be_too_many(grid.max_points_per_cell(), grid.cell_mm(), model.walk_->reach_mm())) {
    const Thinned thin = thinned_to_reach(input.cloud, model.radius_mm_, model.walk_->reach_mm(), report);
    if (thin.cell_mm > 0.0)
      model.points_ = build_point_grid(*thin.cloud, kCellRadii * model.radius_mm_, context.threads);
  }
  phases.end();
  report.bytes += model.points_.bytes() + NearPoints<partition::UniformGrid>::bytes_for(false);
  report.notes.push_back(fmt::format("radius {:.4g} mm, cell {:.4g} mm, at most {} points a cell",
                                     model.radius_mm_, model.points_.grid.cell_mm(),
                                     model.points_.grid.max_points_per_cell()));
  return Done{};
}

std::string SphereProxy::work_bound() const {
  return fmt::format(
      "at most {} moves among at most {} balls at hand, found in at most 64 cells each time the proxy is "
      "half "
      "a radius further; flights of at most {} pieces of {:.0f} cells (the fullest cell holds {} points)",
      kMaxBallMoves, kMaxNear, kMaxPieces, kPieceCells,
      points_.points.empty() ? 0 : points_.grid.max_points_per_cell());
}

RivalAnswer SphereProxy::update(const Vec3& h, render::FrameCounters& counters) noexcept {
  const std::uint64_t moves = walk_->moves();
  const bool finished = walk_->go(h);
  counters.walk_steps += walk_->moves() - moves;
  Vec3 pull = walk_->proxy() - h;
  const double length = safe_length(pull);
  const double felt = felt_offset_ ? length : length - radius_mm_;
  RivalAnswer answer;
  if (felt > 0.0 && walk_->carried_by() > 0) answer = {true, false, pull * (felt / length), Vec3::Zero()};
  answer.bound_hit = !finished;
  return answer;
}

}  // namespace

render::RendererInfo sphere_proxy_info() {
  return rival_info<SphereProxy>();
}

}  // namespace palpate::baselines
