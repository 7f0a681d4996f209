#include "toolkit/stars/places.h"

#include <algorithm>
#include <array>

#include "toolkit/core/parallel.h"
#include "toolkit/partition/morton_order.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {
namespace {

/// Cubes along the longest side of the lattice that sorts the points: all that a code holds, so that two
/// points share a cube only where they are one to a float.
constexpr double kSortingCubes = 2097151.0;  // 2^21 - 1

/// Points of a group that are put in order among themselves. A Morton curve jumps, and a block of places that
/// lies across a jump has a box and a layer many times its neighbours': only blocks across the middle of a
/// group can.
constexpr std::size_t kGroup = 512;

/// Halves the range across its longest side, down to blocks.
void split(const cloud::Cloud& cloud, std::uint32_t* first, std::uint32_t* last) {
  const auto count = static_cast<std::size_t>(last - first);
  if (count <= kBlockPlaces) return;
  const auto at = [&](std::uint32_t i) { return std::array{cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]}; };
  std::array<float, 3> low = at(*first), high = low;
  for (const std::uint32_t* i = first; i != last; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], at(*i)[axis]);
      high[axis] = std::max(high[axis], at(*i)[axis]);
    }
  std::size_t longest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (high[axis] - low[axis] > high[longest] - low[longest]) longest = axis;
  const std::size_t blocks = (count + kBlockPlaces - 1) / kBlockPlaces;
  std::uint32_t* const middle = first + (blocks + 1) / 2 * kBlockPlaces;
  if (middle >= last) return;
  std::nth_element(first, middle, last, [&](std::uint32_t i, std::uint32_t j) {
    const auto a = at(i), b = at(j);
    if (a[longest] != b[longest]) return a[longest] < b[longest];
    return a != b ? a < b : i < j;
  });
  split(cloud, first, middle);
  split(cloud, middle, last);
}

}  // namespace

cloud::Cloud sorted_cloud(const cloud::Cloud& cloud, const std::vector<std::uint32_t>& order, int threads) {
  cloud::Cloud sorted;
  sorted.origin_mm = cloud.origin_mm;
  const std::size_t n = cloud.size();
  sorted.x_mm.resize(n);
  sorted.y_mm.resize(n);
  sorted.z_mm.resize(n);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      sorted.x_mm[i] = cloud.x_mm[order[i]];
      sorted.y_mm[i] = cloud.y_mm[order[i]];
      sorted.z_mm[i] = cloud.z_mm[order[i]];
    }
  });
  return sorted;
}

std::vector<std::uint32_t> places_of(const cloud::Cloud& cloud, int threads) {
  const geometry::Aabb box = partition::local_box(cloud, threads);
  const double extent = box.extent_mm().maxCoeff();
  const partition::Lattice lattice =
      partition::Lattice::over(box, extent > 0.0 ? extent / kSortingCubes : 1.0);
  std::vector<std::uint32_t> order = partition::sort_by_morton(cloud, lattice, threads).order;
  parallel_chunks(order.size(), kGroup, threads, [&](std::size_t begin, std::size_t end) {
    split(cloud, order.data() + begin, order.data() + end);
  });
  return order;
}

}  // namespace palpate::stars
