#include "baselines/points/rivals.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <palpate/result.h>
#include "baselines/points/point_grid.h"
#include "baselines/points/rival.h"
#include "baselines/points/sphere_tree.h"
#include "baselines/points/voxel_field.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

constexpr double kBytesPerMb = 1e6;
/// A place is beyond the surface's border if it is so many spacings (or gaps, if wider) sideways from the
/// nearest point, and further than from its plane.
constexpr double kBesideSpacings = 2.0;

/// The nearest point's plane, seen from a place.
class PlaneSampler {
 public:
  PlaneSampler(const PointGrid& points, const SphereTree& tree, double sign, double beside_mm)
      : points_(points), tree_(tree), sign_(sign), beside_sq_(beside_mm * beside_mm) {}

  FieldSample operator()(const Vec3& at, double most, std::uint32_t& hint) const {
    // The search goes no further than the point that was nearest to the place before, a rounding added.
    if (hint != kNoPlace) most = std::min(most, (points_.points[hint].at() - at).norm() * (1.0 + gamma(8)));
    const std::uint32_t nearest = tree_.nearest(at, most);
    if (nearest == kNoPlace) return {0.0f, 0.0f, 0.0f, static_cast<float>(most)};
    hint = nearest;
    const surface::OrientedPoint& point = points_.points[hint];
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

class VectorFieldModel : public RivalModel {
 public:
  static constexpr RivalText kText{
      "vector-field", "a force for every place, looked up in a voxel field prepared from the points",
      "vector field mapping, the thesis's section 2.2.2; the field (distance to the points' planes): ours",
      0.07, 42'700.0};
  static constexpr bool kGodObject = false;
  static std::vector<OptionSpec> specs() {
    return {
        option::in_spacings("voxel", "3", "edge of a voxel in mean spacings", 0.1, 1000.0),
        option::in_mm("voxel"),
        option::number("depth", "8", "the field reaches so many voxels inside; deeper there is no force", 1,
                       1000.0),
        option::number("memory_mb", "2000", "limit of the field's memory", 0.001, 1e6),
        option::flag("flip", "false", "of surfaces with a border: take the other side for outside"),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    const Gaps gaps = measured_gaps(*input.cloud, context, report, &out);
    spacing_mm_ = gaps.spacing_mm;
    beside_mm_ = kBesideSpacings * gaps.closing_mm();
    neighbours_ = gaps.neighbours();
    VoxelFieldOptions& field = wanted_;
    field.voxel_mm = option::length_mm(options, "voxel", spacing_mm_);
    field.depth_mm = options.number("depth") * field.voxel_mm;
    field.most_bytes = static_cast<std::size_t>(options.number("memory_mb") * kBytesPerMb);
    report_normals(*input.cloud, neighbours_, out);
    out.decisions.push_back({"field", fmt::format("voxels of {:.4g} mm", field.voxel_mm),
                             fmt::format("{:.4g} mm deep, in bricks of {} voxels a side near the surface; at "
                                         "most {:.4g} MB, else it is refused",
                                         field.depth_mm, kBrickVoxels, options.number("memory_mb"))});
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    PALPATE_ASSIGN(OrientedGrid built,
                   build_oriented_grid(input, 2.0 * spacing_mm_, neighbours_, false, context, report));
    const PointGrid& points = built.points;
    phases.begin("sphere tree");
    SphereTree tree;
    tree.build(points.points, context.threads);
    phases.end();
    const VoxelFieldOptions& field = wanted_;
    const double sign = open_sign(points.points) * (options.flag("flip") ? -1.0 : 1.0);
    phases.begin("field");
    Result<VoxelField> made =
        VoxelField::build([&](std::size_t i) { return points.points[i].at(); }, points.points.size(),
                          search::local_box(*input.cloud, context.threads), field,
                          PlaneSampler(points, tree, sign, beside_mm_), context.threads);
    if (!made) return std::move(made).error();
    field_ = std::move(*made);
    phases.end();
    report.bytes += field_.bytes();
    report.notes.push_back(fmt::format("voxel {:.4g} mm, {:.4g} mm deep, {} bricks, {:.1f} MB",
                                       field.voxel_mm, field.depth_mm, field_.bricks(),
                                       static_cast<double>(field_.bytes()) / kBytesPerMb));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const { return "one look-up of eight samples"; }

  void release_contact(const Vec3&) noexcept {}
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    ++counters.cells_visited;
    const VoxelField::Value value = field_.at(h);
    if (!value.known || !(value.distance < 0.0)) return {};
    return push(value.to_surface);
  }

 private:
  VoxelField field_;
  double spacing_mm_ = 0.0;  ///< this and what follows: for preparation
  double beside_mm_ = 0.0;
  std::string neighbours_;
  VoxelFieldOptions wanted_;
};

}  // namespace

render::RendererInfo vector_field_info() {
  return rival_info<VectorFieldModel>();
}

}  // namespace palpate::baselines
