#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "baselines/points/dynamic_grid.h"
#include "baselines/points/near_points.h"
#include "baselines/points/rival.h"
#include "baselines/points/shell_walk.h"
#include "baselines/renderers/depth_rebuild.h"
#include "baselines/rivals.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {
namespace {

/// Bytes a point that a grid needs to follow points: two links and a bit, and its cells' lists.
constexpr double kFollowBytes = 9.0;

/// Cells to the farthest pixel that is kept. The grid has at most 2^21 cells a side, and one false depth
/// beyond them would make all cells larger.
constexpr double kFarthestCells = 1 << 19;

/// True if each point has radii of its own, by the spacing around it; reports it to `out`.
bool has_local_radii(const Options& options, const Gaps& gaps, bool points_move,
                     render::ModelDecisions& out) {
  const std::string asked = options.text("radii");
  const bool local = asked == "local" || (asked == "auto" && density_changes(gaps) && !points_move);
  const char* why = "the points have one density";
  if (asked != "auto")
    why = "as given";
  else if (local)
    why = "the density changes: one size would be too small in places or too large in others";
  else if (points_move)
    why = "points move, and their density with them";
  out.decisions.push_back({"radii", local ? "local" : "one", why, asked != "auto"});
  return local;
}

class StreamProxy : public ShellRival<DynamicGrid> {
 public:
  static constexpr RivalText kText{
      "stream-proxy", "a proxy steered by the points near it; not prepared",
      "Ryden and Chizeck 2013, from public descriptions; flights by segment, tapered weights, offset: ours",
      1.7, 496.0};
  static constexpr bool kFollowsPoints = true;
  static std::vector<OptionSpec> specs() {
    return {
        option::number("r1", "1.5", "nearer points push the proxy out (entrenched), in mean spacings", 0.1,
                       32.0),
        option::number("r2", "2", "nearer points are touched, in mean spacings; above r1", 0.1, 32.0),
        option::number("r3", "3", "nearer points give the normal, in mean spacings; at least r2", 0.1, 32.0),
        option::number("spacing_mm", "0", "what stands for the mean spacing, in mm; 0: measured", 0.0, 1e12),
        option::choice("radii", "auto",
                       "one: the same everywhere, by what closes the gaps; local: by the spacing around each "
                       "point, as variable-proxy's; auto: local where the density changes and no point moves",
                       {"auto", "one", "local"}, {{"spacing_mm", {"0"}}}),
        option::choice("weights", "tapered",
                       "of the points within r3: equal, as in the source, or falling to 0 at r3",
                       {"tapered", "equal"}),
        offset_spec(),
        shell_steps_spec(),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    double spacing = options.number("spacing_mm");
    if (spacing > 0.0) {
      report_spacing(spacing, out);
    } else {
      gaps_ = measured_gaps(*input.cloud, context, report, &out);
      local_ = has_local_radii(options, gaps_, input.moves != nullptr || input.camera != nullptr, out);
      range_ = spacing_range(gaps_, kUsualRatio);
      spacing = local_ ? gaps_.spacing_mm : gaps_.closing_mm();
    }
    shells_.r1 = options.number("r1") * spacing;
    shells_.r2 = options.number("r2") * spacing;
    shells_.r3 = options.number("r3") * spacing;
    if (!(shells_.r1 < shells_.r2 && shells_.r2 <= shells_.r3))
      return Error{fmt::format("stream-proxy needs r1 < r2 <= r3, not {} {} {}", options.text("r1"),
                               options.text("r2"), options.text("r3")),
                   "choose for example r1=1:r2=2:r3=3"};
    shells_.tapered = options.text("weights") == "tapered";
    take_options(options);
    out.decisions.push_back(
        {"shells",
         fmt::format(
             "{:.4g}, {:.4g} and {:.4g} mm{}", shells_.r1, shells_.r2, shells_.r3,
             local_ ? fmt::format(", times {:.3g} to {:.3g}", range_.least, range_.most) : std::string()),
         "nearer than the first pushes out, than the second is touched, than the third gives the normal"});
    out.decisions.push_back(shells_.tapered
                                ? render::Decision{"weights", "tapered", "points fade in and out"}
                                : render::Decision{"weights", "equal", "as given: the source's", true});
    out.decisions.push_back(offset_decision(felt_offset_));
    report_grid(*input.cloud, spacing, shells_.r3, out);
    // The grid follows points that move. Their places are kept only if some do.
    if (input.camera != nullptr && local_)
      return Error{"stream-proxy has one radius where images replace the points", "leave out radii=local"};
    out.decisions.push_back(
        input.camera != nullptr
            ? render::Decision{"points that move", "replaced", "a grid is made of every image", true}
        : input.moves != nullptr
            ? render::Decision{"points that move", "followed", "the scene moves them", true}
            : render::Decision{"points that move", "none", "the scene moves none"});
    out.bytes += static_cast<std::uint64_t>(kFollowBytes * static_cast<double>(out.points)) +
                 (input.moves != nullptr ? sizeof(std::uint32_t) * out.points : 0) +
                 (local_ ? sizeof(float) * out.points : 0) + NearPoints<Grid>::bytes_for(local_);
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    const auto build_for = [&](const cloud::Cloud& cloud) -> Status {
      std::vector<float> scale;
      if (local_) {
        PALPATE_ASSIGN(scale, local_spacings(cloud, gaps_, range_, given.context, given.report));
      }
      render::PreparePhases phases(given.report, given.context);
      phases.begin("grid");
      build(cloud, scale, given.context.threads);
      phases.end();
      return Done{};
    };
    PALPATE_TRY(build_for(*input.cloud));
    // Points that are moved from outside all stay. Only the least of local radii may have too many points
    // within reach; the others grow with the gaps.
    const double reach_mm = walk_->reach_mm(scales_.least);
    if (input.moves == nullptr && input.camera == nullptr &&
        may_be_too_many(points_.grid.statistics().max_points, points_.cell_mm(), reach_mm)) {
      const Thinned thin = thinned_to_reach(input.cloud, scales_.least * shells_.r1, reach_mm, report);
      if (thin.cell_mm > 0.0) PALPATE_TRY(build_for(*thin.cloud));
    }
    if (input.moves != nullptr) {
      moves_ = input.moves->subscribe();
      original_ = input.cloud;
      place_of_.resize(input.cloud->size());
      const auto order = points_.grid.order();
      for (std::uint32_t i = 0; i < order.size(); ++i) place_of_[order[i]] = i;
    }
    if (input.camera != nullptr)
      images_ = std::make_unique<DepthRebuild<ImagePoints>>(
          input, input.cloud->origin_mm,
          [cell_mm = shells_.r3](const DepthPatch& patch) { return points_of(patch, cell_mm); });
    points_.grid.drop_order();
    report.bytes += bytes() + place_of_.capacity() * sizeof(std::uint32_t);
    report.notes.push_back(fmt::format(
        "r1 {:.4g} mm, r2 {:.4g} mm, r3 {:.4g} mm{}, at most {} points a cell", shells_.r1, shells_.r2,
        shells_.r3,
        local_ ? fmt::format(", times {:.3g} to {:.3g}", scales_.least, scales_.most) : std::string(),
        points_.grid.statistics().max_points));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "at most {} steps over at most {} points at hand, found in {} each time the proxy is half {} r1 "
        "further; flights of at most {} pieces of {:.0f} cells{}",
        walk_steps_, kMaxNear, local_ ? "the cells within the largest r3" : "at most 64 cells",
        local_ ? "the smallest" : "an", kMaxPieces, kPieceCells,
        images_ != nullptr ? ", three more with a new image" : "");
  }

  [[nodiscard]] stream::DepthReceiver* depth_receiver() noexcept { return images_.get(); }

  void restart(const Vec3& h) noexcept {
    (void)take_image(h);
    if (moved_) {
      // Every point returns to where it was prepared, in O(n).
      for (std::uint32_t i = 0; i < place_of_.size(); ++i) {
        surface::OrientedPoint& point = points_.points[place_of_[i]];
        const Vec3f to(original_->x_mm[i], original_->y_mm[i], original_->z_mm[i]);
        const Vec3f from(point.x_mm, point.y_mm, point.z_mm);
        if (points_.grid.move(place_of_[i], from, to) == MoveStatus::kFull)
          continue;  // cannot be: it was there before
        point = {to.x(), to.y(), to.z(), surface::kNoNormal};
      }
      moved_ = false;
    }
    release_contact(h);
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    if (take_image(h)) ++counters.swaps;
    take_moves();
    return walk(h, counters);
  }

 private:
  using Grid = DynamicGrid;
  struct ImagePoints {
    PointsIn<Grid> points;
    Vec3 camera_mm = Vec3::Zero();
    double match_per_depth = 0.0;  ///< see kMatchPixels
  };
  /// The measured pixels of a patch in a grid; empty where there are none. One thread, beside the servo's.
  static std::shared_ptr<ImagePoints> points_of(const DepthPatch& patch, double cell_mm) {
    cloud::Cloud cloud;
    const std::size_t most =
        static_cast<std::size_t>(patch.window.columns()) * static_cast<std::size_t>(patch.window.rows());
    for (auto* axis : {&cloud.x_mm, &cloud.y_mm, &cloud.z_mm}) axis->reserve(most);
    for (int row = patch.window.first_row; row < patch.window.last_row; ++row)
      for (int column = patch.window.first_column; column < patch.window.last_column; ++column) {
        const std::size_t pixel = patch.rays.index(column, row);
        const double depth_mm = patch.depth_mm(pixel);
        if (!(depth_mm > 0.0 && depth_mm < kFarthestCells * cell_mm)) continue;
        const Vec3f at = patch.at(pixel, depth_mm).cast<float>();
        cloud.x_mm.push_back(at.x());
        cloud.y_mm.push_back(at.y());
        cloud.z_mm.push_back(at.z());
      }
    search::PartitionOptions grid;
    grid.cell_mm = cell_mm;
    auto made = std::make_shared<ImagePoints>();
    made->points = build_points_in<Grid>(cloud, grid, 1);
    made->points.grid.drop_order();
    made->camera_mm = patch.camera_mm;
    made->match_per_depth = kMatchPixels / patch.rays.camera().fx_px;
    return made;
  }
  /// Takes the newest image's points; true if there are new ones. The receiving thread frees the exchanged
  /// one.
  bool take_image(const Vec3& h) noexcept {
    if (images_ == nullptr || !images_->take()) return false;
    ImagePoints* const newest = images_->newest();
    if (newest == nullptr) {
      walk_->use(points_);
      return true;
    }
    walk_->go_before(newest->points, newest->camera_mm,
                     newest->match_per_depth * (h - newest->camera_mm).norm());
    std::swap(image_, newest->points);
    walk_->use(image_);
    return true;
  }
  /// Takes the batch of points that moved since the last frame.
  void take_moves() noexcept {
    if (moves_ == nullptr) return;
    const render::MoveBatch* batch = moves_->take();
    if (batch == nullptr) return;
    for (std::uint32_t k = 0; k < batch->count; ++k) {
      const std::uint32_t i = batch->point[k];
      if (i >= place_of_.size()) continue;
      surface::OrientedPoint& point = points_.points[place_of_[i]];
      const Vec3f to = batch->to_mm[k];
      const auto status = points_.grid.move(place_of_[i], Vec3f(point.x_mm, point.y_mm, point.z_mm), to);
      if (status == MoveStatus::kFull || !to.allFinite()) continue;
      point = {to.x(), to.y(), to.z(), surface::kNoNormal};
      moved_ = true;
    }
    walk_->forget();
  }

  bool local_ = false;  ///< each point has radii of its own
  // Of clouds that move.
  std::shared_ptr<render::MoveReader> moves_;
  std::shared_ptr<const cloud::Cloud> original_;
  std::vector<std::uint32_t> place_of_;
  bool moved_ = false;
  // Of streams.
  std::unique_ptr<DepthRebuild<ImagePoints>> images_;
  PointsIn<Grid> image_;  ///< of the image that is felt
};

}  // namespace

render::RendererInfo stream_proxy_info() {
  return rival_info<StreamProxy>();
}

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
