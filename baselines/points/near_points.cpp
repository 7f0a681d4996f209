#include "baselines/points/near_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

namespace palpate::baselines {
namespace {

/// Finest cell as a share of the radius. A ball that rolls over points d apart sinks by d^2 / 8 of its radius
/// between them.
constexpr double kFinestCell = 1.0 / 16.0;
/// Cells to a reach: cells up to four away are within reach of a place.
constexpr int kCellsAway = 4;
/// Bits of an index, of which three stand in one key, and so the most cells of an axis.
constexpr int kKeyBits = 21;
constexpr double kMaxCells = 1048576.0;  // 2^20: four cells more on either side still fit

/// Cells of one edge, by a key each.
struct Cells {
  Vec3 low;
  double edge;

  Cells(const geometry::Aabb& box, double wanted)
      : low(box.low_mm), edge(std::max(wanted, box.extent_mm().maxCoeff() / kMaxCells)) {}
  [[nodiscard]] std::uint64_t key(const Vec3& at) const {
    const Vec3 cell = ((at - low) / edge).array().floor();
    std::uint64_t key = 0;
    for (int axis = 0; axis < 3; ++axis)
      key = key << kKeyBits | static_cast<std::uint64_t>(cell[axis] + kCellsAway);
    return key;
  }
};

std::uint64_t shifted(std::uint64_t key, int x, int y, int z) {
  const auto by = [](int steps, int axis) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(steps)) << (kKeyBits * axis);
  };
  return key + by(x, 2) + by(y, 1) + by(z, 0);
}

/// The most points that cells within reach of one cell hold: no place has more in its reach.
std::uint64_t most_in_reach(const cloud::Cloud& cloud, const geometry::Aabb& box, double reach_mm) {
  const Cells cells(box, reach_mm / kCellsAway);
  // Places of two cells are out of reach if the cells' nearest corners are.
  const auto too_far = [&](int x, int y, int z) {
    const auto between = [](int steps) { return std::max(0, std::abs(steps) - 1); };
    const int a = between(x), b = between(y), c = between(z);
    return a * a + b * b + c * c > kCellsAway * kCellsAway;
  };
  std::unordered_map<std::uint64_t, std::uint64_t> held, seen;
  for (std::size_t i = 0; i < cloud.size(); ++i) ++held[cells.key(cloud.local_mm(i))];
  std::uint64_t most = 0;
  for (const auto& [key, count] : held)
    for (int x = -kCellsAway; x <= kCellsAway; ++x)
      for (int y = -kCellsAway; y <= kCellsAway; ++y)
        for (int z = -kCellsAway; z <= kCellsAway; ++z)
          if (!too_far(x, y, z)) most = std::max(most, seen[shifted(key, x, y, z)] += count);
  return most;
}

cloud::Cloud one_a_cell(const cloud::Cloud& cloud, const geometry::Aabb& box, double edge_mm) {
  const Cells cells(box, edge_mm);
  std::vector<std::tuple<std::uint64_t, double, std::size_t>> order;  // key, from the middle, index
  order.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 at = cloud.local_mm(i), in = (at - cells.low) / cells.edge;
    const Vec3 off = in - (in.array().floor() + 0.5).matrix();
    order.emplace_back(cells.key(at), off.squaredNorm(), i);
  }
  std::sort(order.begin(), order.end());
  cloud::Cloud kept;
  kept.origin_mm = cloud.origin_mm;
  for (std::size_t k = 0; k < order.size(); ++k) {
    if (k > 0 && std::get<0>(order[k]) == std::get<0>(order[k - 1])) continue;
    const std::size_t i = std::get<2>(order[k]);
    kept.x_mm.push_back(cloud.x_mm[i]);
    kept.y_mm.push_back(cloud.y_mm[i]);
    kept.z_mm.push_back(cloud.z_mm[i]);
  }
  return kept;
}

}  // namespace

bool may_be_too_many(std::size_t most_in_cell, double cell_mm, double reach_mm) noexcept {
  const double across = 2.0 * std::ceil(reach_mm / cell_mm) + 1.0;
  return static_cast<double>(most_in_cell) * across * across * across > static_cast<double>(kMaxNear);
}

Thinned thinned_to_reach(std::shared_ptr<const cloud::Cloud> cloud, double radius_mm, double reach_mm,
                         render::PrepareReport& report) {
  const geometry::Aabb box = search::local_box(*cloud, 1);
  Thinned made{std::move(cloud), 0.0};
  const std::size_t before = made.cloud->size();
  const std::shared_ptr<const cloud::Cloud> all = made.cloud;
  for (double edge = kFinestCell * radius_mm; most_in_reach(*made.cloud, box, reach_mm) > kMaxNear;
       edge *= 2.0) {
    made.cell_mm = edge;
    made.cloud = std::make_shared<cloud::Cloud>(one_a_cell(*all, box, edge));
  }
  if (made.cell_mm > 0.0)
    report.notes.push_back(
        fmt::format("in places more than {} points are within reach of the proxy: of cells of {:.4g} mm one "
                    "point each was kept, {} of {}. A smaller radius keeps more",
                    kMaxNear, made.cell_mm, made.cloud->size(), before));
  return made;
}

}  // namespace palpate::baselines
