#include "baselines/rivals.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "baselines/points/rival.h"
#include "baselines/points/shell_walk.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {
namespace {

/// The shells in radii, as stream-proxy's defaults.
constexpr double kTouchRadii = 4.0 / 3.0, kNormalRadii = 2.0;

class VariableProxy : public ShellRival<search::UniformGrid> {
 public:
  static constexpr RivalText kText{"variable-proxy", "a ball whose radius follows the density of the points",
                                   "Kumari, Sreeni and Chaudhuri 2013 and 2020, from public descriptions; "
                                   "density by the eighth neighbour, steps, offset: ours",
                                   3.7, 333.0};  // sinusoid of a million
  static std::vector<OptionSpec> specs() {
    return {
        option::number("radius", "1.5", "of the proxy, in local spacings: larger is smoother, and rounder",
                       0.1, 16.0),
        option::number("ratio", "16", "the largest radius over the smallest, at most", 1.0, 64.0),
        offset_spec(),
        shell_steps_spec(),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    gaps_ = measured_gaps(*input.cloud, context, report, &out);
    range_ = spacing_range(gaps_, options.number("ratio"));
    const double radius = options.number("radius") * gaps_.spacing_mm;
    shells_ = {radius, kTouchRadii * radius, kNormalRadii * radius, true};
    take_options(options);
    out.decisions.push_back({"proxy",
                             fmt::format("{:.4g} to {:.4g} mm", range_.least * radius, range_.most * radius),
                             fmt::format("{:.3g} local spacings, by the {}", options.number("radius"),
                                         gaps_.lines ? "nearest in eight directions" : "eighth neighbour")});
    out.decisions.push_back(offset_decision(felt_offset_));
    report_grid(*input.cloud, gaps_.spacing_mm, shells_.r3, out);
    out.bytes += sizeof(float) * out.points + NearPoints<search::UniformGrid>::bytes_for(true);
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    PALPATE_ASSIGN(const std::vector<float> scale,
                   local_spacings(*input.cloud, gaps_, range_, context, report));
    render::PreparePhases phases(report, context);
    phases.begin("grid");
    build(*input.cloud, scale, context.threads);
    points_.grid.drop_order();
    phases.end();
    report.bytes += bytes();
    report.notes.push_back(
        fmt::format("radii {:.4g} to {:.4g} mm", shells_.r1 * scales_.least, shells_.r1 * scales_.most));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "at most {} steps over at most {} points at hand, found in the cells within the largest radius each "
        "time the proxy is half the smallest further (all their points are looked at: the fullest cell holds "
        "{}); flights of at most {} pieces of {:.0f} cells",
        walk_steps_, kMaxNear, points_.points.empty() ? 0 : points_.grid.max_points_per_cell(), kMaxPieces,
        kPieceCells);
  }

  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    return walk(h, counters);
  }
};

}  // namespace

render::RendererInfo variable_proxy_info() {
  return rival_info<VariableProxy>();
}

}  // namespace palpate::baselines
