#include "toolkit/metrics/nearest_point.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace palpate::metrics {
namespace {

constexpr double kPointsPerCell = 2.0;  // of a surface that fills two faces of its box; few enough to scan
// 21 bits an axis fit a 64-bit key; half the range keeps sums of cell and ring inside it.
constexpr double kMaxCellsPerAxis = 1048576.0;
constexpr std::int64_t kMaxRings = 24;  // beyond, (2 x 24 + 1)^3 cells: looking at every point is no slower

}  // namespace

NearestPoint::NearestPoint(const cloud::Cloud& cloud) : cloud_(cloud) {
  const Vec3 extent_mm = cloud.box_mm().extent_mm();
  // A surface of n points over an area A has sqrt(A / n) between them; the two largest faces of its box stand
  // for A.
  const double area_mm2 =
      extent_mm.x() * extent_mm.y() + extent_mm.y() * extent_mm.z() + extent_mm.z() * extent_mm.x();
  const double n = static_cast<double>(cloud.size());
  const double longest_mm = extent_mm.maxCoeff();
  // A line of points has no area: then spacing along it. Never finer than the key can number.
  cell_mm_ = std::max({std::sqrt(kPointsPerCell * area_mm2 / n), kPointsPerCell * longest_mm / n,
                       longest_mm / kMaxCellsPerAxis});
  if (!(cell_mm_ > 0.0)) cell_mm_ = 1.0;  // all points in one place: any size will do

  std::vector<std::uint64_t> keys(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) keys[i] = key_of(cell_of(cloud.local_mm(i)));
  order_.resize(cloud.size());
  std::iota(order_.begin(), order_.end(), 0u);
  std::sort(order_.begin(), order_.end(),
            [&](std::uint32_t a, std::uint32_t b) { return keys[a] != keys[b] ? keys[a] < keys[b] : a < b; });
  for (std::uint32_t begin = 0; begin < order_.size();) {
    std::uint32_t end = begin + 1;
    while (end < order_.size() && keys[order_[end]] == keys[order_[begin]]) ++end;
    cells_[keys[order_[begin]]] = {begin, end};
    begin = end;
  }
}

NearestPoint::Cell NearestPoint::cell_of(const Vec3& local_mm) const {
  Cell cell;
  for (int axis = 0; axis < 3; ++axis) {
    // Far places are clamped: they share a cell outside the cloud, and their true distances decide.
    cell[axis] = static_cast<std::int64_t>(
        std::clamp(std::floor(local_mm[axis] / cell_mm_), -kMaxCellsPerAxis + 1.0, kMaxCellsPerAxis - 1.0));
  }
  return cell;
}

std::uint64_t NearestPoint::key_of(const Cell& cell) {
  constexpr int kBitsPerAxis = 21;
  constexpr auto kOffset = static_cast<std::int64_t>(kMaxCellsPerAxis);
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    key = (key << kBitsPerAxis) |
          (static_cast<std::uint64_t>(cell[axis] + kOffset) & ((1u << kBitsPerAxis) - 1u));
  }
  return key;
}

void NearestPoint::look(const Cell& cell, const Vec3& local_mm, Best& best) const {
  const auto found = cells_.find(key_of(cell));
  if (found == cells_.end()) return;
  for (std::uint32_t k = found->second.begin; k < found->second.end; ++k) {
    const std::size_t i = order_[k];
    const double d = (cloud_.local_mm(i) - local_mm).squaredNorm();
    if (d < best.distance_sq_mm2 || (d == best.distance_sq_mm2 && i < best.index)) best = {d, i};
  }
}

std::size_t NearestPoint::find(const Vec3& p_mm) const {
  const Vec3 local_mm = p_mm - cloud_.origin_mm;
  const Cell centre = cell_of(local_mm);
  Best best{std::numeric_limits<double>::infinity(), 0};
  // Cells of places far outside are clamped, so rings around them say nothing about distance.
  const bool near = local_mm.cwiseAbs().maxCoeff() < kMaxCellsPerAxis / 2.0 * cell_mm_;
  for (std::int64_t ring = 0; near && ring <= kMaxRings; ++ring) {
    for (std::int64_t dx = -ring; dx <= ring; ++dx) {
      for (std::int64_t dy = -ring; dy <= ring; ++dy) {
        const bool edge = std::max(std::abs(dx), std::abs(dy)) == ring;
        const std::int64_t stride = edge || ring == 0 ? 1 : 2 * ring;  // inside the shell only its two caps
        for (std::int64_t dz = -ring; dz <= ring; dz += stride)
          look(centre + Cell(dx, dy, dz), local_mm, best);
      }
    }
    // All within `ring` cells of the place has been seen.
    const double seen_mm = static_cast<double>(ring) * cell_mm_;
    if (best.distance_sq_mm2 < seen_mm * seen_mm) return best.index;
  }
  for (std::size_t i = 0; i < cloud_.size(); ++i) {
    const double d = (cloud_.local_mm(i) - local_mm).squaredNorm();
    if (d < best.distance_sq_mm2 || (d == best.distance_sq_mm2 && i < best.index)) best = {d, i};
  }
  return best.index;
}

}  // namespace palpate::metrics
