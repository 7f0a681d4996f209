#include "baselines/points/rivals.h"

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "baselines/points/ball_walk.h"
#include "baselines/points/near_points.h"
#include "baselines/points/rival.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// Edge of the cells in radii; the balls at hand are then found in 27 cells.
constexpr double kCellRadii = 2.0;

class SphereProxy : public RivalModel {
 public:
  static constexpr RivalText kText{
      "sphere-proxy", "every point a ball: a spherical proxy that slides and rests among the points",
      "CHAI3D 3.3's point clouds (cMultiPoint with its finger proxy); Ruspini et al. 1997; exact, ours", 0.97,
      437.0};
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs() {
    return {
        option::in_spacings("radius", "4", "of the proxy, in mean spacings: larger is smoother, and rounder",
                            0.1, 16.0),
        option::in_mm("radius"),
        option::choice("offset", "removed",
                       "the radius by which the proxy stays off the points: removed (the HIP is a point) or "
                       "kept, as in the source (the tool is a sphere)",
                       {"removed", "kept"}),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    const double given_mm = options.number("radius_mm");
    double spacing = 0.0;
    if (!(given_mm > 0.0)) spacing = measured_gaps(*input.cloud, context, report, &out).closing_mm();
    radius_mm_ = option::length_mm(options, "radius", spacing);
    felt_offset_ = options.text("offset") == "kept";
    out.decisions.push_back(
        {"proxy", fmt::format("ball of {:.4g} mm", radius_mm_),
         given_mm > 0.0 ? "as given" : fmt::format("{:.3g} spacings", options.number("radius")),
         given_mm > 0.0});
    out.decisions.push_back(felt_offset_
                                ? render::Decision{"offset", "kept", "as given: the tool is a ball", true}
                                : render::Decision{"offset", "removed", "the HIP is a point"});
    report_grid(*input.cloud, spacing, kCellRadii * radius_mm_, out);
    out.bytes += NearPoints<search::UniformGrid>::bytes_for(false);
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    phases.begin("grid");
    points_ = build_point_grid(*input.cloud, kCellRadii * radius_mm_, context.threads);
    walk_ = std::make_unique<BallWalk>(points_, radius_mm_);
    const auto& grid = points_.grid;
    if (may_be_too_many(grid.max_points_per_cell(), grid.cell_mm(), walk_->reach_mm())) {
      const Thinned thin = thinned_to_reach(input.cloud, radius_mm_, walk_->reach_mm(), report);
      if (thin.cell_mm > 0.0)
        points_ = build_point_grid(*thin.cloud, kCellRadii * radius_mm_, context.threads);
    }
    phases.end();
    report.bytes += points_.bytes() + NearPoints<search::UniformGrid>::bytes_for(false);
    report.notes.push_back(fmt::format("radius {:.4g} mm, cell {:.4g} mm, at most {} points a cell",
                                       radius_mm_, points_.grid.cell_mm(),
                                       points_.grid.max_points_per_cell()));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "at most {} moves among at most {} balls at hand, found in at most 64 cells each time the proxy is "
        "half a radius further; flights of at most {} pieces of {:.0f} cells (the fullest cell holds {} "
        "points)",
        kMaxBallMoves, kMaxNear, kMaxPieces, kPieceCells,
        points_.points.empty() ? 0 : points_.grid.max_points_per_cell());
  }

  void release_contact(const Vec3& h) noexcept {
    walk_->reset(h);
    state.release();
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    const std::uint64_t moves = walk_->moves();
    const bool finished = walk_->go(h);
    counters.walk_steps += walk_->moves() - moves;
    Vec3 pull = walk_->proxy() - h;
    const double length = stable_norm(pull);
    const double felt = felt_offset_ ? length : length - radius_mm_;
    RivalAnswer answer;
    if (felt > 0.0 && walk_->carried_by() > 0) answer = {true, false, pull * (felt / length), Vec3::Zero()};
    answer.bound_hit = !finished;
    return answer;
  }

 private:
  PointGrid points_;
  std::unique_ptr<BallWalk> walk_;
  double radius_mm_ = 0.0;
  bool felt_offset_ = false;
};

}  // namespace

render::RendererInfo sphere_proxy_info() {
  return rival_info<SphereProxy>();
}

}  // namespace palpate::baselines
