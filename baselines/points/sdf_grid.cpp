#include "baselines/points/sdf_grid.h"

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Morphology.h>
#include <openvdb/tree/ValueAccessor.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

using SdfTree = openvdb::FloatTree;
using SdfLeaf = SdfTree::LeafNodeType;

/// A leaf and its samples.
constexpr double kLeafBytes = sizeof(SdfLeaf) + SdfLeaf::SIZE * sizeof(float);
/// Voxels of an axis, at most: coordinates and their sums stay whole in 32 bits.
constexpr double kMostVoxels = 1073741824.0;  // 2^30
/// Points after which the memory is looked at anew while leaves are made.
constexpr std::size_t kPointsPerLook = 4096;
constexpr std::size_t kLeavesPerChunk = 4;
/// Weights below exp(-kSdfCutoff^2) = 1e-4 of the nearest point's are left out.
constexpr double kSdfCutoff = 3.0;
/// The least step through what is not known, in voxels: corners of cells are crossed, not circled.
constexpr double kLeastStep = 0.25;
/// Edges of empty nodes in voxels, by the depth at which the tree ends there.
constexpr double kLeafEdge = 8.0, kInnerEdge = 128.0, kRootEdge = 4096.0;
constexpr double kSdfDiagonal = 1.7320508075688772;  // sqrt 3

openvdb::Coord voxel_of(const Vec3& voxels) {
  return {static_cast<int>(std::floor(voxels.x())), static_cast<int>(std::floor(voxels.y())),
          static_cast<int>(std::floor(voxels.z()))};
}

Error band_too_large(const SdfOptions& options) {
  return Error{fmt::format("the band of signed distances needs more than the limit of {:.0f} MB",
                           static_cast<double>(options.most_bytes) / 1e6),
               "make the voxels larger (option voxel) or the band narrower (band), or raise memory_mb",
               {},
               0};
}

/// The signed distance to the planes of the points around a place.
class PlaneDistance {
 public:
  PlaneDistance(const PointGrid& points, const SphereTree& tree, const SdfOptions& options)
      : points_(points), tree_(tree), options_(options) {
    // The corners of the outermost voxels are as far from a point as the band's cube reaches.
    most_mm_ = kSdfDiagonal * (options.band + 1) * options.voxel_mm;
  }

  /// False where no point is near, or the place is past a border.
  bool operator()(const Vec3& at, float& distance) const {
    const std::uint32_t nearest = tree_.nearest(at, most_mm_);
    if (nearest == kNoPlace) return false;
    const surface::SurfacePoint& first = points_.points[nearest];
    const Vec3 like = outward(first), to = at - first.at();
    if (like == Vec3::Zero()) return false;
    const double nearest_sq = to.squaredNorm(), height = like.dot(to);
    if (nearest_sq - height * height > options_.beside_mm * options_.beside_mm) return false;
    const double width_sq = options_.width_mm * options_.width_mm;
    double weights = 0.0, sum = 0.0;
    tree_.within(at, std::sqrt(nearest_sq + kSdfCutoff * kSdfCutoff * width_sq),
                 [&](std::uint32_t place, double sq) {
                   const Vec3 normal = outward(points_.points[place]);
                   // The other face of something thin has no say here.
                   if (!(normal.dot(like) > 0.0)) return;
                   const double weight = std::exp((nearest_sq - sq) / width_sq);
                   weights += weight;
                   sum += weight * normal.dot(at - points_.points[place].at());
                 });
    distance = static_cast<float>(weights > 0.0 ? sum / weights : height);
    return true;
  }

 private:
  [[nodiscard]] Vec3 outward(const surface::SurfacePoint& point) const {
    if (point.normal == surface::kNoNormal) return Vec3::Zero();
    return surface::decode_normal(point.normal) *
           (surface::is_one_sided(point.normal) ? 1.0 : options_.open_sign);
  }
  const PointGrid& points_;
  const SphereTree& tree_;
  const SdfOptions& options_;
  double most_mm_ = 0.0;
};

}  // namespace

struct SdfGrid::Band {
  SdfTree tree{0.0F};
  // Not registered with the tree: nothing is locked, and the tree does not change any more.
  openvdb::tree::ValueAccessor<const SdfTree, false> read{tree};
};

SdfGrid::SdfGrid() = default;
SdfGrid::~SdfGrid() = default;
SdfGrid::SdfGrid(SdfGrid&&) noexcept = default;
SdfGrid& SdfGrid::operator=(SdfGrid&&) noexcept = default;

Result<SdfGrid> SdfGrid::build(const PointGrid& points, const SphereTree& tree, const SdfOptions& options,
                               int threads) {
  SdfGrid made;
  made.voxel_ = options.voxel_mm;
  made.per_voxel_ = 1.0 / options.voxel_mm;
  made.band_ = std::make_unique<Band>();
  SdfTree& band = made.band_->tree;
  const auto too_large = [&] {
    return static_cast<double>(band.leafCount()) * kLeafBytes > static_cast<double>(options.most_bytes);
  };
  {
    openvdb::tree::ValueAccessor<SdfTree, false> write(band);
    std::size_t since = 0;
    for (const surface::SurfacePoint& point : points.points) {
      const Vec3 voxels = point.at() * made.per_voxel_;
      if (!(voxels.cwiseAbs().maxCoeff() < kMostVoxels))
        return Error{fmt::format("voxels of {:.4g} mm are too small for a model of this size", made.voxel_),
                     "make the voxels larger (option voxel or voxel_mm)",
                     {},
                     0};
      write.setValueOn(voxel_of(voxels), 0.0F);
      if (++since < kPointsPerLook) continue;
      since = 0;
      if (too_large()) return band_too_large(options);
    }
  }
  // A sample belongs to the low corner of a voxel: the high ones are a voxel further.
  for (int ring = 0; ring <= options.band; ++ring) {
    if (too_large()) return band_too_large(options);
    openvdb::tools::dilateActiveValues(band, 1, openvdb::tools::NN_FACE_EDGE_VERTEX,
                                       openvdb::tools::EXPAND_TILES);
  }
  if (too_large()) return band_too_large(options);
  std::vector<SdfLeaf*> leaves;
  band.getNodes(leaves);
  const PlaneDistance distance(points, tree, options);
  parallel_chunks(leaves.size(), kLeavesPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      for (auto voxel = leaves[i]->beginValueOn(); voxel; ++voxel) {
        const openvdb::Coord at = voxel.getCoord();
        float value = 0.0F;
        if (distance(Vec3(at.x(), at.y(), at.z()) * options.voxel_mm, value))
          voxel.setValue(value);
        else
          voxel.setValueOff();
      }
  });
  openvdb::CoordBBox box;
  if (band.evalActiveVoxelBoundingBox(box)) {
    made.box_.add(Vec3(box.min().x(), box.min().y(), box.min().z()) * made.voxel_);
    made.box_.add(Vec3(box.max().x(), box.max().y(), box.max().z()) * made.voxel_);
  }
  made.voxels_ = band.activeVoxelCount();
  made.bytes_ = static_cast<std::size_t>(band.memUsage());
  return made;
}

SdfGrid::Value SdfGrid::at(const Vec3& place) noexcept {
  Value value;
  if (!box_.contains(place)) return value;
  const Vec3 voxels = place * per_voxel_;
  const openvdb::Coord low = voxel_of(voxels);
  const Vec3 part = voxels - Vec3(low.x(), low.y(), low.z());
  std::array<double, 8> corner{};
  for (std::size_t k = 0; k < corner.size(); ++k) {
    float sample = 0.0F;
    if (!band_->read.probeValue(low.offsetBy(k & 1, k >> 1 & 1, k >> 2 & 1), sample)) return value;
    corner[k] = static_cast<double>(sample);
  }
  // Along x, then y, then z; and what each step leaves of the slopes.
  const auto mix = [](double a, double b, double t) { return a + (b - a) * t; };
  std::array<double, 4> along_x{}, slope_x{};
  for (std::size_t k = 0; k < 4; ++k) {
    slope_x[k] = corner[2 * k + 1] - corner[2 * k];
    along_x[k] = mix(corner[2 * k], corner[2 * k + 1], part.x());
  }
  const double near = mix(along_x[0], along_x[1], part.y()), far = mix(along_x[2], along_x[3], part.y());
  value.known = true;
  value.distance = mix(near, far, part.z());
  value.gradient =
      per_voxel_ *
      Vec3(mix(mix(slope_x[0], slope_x[1], part.y()), mix(slope_x[2], slope_x[3], part.y()), part.z()),
           mix(along_x[1] - along_x[0], along_x[3] - along_x[2], part.z()), far - near);
  return value;
}

double SdfGrid::empty_mm(const Vec3& place, const Vec3& way) noexcept {
  const Vec3 voxels = place * per_voxel_;
  const int depth = band_->read.getValueDepth(voxel_of(voxels));
  if (depth == static_cast<int>(SdfTree::DEPTH) - 1) return kLeastStep * voxel_;
  const double edge = depth <= 0 ? kRootEdge : depth == 1 ? kInnerEdge : kLeafEdge;
  double out = HUGE_VAL;
  for (int axis = 0; axis < 3; ++axis) {
    if (way[axis] == 0.0) continue;
    const double node = std::floor(voxels[axis] / edge) * edge;
    out = std::min(out, ((way[axis] > 0.0 ? node + edge : node) - voxels[axis]) / way[axis]);
  }
  // A cell reads its high corners too, which may be in the next node: stay a voxel short of it.
  return std::max(kLeastStep, out - kSdfDiagonal) * voxel_;
}

bool SdfGrid::clip(const Vec3& from, const Vec3& to, double& first, double& last) const noexcept {
  first = 0.0;
  last = 1.0;
  if (voxels_ == 0) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const double way = to[axis] - from[axis];
    if (way == 0.0) {
      if (from[axis] < box_.low_mm[axis] || from[axis] > box_.high_mm[axis]) return false;
      continue;
    }
    const double a = (box_.low_mm[axis] - from[axis]) / way, b = (box_.high_mm[axis] - from[axis]) / way;
    first = std::max(first, std::min(a, b));
    last = std::min(last, std::max(a, b));
  }
  return first <= last;
}

}  // namespace palpate::baselines
