#include "baselines/points/vector_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "baselines/points/gaps.h"
#include "baselines/points/outward.h"
#include "baselines/points/rival.h"
#include "baselines/points/sphere_tree.h"
#include "baselines/points/voxel_field.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

constexpr double kBytesPerMb = 1e6;
/// Further sideways from the nearest point than so many spacings (gaps, where those are wider), and than from
/// its plane, a place is beyond the surface's border.
constexpr double kBesideSpacings = 2.0;

class VectorFieldModel : public RivalModel {
 public:
  static constexpr RivalText kText{
      "vector-field", "a force for every place, looked up in a voxel field prepared from the points",
      "vector field mapping, the thesis's section 2.2.2; the field (distance to the points' planes): ours",
      0.07, 42'700.0};
  static constexpr bool kGodObject = false;
  static std::vector<OptionSpec> specs();
  static Status decide(VectorFieldModel& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report,
                       render::ModelDecisions& out);
  static Status prepare(VectorFieldModel& model, const render::ModelInput& input, const Options& options,
                        const render::PrepareContext& context, render::PrepareReport& report);
  [[nodiscard]] std::string work_bound() const { return "one look-up of eight samples"; }

  void let_go(const Vec3&) noexcept {}
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept;

 private:
  VoxelField field_;
  double spacing_mm_ = 0.0;  ///< this and what follows: for preparation
  double beside_mm_ = 0.0;
  std::string neighbours_;
  VoxelFieldOptions wanted_;
};

std::vector<OptionSpec> VectorFieldModel::specs() {
  using enum OptionKind;
  return {
      {"voxel", kNumber, "3", "edge of a voxel in mean spacings", {}, 0.1, 1000.0, {{"voxel_mm", {"0"}}}},
      {"voxel_mm", kNumber, "0", "the same in mm; 0: by voxel", {}, 0.0, 1e12},
      {"depth",
       kNumber,
       "8",
       "the field reaches so many voxels inside; deeper there is no force",
       {},
       1,
       1000.0},
      {"memory_mb", kNumber, "2000", "limit of the field's memory", {}, 0.001, 1e6},
      {"flip", kFlag, "false", "of surfaces with a border: take the other side for outside", {}},
  };
}

/// The nearest point's plane, seen from a place.
class PlaneSampler {
 public:
  PlaneSampler(const PointGrid& points, const SphereTree& tree, double sign, double beside_mm)
      : points_(points), tree_(tree), sign_(sign), beside_sq_(beside_mm * beside_mm) {}

  FieldSample operator()(const Vec3& at, double most, std::uint32_t& hint) const {
    // No further than the point that was nearest to the place before, a rounding added.
    if (hint != kNoPlace) most = std::min(most, (points_.points[hint].at() - at).norm() * (1.0 + gamma(8)));
    const std::uint32_t nearest = tree_.nearest(at, most);
    if (nearest == kNoPlace) return {0.0f, 0.0f, 0.0f, static_cast<float>(most)};
    hint = nearest;
    const surface::SurfacePoint& point = points_.points[hint];
    const Vec3 to = point.at() - at;
    const double distance = to.norm();
    const FieldSample outside{0.0f, 0.0f, 0.0f, static_cast<float>(distance)};
    if (point.normal == surface::kNoNormal) return outside;
    const Vec3 out =
        surface::decode_normal(point.normal) * (surface::is_one_sided(point.normal) ? 1.0 : sign_);
    const double height = -out.dot(to), beside_sq = distance * distance - height * height;
    if (beside_sq > beside_sq_ && beside_sq > height * height) return outside;
    const Vec3f pull = (-height * out).cast<float>();
    return {pull.x(), pull.y(), pull.z(), static_cast<float>(height)};
  }

 private:
  const PointGrid& points_;
  const SphereTree& tree_;
  double sign_, beside_sq_;
};

Status VectorFieldModel::decide(VectorFieldModel& model, const render::ModelInput& input,
                                const Options& options, const render::PrepareContext& context,
                                render::PrepareReport& report, render::ModelDecisions& out) {
  const Gaps gaps = measured_gaps(*input.cloud, context, report);
  model.spacing_mm_ = gaps.spacing_mm;
  model.beside_mm_ = kBesideSpacings * gaps.closing_mm();
  model.neighbours_ = gaps.neighbours();
  VoxelFieldOptions& field = model.wanted_;
  const double given_mm = options.number("voxel_mm");
  field.voxel_mm = given_mm > 0.0 ? given_mm : options.number("voxel") * model.spacing_mm_;
  field.depth_mm = options.number("depth") * field.voxel_mm;
  field.most_bytes = static_cast<std::size_t>(options.number("memory_mb") * kBytesPerMb);
  say_gaps(gaps, out);
  say_normals(*input.cloud, model.neighbours_, out);
  out.decisions.push_back(
      {"field", fmt::format("voxels of {:.4g} mm", field.voxel_mm),
       fmt::format("{:.4g} mm deep, in bricks of {} voxels a side near the surface; at most "
                   "{:.4g} MB, else it is refused",
                   field.depth_mm, kBrickVoxels, options.number("memory_mb"))});
  return Done{};
}

Status VectorFieldModel::prepare(VectorFieldModel& model, const render::ModelInput& input,
                                 const Options& options, const render::PrepareContext& context,
                                 render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  Result<OrientedGrid> built =
      build_oriented_grid(input, 2.0 * model.spacing_mm_, model.neighbours_, false, context, report);
  if (!built) return std::move(built).error();
  const PointGrid& points = built->points;
  phases.begin("sphere tree");
  SphereTree tree;
  tree.build(points.points, context.threads);
  phases.end();
  const VoxelFieldOptions& field = model.wanted_;
  const double sign = open_sign(points.points) * (options.flag("flip") ? -1.0 : 1.0);
  phases.begin("field");
  Result<VoxelField> made =
      VoxelField::build([&](std::size_t i) { return points.points[i].at(); }, points.points.size(),
                        partition::local_box(*input.cloud, context.threads), field,
                        PlaneSampler(points, tree, sign, model.beside_mm_), context.threads);
  if (!made) return std::move(made).error();
  model.field_ = std::move(*made);
  phases.end();
  report.bytes += model.field_.bytes();
  report.notes.push_back(fmt::format("voxel {:.4g} mm, {:.4g} mm deep, {} bricks, {:.1f} MB", field.voxel_mm,
                                     field.depth_mm, model.field_.bricks(),
                                     static_cast<double>(model.field_.bytes()) / kBytesPerMb));
  return Done{};
}

RivalAnswer VectorFieldModel::update(const Vec3& h, render::FrameCounters& counters) noexcept {
  ++counters.cells_visited;
  const VoxelField::Value value = field_.at(h);
  if (!value.known || !(value.distance < 0.0)) return {};
  return push(value.to_surface);
}

}  // namespace

render::RendererInfo vector_field_info() {
  return rival_info<VectorFieldModel>();
}

}  // namespace palpate::baselines
