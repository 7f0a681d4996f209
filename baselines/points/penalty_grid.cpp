#include "baselines/points/penalty_grid.h"

#include <fmt/format.h>

#include <cmath>

#include "baselines/points/gaps.h"
#include "baselines/points/outward.h"
#include "baselines/points/point_grid.h"
#include "baselines/points/rival.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// The voxel of the HIP, and with its neighbours.
constexpr std::uint32_t kOwnVoxel = 1, kAllVoxels = 27;

class PenaltyGrid : public RivalModel {
 public:
  static constexpr RivalText kText{
      "penalty-grid", "distance to the points of the HIP's voxel, penalty force below a threshold",
      "US patent [75] by the thesis's section 2.2.3 and table 11; force law ours: k (threshold - distance)",
      0.78, 436.0};
  static constexpr bool kGodObject = false;
  static std::vector<OptionSpec> specs();
  static Status decide(PenaltyGrid& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report,
                       render::ModelDecisions& out);
  static Status prepare(PenaltyGrid& model, const render::ModelInput& input, const Options& options,
                        const render::PrepareContext& context, render::PrepareReport& report);
  [[nodiscard]] std::string work_bound() const;

  void let_go(const Vec3&) noexcept { side_.release(); }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept;

 private:
  struct Nearest {
    std::uint32_t place = kNoPlace;
    double distance_sq = std::numeric_limits<double>::infinity();
  };
  [[nodiscard]] Nearest nearest(const Vec3& h, render::FrameCounters& counters) const noexcept;
  [[nodiscard]] RivalAnswer push_along(const Vec3& away, double by_mm) const noexcept;

  PointGrid points_;
  double spacing_mm_ = 0.0, voxel_mm_ = 0.0, threshold_mm_ = 0.0;
  std::uint32_t voxels_ = kOwnVoxel;
  bool outward_ = false;
  std::string neighbours_;  ///< for preparation
  OutwardSide side_;
};

std::vector<OptionSpec> PenaltyGrid::specs() {
  using enum OptionKind;
  return {
      {"neighbours",
       kChoice,
       "own",
       "voxels that are searched: the HIP's own, as printed, or with the 26 around it",
       {"own", "27"}},
      {"voxel",
       kNumber,
       "16",
       "edge of a voxel in mean spacings (not printed)",
       {},
       0.1,
       1000.0,
       {{"voxel_mm", {"0"}}}},
      {"voxel_mm", kNumber, "0", "the same in mm; 0: by voxel", {}, 0.0, 1e12},
      {"threshold",
       kNumber,
       "8",
       "distance of contact in mean spacings (not printed)",
       {},
       0.0,
       1000.0,
       {{"threshold_mm", {"0"}}}},
      {"threshold_mm", kNumber, "0", "the same in mm; 0: by threshold", {}, 0.0, 1e12},
      {"side",
       kChoice,
       "none",
       "none: no inside test, as printed; outward: depth below the nearest point's plane (ours)",
       {"none", "outward"}},
  };
}

Status PenaltyGrid::decide(PenaltyGrid& model, const render::ModelInput& input, const Options& options,
                           const render::PrepareContext& context, render::PrepareReport& report,
                           render::ModelDecisions& out) {
  const Gaps gaps = measured_gaps(*input.cloud, context, report);
  model.spacing_mm_ = gaps.spacing_mm;
  model.neighbours_ = gaps.neighbours();
  const auto length = [&](const char* in_mm, const char* in_spacings) {
    return options.number(in_mm) > 0.0 ? options.number(in_mm)
                                       : options.number(in_spacings) * model.spacing_mm_;
  };
  model.voxel_mm_ = length("voxel_mm", "voxel");
  model.threshold_mm_ = length("threshold_mm", "threshold");
  model.voxels_ = options.text("neighbours") == "27" ? kAllVoxels : kOwnVoxel;
  model.outward_ = options.text("side") == "outward";
  say_gaps(gaps, out);
  say_grid(*input.cloud, model.spacing_mm_, model.voxel_mm_, out);
  out.decisions.push_back({"search", fmt::format("{} voxel{}", model.voxels_, model.voxels_ > 1 ? "s" : ""),
                           model.voxels_ > 1 ? "as given" : "the HIP's own, as printed", model.voxels_ > 1});
  out.decisions.push_back({"contact", fmt::format("nearer than {:.4g} mm", model.threshold_mm_),
                           model.outward_ ? "below the nearest point's plane" : "to the nearest point"});
  if (model.outward_)
    say_normals(*input.cloud, model.neighbours_, out);
  else
    out.decisions.push_back({"normals", "none", "no inside test, as printed"});
  return Done{};
}

Status PenaltyGrid::prepare(PenaltyGrid& model, const render::ModelInput& input, const Options& /*options*/,
                            const render::PrepareContext& context, render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  if (model.outward_) {
    Result<OrientedGrid> built =
        build_oriented_grid(input, model.voxel_mm_, model.neighbours_, false, context, report);
    if (!built) return std::move(built).error();
    model.points_ = std::move(built->points);
  } else {
    phases.begin("voxel grid");
    model.points_ = build_point_grid(*input.cloud, model.voxel_mm_, context.threads);
    phases.end();
  }
  report.bytes += model.points_.bytes();
  report.notes.push_back(
      fmt::format("mean spacing {:.4g} mm: voxel {:.4g} mm, threshold {:.4g} mm, at most {} points a voxel",
                  model.spacing_mm_, model.points_.grid.cell_mm(), model.threshold_mm_,
                  model.points_.grid.max_points_per_cell()));
  return Done{};
}

std::string PenaltyGrid::work_bound() const {
  return fmt::format(
      "unbounded as printed: all points of {} voxel{}, whatever the cloud (the fullest of the first model "
      "holds {})",
      voxels_, voxels_ == kOwnVoxel ? "" : "s",
      points_.points.empty() ? 0 : points_.grid.max_points_per_cell());
}

PenaltyGrid::Nearest PenaltyGrid::nearest(const Vec3& h, render::FrameCounters& counters) const noexcept {
  Nearest best;
  const auto look = [&](const partition::Cell& cell) {
    ++counters.cells_visited;
    const partition::PlaceRange range = points_.grid.find(cell);
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      const double sq = (points_.points[i].at() - h).squaredNorm();
      if (sq < best.distance_sq) best = {i, sq};
    }
  };
  const partition::Cell own = points_.grid.cell_of(h);
  if (voxels_ == kOwnVoxel) {
    look(own);
    return best;
  }
  for (std::int64_t z = own.z - 1; z <= own.z + 1; ++z)
    for (std::int64_t y = own.y - 1; y <= own.y + 1; ++y)
      for (std::int64_t x = own.x - 1; x <= own.x + 1; ++x) look({x, y, z});
  return best;
}

RivalAnswer PenaltyGrid::push_along(const Vec3& away, double by_mm) const noexcept {
  return {true, false, by_mm * away, surface.stiffness_n_per_mm * by_mm * away};
}

RivalAnswer PenaltyGrid::update(const Vec3& h, render::FrameCounters& counters) noexcept {
  const Nearest near = nearest(h, counters);
  if (near.place == kNoPlace) {
    side_.release();
    return {};
  }
  const surface::SurfacePoint& point = points_.points[near.place];
  const Vec3 away = h - point.at();
  if (outward_) {
    side_.choose(point.normal, away);
    const Vec3 out = side_.normal(point.normal);
    const double height = out.dot(away);
    if (out != Vec3::Zero())
      return height < threshold_mm_ ? push_along(out, threshold_mm_ - height) : RivalAnswer{};
  }
  const double distance = std::sqrt(near.distance_sq);
  // On the point itself no direction is away from it.
  if (!(distance < threshold_mm_) || !(distance > 0.0)) return {};
  return push_along(away / distance, threshold_mm_ - distance);
}

}  // namespace

render::RendererInfo penalty_grid_info() {
  return rival_info<PenaltyGrid>();
}

}  // namespace palpate::baselines
