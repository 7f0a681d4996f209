#include "baselines/points/sdf_grid.h"

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tree/ValueAccessor.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "baselines/mesh/facet.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

using SdfTree = openvdb::FloatTree;
using SdfLeaf = SdfTree::LeafNodeType;

/// A leaf and its samples.
constexpr double kLeafBytes = sizeof(SdfLeaf) + SdfLeaf::SIZE * sizeof(float);
/// Most voxels of an axis: coordinates and their sums stay whole in 32 bits.
constexpr double kMaxVoxels = 1073741824.0;  // 2^30
constexpr std::size_t kLeavesPerChunk = 16;
/// The planes of points so many widths further than the nearest have no weight any more. That weight is
/// (1 - s / c^2)^(c^2 - 2), s the excess of the squared distance in widths: over a plane as wide as the
/// Gaussian exp(-s) (the mean of s is 1), but it ends, smoothly, and takes products alone.
constexpr double kSdfCutoff = 3.0;
/// The least step through what is not known, in voxels: corners of cells are crossed, not circled.
constexpr double kMinStep = 0.25;
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
               "make the voxels larger (option voxel) or the band narrower (band), or raise memory_mb"};
}

/// A point and its plane, outside known.
struct Plane {
  Vec3 at, outward;  ///< zero where the point has no plane
  double distance_sq = 0.0;
};
using Planes = std::vector<Plane>;

/// Fills leaves with the signed distances to the planes of the points around. Points that a leaf can see are
/// gathered once, then those of its eighths among them, and of theirs again: a voxel reads some fifty points,
/// whatever their number and the size of voxels.
class LeafFiller {
 public:
  LeafFiller(const PointGrid& points, const SphereTree& tree, const SdfOptions& options)
      : points_(points),
        tree_(tree),
        options_(options),
        cut_sq_(kSdfCutoff * kSdfCutoff * options.width_mm * options.width_mm) {
    // Corners of every cell that holds a place within the band.
    reach_mm_ = (options.band + kSdfDiagonal) * options.voxel_mm;
  }

  /// Null if nothing is known in the leaf at `origin`. Places are taken in order: nothing depends on threads.
  std::unique_ptr<SdfLeaf> operator()(const openvdb::Coord& origin) {
    const double half = half_diagonal(SdfLeaf::DIM), own = std::sqrt(reach_mm_ * reach_mm_ + cut_sq_);
    const Vec3 centre = middle(origin, SdfLeaf::DIM);
    Planes& seen = seen_[0];
    seen.clear();
    tree_.within(centre, (half + own) * kRounded, [&](std::uint32_t place, double) {
      const surface::OrientedPoint& point = points_.points[place];
      seen.push_back({point.at(), outward_normal(point.normal, options_.open_sign)});
    });
    leaf_ = std::make_unique<SdfLeaf>(origin, 0.0F, false);
    fill(origin, SdfLeaf::DIM, 0);
    return leaf_->isEmpty() ? nullptr : std::move(leaf_);
  }

 private:
  static constexpr int kHalvings = 2;  // of a leaf's edge of 8, to blocks of 2
  static constexpr double kRounded = 1.0 + 1e-9;

  [[nodiscard]] Vec3 at(const openvdb::Coord& voxel) const {
    return Vec3(voxel.x(), voxel.y(), voxel.z()) * options_.voxel_mm;
  }
  [[nodiscard]] Vec3 middle(const openvdb::Coord& low, int edge) const {
    return at(low) + Vec3::Constant(0.5 * (edge - 1) * options_.voxel_mm);
  }
  [[nodiscard]] double half_diagonal(int edge) const {
    return 0.5 * kSdfDiagonal * (edge - 1) * options_.voxel_mm;
  }

  /// Fills a block of a leaf from what can be seen, which is in seen_[halved].
  void fill(const openvdb::Coord& low, int edge, std::size_t halved) {
    Planes& all = seen_[halved];
    const Vec3 centre = middle(low, edge);
    double nearest_sq = std::numeric_limits<double>::infinity();
    for (Plane& plane : all) {
      plane.distance_sq = (plane.at - centre).squaredNorm();
      nearest_sq = std::min(nearest_sq, plane.distance_sq);
    }
    const double half = half_diagonal(edge), nearest = std::sqrt(nearest_sq);
    if (!(nearest <= (reach_mm_ + half) * kRounded)) return;
    // The nearest point is at most so far from a voxel of the block; what has a weight follows from that.
    const double far = nearest + half, all_of = (std::sqrt(far * far + cut_sq_) + half) * kRounded;
    Planes& seen = seen_[halved + 1];
    seen.clear();
    for (const Plane& plane : all)
      if (plane.distance_sq <= all_of * all_of) seen.push_back(plane);
    const bool last = halved == kHalvings;
    const int part = last ? 1 : edge / 2;
    for (int k = 0; k < 8; ++k) {
      const openvdb::Coord next = low.offsetBy(part * (k & 1), part * (k >> 1 & 1), part * (k >> 2 & 1));
      float value = 0.0F;
      if (!last)
        fill(next, part, halved + 1);
      else if (distance(at(next), seen, value))
        leaf_->setValueOn(next, value);
    }
  }

  /// False where no point is near, or the place is past a border.
  bool distance(const Vec3& at, Planes& seen, float& distance) const {
    const Plane* nearest = nullptr;
    double nearest_sq = std::numeric_limits<double>::infinity();
    for (Plane& plane : seen) {
      plane.distance_sq = (plane.at - at).squaredNorm();
      if (!(plane.distance_sq < nearest_sq)) continue;
      nearest_sq = plane.distance_sq;
      nearest = &plane;
    }
    if (!(nearest_sq <= reach_mm_ * reach_mm_) || nearest->outward == Vec3::Zero()) return false;
    const Vec3 like = nearest->outward;
    const double height = like.dot(at - nearest->at);
    if (nearest_sq - height * height > options_.beside_mm * options_.beside_mm) return false;
    double weights = 0.0, sum = 0.0;
    for (const Plane& plane : seen) {
      const double left = 1.0 - (plane.distance_sq - nearest_sq) / cut_sq_;
      // The other face of something thin does not count here.
      if (!(left > 0.0) || !(plane.outward.dot(like) > 0.0)) continue;
      const double cube = left * left * left, weight = cube * cube * left;  // to the seventh
      weights += weight;
      sum += weight * plane.outward.dot(at - plane.at);
    }
    distance = static_cast<float>(sum / weights);
    return true;
  }

  const PointGrid& points_;
  const SphereTree& tree_;
  const SdfOptions& options_;
  double cut_sq_, reach_mm_ = 0.0;
  std::array<Planes, kHalvings + 2> seen_;
  std::unique_ptr<SdfLeaf> leaf_;
};

/// The origins of all leaves within `rings` leaves of one that holds a point, in order. An Error where they
/// alone would need the memory.
Result<std::vector<openvdb::Coord>> leaves_around(const PointGrid& points, const SdfOptions& options,
                                                  int rings) {
  std::vector<openvdb::Coord> leaves;
  const auto once_each = [&] {
    std::sort(leaves.begin(), leaves.end());
    leaves.erase(std::unique(leaves.begin(), leaves.end()), leaves.end());
  };
  for (const surface::OrientedPoint& point : points.points) {
    const Vec3 voxels = point.at() / options.voxel_mm;
    if (!(voxels.cwiseAbs().maxCoeff() < kMaxVoxels))
      return Error{
          fmt::format("voxels of {:.4g} mm are too small for a model of this size", options.voxel_mm),
          "make the voxels larger (option voxel or voxel_mm)"};
    openvdb::Coord leaf = voxel_of(voxels);
    leaf &= ~static_cast<int>(SdfLeaf::DIM - 1);  // its origin
    if (leaves.empty() || leaves.back() != leaf) leaves.push_back(leaf);
  }
  once_each();
  const auto most = static_cast<double>(options.most_bytes) / sizeof(openvdb::Coord);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (static_cast<double>(leaves.size()) * (2 * rings + 1) > most) return band_too_large(options);
    const std::size_t before = leaves.size();
    for (std::size_t i = 0; i < before; ++i)
      for (int ring = -rings; ring <= rings; ++ring) {
        if (ring == 0) continue;
        openvdb::Coord next = leaves[i];
        next[axis] += ring * static_cast<int>(SdfLeaf::DIM);
        leaves.push_back(next);
      }
    once_each();
  }
  return leaves;
}

}  // namespace

struct SdfGrid::Band {
  SdfTree tree{0.0F};
  // The accessor is not registered with the tree: nothing is locked, and the tree no longer changes.
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
  const int rings = static_cast<int>(std::ceil((options.band + kSdfDiagonal) / SdfLeaf::DIM));
  PALPATE_ASSIGN(const std::vector<openvdb::Coord> origins, leaves_around(points, options, rings));
  std::vector<std::unique_ptr<SdfLeaf>> leaves(origins.size());
  const auto most_leaves = static_cast<std::size_t>(static_cast<double>(options.most_bytes) / kLeafBytes);
  std::atomic<std::size_t> filled{0};
  parallel_chunks(leaves.size(), kLeavesPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    LeafFiller fill(points, tree, options);
    for (std::size_t i = begin; i < end && filled <= most_leaves; ++i) {
      leaves[i] = fill(origins[i]);
      if (leaves[i] != nullptr) ++filled;
    }
  });
  if (filled > most_leaves) return band_too_large(options);
  for (std::unique_ptr<SdfLeaf>& leaf : leaves)
    if (leaf != nullptr) band.addLeaf(leaf.release());
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
  // Interpolates along x, then y, then z, with what each step leaves of the slopes.
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
  if (depth == static_cast<int>(SdfTree::DEPTH) - 1) return kMinStep * voxel_;
  const double edge = depth <= 0 ? kRootEdge : depth == 1 ? kInnerEdge : kLeafEdge;
  double out = HUGE_VAL;
  for (int axis = 0; axis < 3; ++axis) {
    if (way[axis] == 0.0) continue;
    const double node = std::floor(voxels[axis] / edge) * edge;
    out = std::min(out, ((way[axis] > 0.0 ? node + edge : node) - voxels[axis]) / way[axis]);
  }
  // A cell reads its high corners too, which may be in the next node: stay a voxel short of it.
  return std::max(kMinStep, out - kSdfDiagonal) * voxel_;
}

bool SdfGrid::clip(const Vec3& from, const Vec3& to, double& first, double& last) const noexcept {
  first = 0.0;
  last = 1.0;
  return voxels_ > 0 && clip_to_box(box_, from, to - from, 0.0, first, last);
}

}  // namespace palpate::baselines
