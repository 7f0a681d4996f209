#include "baselines/rivals.h"

#include <fmt/format.h>

#include <cmath>

#include <palpate/result.h>
#include "baselines/points/point_grid.h"
#include "baselines/points/rival.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {
namespace {

/// Number of voxels that are searched: the one of the HIP, or that with its neighbours.
constexpr std::uint32_t kOwnVoxel = 1, kAllVoxels = 27;

class PenaltyGrid : public RivalModel {
 public:
  static constexpr RivalText kText{
      "penalty-grid", "a push away from the points nearer than a threshold",
      "US patent [75] by the thesis's section 2.2.3 and table 11; force law ours: k (threshold - distance)",
      0.78, 436.0};
  static constexpr bool kGodObject = false;
  static std::vector<OptionSpec> specs() {
    return {
        option::choice("neighbours", "own",
                       "voxels that are searched: the HIP's own, as printed, or with the 26 around it",
                       {"own", "27"}),
        option::in_spacings("voxel", "16", "edge of a voxel in mean spacings (not printed)", 0.1, 1000.0),
        option::in_mm("voxel"),
        option::in_spacings("threshold", "8", "distance of contact in mean spacings (not printed)", 0.0,
                            1000.0),
        option::in_mm("threshold"),
        option::choice(
            "side", "none",
            "none: no inside test, as printed; outward: depth below the nearest point's plane (ours)",
            {"none", "outward"}),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    const Gaps gaps = measured_gaps(*input.cloud, context, report, &out);
    spacing_mm_ = gaps.spacing_mm;
    neighbours_ = gaps.neighbours();
    voxel_mm_ = option::length_mm(options, "voxel", spacing_mm_);
    threshold_mm_ = option::length_mm(options, "threshold", spacing_mm_);
    voxels_ = options.text("neighbours") == "27" ? kAllVoxels : kOwnVoxel;
    outward_ = options.text("side") == "outward";
    report_grid(*input.cloud, spacing_mm_, voxel_mm_, out);
    out.decisions.push_back({"search", fmt::format("{} voxel{}", voxels_, voxels_ > 1 ? "s" : ""),
                             voxels_ > 1 ? "as given" : "the HIP's own, as printed", voxels_ > 1});
    out.decisions.push_back({"contact", fmt::format("nearer than {:.4g} mm", threshold_mm_),
                             outward_ ? "below the nearest point's plane" : "to the nearest point"});
    if (outward_)
      report_normals(*input.cloud, neighbours_, out);
    else
      out.decisions.push_back({"normals", "none", "no inside test, as printed"});
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    if (outward_) {
      PALPATE_ASSIGN(OrientedGrid built,
                     build_oriented_grid(input, voxel_mm_, neighbours_, false, context, report));
      points_ = std::move(built.points);
    } else {
      phases.begin("voxel grid");
      points_ = build_point_grid(*input.cloud, voxel_mm_, context.threads);
      phases.end();
    }
    report.bytes += points_.bytes();
    report.notes.push_back(
        fmt::format("mean spacing {:.4g} mm: voxel {:.4g} mm, threshold {:.4g} mm, at most {} points a voxel",
                    spacing_mm_, points_.grid.cell_mm(), threshold_mm_, points_.grid.max_points_per_cell()));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "unbounded as printed: all points of {} voxel{}, whatever the cloud (the fullest of the first model "
        "holds {})",
        voxels_, voxels_ == kOwnVoxel ? "" : "s",
        points_.points.empty() ? 0 : points_.grid.max_points_per_cell());
  }

  void release_contact(const Vec3&) noexcept { side_.release(); }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    const Nearest near = nearest(h, counters);
    if (near.place == kNoPlace) {
      side_.release();
      return {};
    }
    const surface::OrientedPoint& point = points_.points[near.place];
    const Vec3 away = h - point.at();
    if (outward_) {
      side_.choose(point.normal, away);
      const Vec3 out = side_.normal(point.normal);
      const double height = out.dot(away);
      if (out != Vec3::Zero())
        return height < threshold_mm_ ? push_along(out, threshold_mm_ - height) : RivalAnswer{};
    }
    const double distance = std::sqrt(near.distance_sq);
    // No direction is away from the point on the point itself.
    if (!(distance < threshold_mm_) || !(distance > 0.0)) return {};
    return push_along(away / distance, threshold_mm_ - distance);
  }

 private:
  struct Nearest {
    std::uint32_t place = kNoPlace;
    double distance_sq = std::numeric_limits<double>::infinity();
  };
  [[nodiscard]] Nearest nearest(const Vec3& h, render::FrameCounters& counters) const noexcept {
    Nearest best;
    const auto look = [&](const search::Cell& cell) {
      ++counters.cells_visited;
      const search::IndexRange range = points_.grid.find(cell);
      for (std::uint32_t i = range.begin; i < range.end; ++i) {
        const double sq = (points_.points[i].at() - h).squaredNorm();
        if (sq < best.distance_sq) best = {i, sq};
      }
    };
    const search::Cell own = points_.grid.cell_of(h);
    if (voxels_ == kOwnVoxel) {
      look(own);
      return best;
    }
    for (std::int64_t z = own.z - 1; z <= own.z + 1; ++z)
      for (std::int64_t y = own.y - 1; y <= own.y + 1; ++y)
        for (std::int64_t x = own.x - 1; x <= own.x + 1; ++x) look({x, y, z});
    return best;
  }
  [[nodiscard]] RivalAnswer push_along(const Vec3& away, double by_mm) const noexcept {
    return {true, false, by_mm * away, surface.stiffness_n_per_mm * by_mm * away};
  }

  PointGrid points_;
  double spacing_mm_ = 0.0, voxel_mm_ = 0.0, threshold_mm_ = 0.0;
  std::uint32_t voxels_ = kOwnVoxel;
  bool outward_ = false;
  std::string neighbours_;  ///< for preparation
  OutwardSide side_;
};

}  // namespace

render::RendererInfo penalty_grid_info() {
  return rival_info<PenaltyGrid>();
}

}  // namespace palpate::baselines
