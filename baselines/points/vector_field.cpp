#include "baselines/points/vector_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "baselines/points/point_grid.h"
#include "baselines/points/rival.h"
#include "baselines/rivals.h"
#include "toolkit/core/parallel.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {
namespace {

constexpr std::size_t kBricksPerChunk = 4;
constexpr double kVoxelDiagonal = 1.7320508075688772;  // sqrt 3
constexpr std::uint32_t kNoHint = 0xFFFFFFFFu;

Error too_large(double bytes, const VoxelFieldOptions& options) {
  // Bricks follow the surface's area times a depth in voxels: the square of the voxel.
  const double larger = std::sqrt(bytes / static_cast<double>(options.most_bytes));
  return Error{
      fmt::format("the vector field needs {:.0f} MB, over the limit of {:.0f} MB", bytes / 1e6,
                  static_cast<double>(options.most_bytes) / 1e6),
      fmt::format("make the voxels {:.2g} times larger (option voxel), or raise memory_mb", 1.1 * larger)};
}

}  // namespace

Vec3 VoxelField::corner_of(std::size_t index) const noexcept {
  const Vec3 at(static_cast<double>(index % size_[0]), static_cast<double>(index / size_[0] % size_[1]),
                static_cast<double>(index / size_[0] / size_[1]));
  return low_ + at * (kBrickVoxels * voxel_);
}

Result<VoxelField> VoxelField::build(const std::function<Vec3(std::size_t)>& point, std::size_t points,
                                     const geometry::Aabb& box, const VoxelFieldOptions& options,
                                     const Sampler& sample, int threads) {
  VoxelField field;
  field.voxel_ = options.voxel_mm;
  field.per_voxel_ = 1.0 / options.voxel_mm;
  const double brick = kBrickVoxels * options.voxel_mm;
  const double rings = std::ceil(options.depth_mm / brick);
  // The margin is one brick, so that points on the box's border are well inside.
  field.low_ = box.low_mm - Vec3::Constant((rings + 1.0) * brick);
  double all = 1.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double wide = std::floor(box.extent_mm()[axis] / brick) + 2.0 * (rings + 1.0) + 1.0;
    all *= wide;
    if (!(all * sizeof(std::uint32_t) <= static_cast<double>(options.most_bytes)))
      return too_large(all * sizeof(std::uint32_t), options);
    field.size_[static_cast<std::size_t>(axis)] = static_cast<std::size_t>(wide);
  }
  // A 1 marks bricks that hold points, then all within reach of those.
  std::vector<std::uint8_t> marked(static_cast<std::size_t>(all), 0);
  const auto index_of = [&](const std::array<std::size_t, 3>& at) {
    return at[0] + field.size_[0] * (at[1] + field.size_[1] * at[2]);
  };
  for (std::size_t i = 0; i < points; ++i) {
    const Vec3 at = (point(i) - field.low_) / brick;
    marked[index_of({static_cast<std::size_t>(at.x()), static_cast<std::size_t>(at.y()),
                     static_cast<std::size_t>(at.z())})] = 1;
  }
  // The reach is a cube, so one axis follows the other.
  const auto reach = static_cast<std::ptrdiff_t>(rings);
  const std::array<std::size_t, 3> step = {1, field.size_[0], field.size_[0] * field.size_[1]};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::vector<std::uint8_t> wider = marked;
    for (std::size_t i = 0; i < marked.size(); ++i) {
      if (marked[i] == 0) continue;
      // The border is never crossed: the margin is one brick wider than the reach.
      for (std::ptrdiff_t k = -reach; k <= reach; ++k)
        wider[static_cast<std::size_t>(static_cast<std::ptrdiff_t>(i) +
                                       k * static_cast<std::ptrdiff_t>(step[axis]))] = 1;
    }
    marked = std::move(wider);
  }
  std::vector<std::size_t> candidates;
  for (std::size_t i = 0; i < marked.size(); ++i)
    if (marked[i] != 0) candidates.push_back(i);
  // Bricks whose middle is so far outside, or so deep, that nothing in them counts are left out unsampled.
  const double half_diagonal = 0.5 * kVoxelDiagonal * brick;
  std::vector<std::uint8_t> kept(candidates.size(), 0);
  parallel_each(candidates.size(), kBricksPerChunk, threads, [&](std::size_t i) {
    std::uint32_t hint = kNoHint;
    const FieldSample middle = sample(field.corner_of(candidates[i]) + Vec3::Constant(0.5 * brick),
                                      options.depth_mm + half_diagonal, hint);
    const double d = static_cast<double>(middle.distance);
    kept[i] = d < half_diagonal && d > -options.depth_mm - half_diagonal;
  });
  // This depth includes all corners of a voxel that the wanted depth enters.
  const double deepest = options.depth_mm + kVoxelDiagonal * options.voxel_mm;
  std::vector<std::size_t> bricks;
  for (std::size_t i = 0; i < candidates.size(); ++i)
    if (kept[i] != 0) bricks.push_back(candidates[i]);
  const double bytes = static_cast<double>(bricks.size() * kSamplesPerBrick) * sizeof(FieldSample) +
                       all * sizeof(std::uint32_t);
  if (bytes > static_cast<double>(options.most_bytes)) return too_large(bytes, options);
  field.directory_.assign(static_cast<std::size_t>(all), kNoBrick);
  field.samples_.resize(bricks.size() * kSamplesPerBrick);
  parallel_each(bricks.size(), kBricksPerChunk, threads, [&](std::size_t b) {
    field.directory_[bricks[b]] = static_cast<std::uint32_t>(b);
    const Vec3 corner = field.corner_of(bricks[b]);
    FieldSample* out = &field.samples_[b * kSamplesPerBrick];
    std::uint32_t hint = kNoHint;
    for (int z = 0; z < kBrickSamples; ++z)
      for (int y = 0; y < kBrickSamples; ++y)
        for (int x = 0; x < kBrickSamples; ++x)
          *out++ = sample(corner + field.voxel_ * Vec3(x, y, z), deepest, hint);
  });
  return field;
}

VoxelField::Value VoxelField::at(const Vec3& place) const noexcept {
  const Vec3 voxels = (place - low_) * per_voxel_;
  for (int axis = 0; axis < 3; ++axis)
    if (!(voxels[axis] >= 0.0 &&
          voxels[axis] < static_cast<double>(size_[static_cast<std::size_t>(axis)] * kBrickVoxels)))
      return {};
  std::array<std::size_t, 3> brick, in;
  std::array<double, 3> part;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto whole = static_cast<std::size_t>(voxels[static_cast<Eigen::Index>(axis)]);
    part[axis] = voxels[static_cast<Eigen::Index>(axis)] - static_cast<double>(whole);
    brick[axis] = whole / kBrickVoxels;
    in[axis] = whole % kBrickVoxels;
  }
  const std::uint32_t number = directory_[brick[0] + size_[0] * (brick[1] + size_[1] * brick[2])];
  if (number == kNoBrick) return {};
  constexpr std::size_t kRow = kBrickSamples, kLayer = kRow * kRow;
  const FieldSample* corner = &samples_[number * kSamplesPerBrick + in[0] + kRow * in[1] + kLayer * in[2]];
  Value value;
  value.known = true;
  for (std::size_t k = 0; k < 8; ++k) {
    const std::size_t x = k & 1, y = k >> 1 & 1, z = k >> 2;
    const FieldSample& s = corner[x + kRow * y + kLayer * z];
    const double weight = (x != 0 ? part[0] : 1.0 - part[0]) * (y != 0 ? part[1] : 1.0 - part[1]) *
                          (z != 0 ? part[2] : 1.0 - part[2]);
    value.to_surface +=
        weight * Vec3(static_cast<double>(s.x), static_cast<double>(s.y), static_cast<double>(s.z));
    value.distance += weight * static_cast<double>(s.distance);
  }
  return value;
}

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
    const Vec3 out = outward_normal(point.normal, sign_);
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
      "vector-field", "a force for every place, looked up in a grid",
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
    PALPATE_ASSIGN(
        field_, VoxelField::build([&](std::size_t i) { return points.points[i].at(); }, points.points.size(),
                                  search::local_box(*input.cloud, context.threads), field,
                                  PlaneSampler(points, tree, sign, beside_mm_), context.threads));
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
