// Measures section 3.1.2's trade-off on the sinusoid for each partition: building, memory, access, segment
// queries, moving points.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include <palpate/generate.h>
#include "baselines/points/dynamic_grid.h"
#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/search/orthtree.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::benchmarks {
namespace {

using namespace search;
using baselines::DynamicGrid;
using baselines::MoveStatus;

struct Model {
  cloud::Cloud cloud;
  double spacing_mm = 0.0;
};

const Model& model(std::int64_t points) {
  static std::map<std::int64_t, Model> models;
  auto [at, fresh] = models.try_emplace(points);
  if (fresh) {
    auto made =
        cloud::generate(parse_named_options("sinusoid:mesh=false:points=" + std::to_string(points)).value())
            .value();
    at->second = {std::move(made.cloud), made.nominal_spacing_mm};
  }
  return at->second;
}

/// As `cloud` computes it: a square lattice's diagonal.
double resolution_mm(const Model& model) {
  constexpr double kDiagonal = 1.4142135623730951;
  return kDiagonal * model.spacing_mm;
}

template <class P>
P built(const Model& model) {
  PartitionOptions options;
  options.cell_mm = kCellPerResolution * resolution_mm(model);
  return P::build(model.cloud, options, 1);
}

template <class P>
void build(benchmark::State& state) {
  const Model& m = model(state.range(0));
  for (auto _ : state) benchmark::DoNotOptimize(built<P>(m));
  P partition = built<P>(m);
  partition.drop_order();
  const LeafStatistics shape = partition.statistics();
  const auto n = static_cast<double>(m.cloud.size());
  state.counters["bytes_per_point"] = static_cast<double>(partition.bytes()) / n;
  state.counters["points_per_leaf"] = shape.mean_points;
  state.counters["most_points"] = shape.max_points;
  state.counters["depth"] = shape.max_depth;
  state.counters["nodes_per_point"] = static_cast<double>(shape.nodes) / n;
}

constexpr std::size_t kQueries = 4096;

/// Looks up the leaf of a random point.
template <class P>
void access(benchmark::State& state) {
  const Model& m = model(state.range(0));
  const P partition = built<P>(m);
  Random random(1);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < kQueries; ++i) points.push_back(m.cloud.local_mm(random.below(m.cloud.size())));
  std::size_t at = 0;
  std::uint64_t sum = 0;
  for (auto _ : state) {
    visit_point_range(partition, points[at++ % kQueries], [&](IndexRange range) {
      sum += range.end;
      return true;
    });
  }
  benchmark::DoNotOptimize(sum);
}

/// Broad and narrow phase of a segment near the surface; `length` in micrometres, state.range(1).
template <class P, bool kSwept>
void query(benchmark::State& state) {
  const Model& m = model(state.range(0));
  const double length_mm = 1e-3 * static_cast<double>(state.range(1));
  const P partition = built<P>(m);
  std::vector<Vec3> at;
  for (const std::uint32_t i : partition.order()) at.push_back(m.cloud.local_mm(i));
  const Vec3 half = Vec3::Constant(0.5 * resolution_mm(m));
  const double radius_mm = kSwept ? half.x() : 0.0;
  Random random(2);
  std::vector<Vec3> from, to;
  for (std::size_t i = 0; i < kQueries; ++i) {
    const Vec3 way(random.normal(), random.normal(), random.normal());
    from.push_back(at[random.below(at.size())] + resolution_mm(m) * Vec3(0, 0, random.normal()));
    to.push_back(from.back() + length_mm * way.normalized());
  }
  std::size_t k = 0;
  std::uint64_t leaves = 0, tests = 0, hits = 0;
  for (auto _ : state) {
    const Vec3 &a = from[k % kQueries], &b = to[k % kQueries];
    ++k;
    const geometry::SegmentProbe probe(a, b);
    visit_segment_ranges(partition, a, b, half + Vec3::Constant(radius_mm), [&](IndexRange range) {
      ++leaves;
      tests += range.end - range.begin;
      for (std::uint32_t place = range.begin; place < range.end; ++place)
        hits += kSwept ? geometry::swept_sphere_touches_box(probe, radius_mm, at[place], half)
                       : geometry::segment_touches_box(probe, at[place], half);
      return true;
    });
  }
  const auto n = static_cast<double>(k);
  state.counters["leaves"] = static_cast<double>(leaves) / n;
  state.counters["boxes"] = static_cast<double>(tests) / n;
  state.counters["crossed"] = static_cast<double>(hits) / n;
}

/// A dent of 3 mm radius going down and up by `step` micrometres a frame, state.range(1): time per moved
/// point.
template <class P>
void move(benchmark::State& state) {
  constexpr double kRadiusMm = 3.0, kDepthMm = 2.0;
  const Model& m = model(state.range(0));
  const double step_mm = 1e-3 * static_cast<double>(state.range(1));
  P partition = built<P>(m);
  std::vector<Vec3f> points;
  std::vector<std::uint32_t> dented;
  std::vector<float> start_mm;
  for (const std::uint32_t i : partition.order()) {
    points.emplace_back(m.cloud.x_mm[i], m.cloud.y_mm[i], m.cloud.z_mm[i]);
    if (m.cloud.local_mm(i).head<2>().norm() > kRadiusMm) continue;
    dented.push_back(static_cast<std::uint32_t>(points.size() - 1));
    start_mm.push_back(points.back().z());
  }
  double depth = 0.0, way = step_mm;
  std::int64_t moves = 0, changed = 0, refused = 0;
  for (auto _ : state) {
    depth += way;
    if (depth >= kDepthMm || depth <= 0.0) way = -way;
    for (std::size_t i = 0; i < dented.size(); ++i) {
      Vec3f to = points[dented[i]];
      to.z() = start_mm[i] - static_cast<float>(depth);
      const MoveStatus status = partition.move(dented[i], points[dented[i]], to);
      changed += status == MoveStatus::kMoved;
      refused += status == MoveStatus::kFull;
      if (status != MoveStatus::kFull) points[dented[i]] = to;
    }
    moves += static_cast<std::int64_t>(dented.size());
  }
  const auto n = static_cast<double>(moves);
  state.counters["per_point"] =
      benchmark::Counter(n, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.counters["points"] = static_cast<double>(dented.size());
  state.counters["changed"] = static_cast<double>(changed) / n;
  state.counters["refused"] = static_cast<double>(refused) / n;
}

/// Points within a distance found by the printed tests of sections 3.1.2.1 and 3.1.2.2. These examine the
/// leaves at the corners of a cube (square) around a point, with the distance as half diagonal.
struct CornerTestCount {
  std::uint64_t within = 0;             ///< pairs of a query and another point within the distance
  std::uint64_t missed = 0;             ///< of these, in no leaf of the printed test
  std::uint64_t looked_at_exact = 0;    ///< points in the exact test's leaves
  std::uint64_t looked_at_corners = 0;  ///< points in the printed test's leaves
};

/// Calls visit(range) once per leaf that holds a corner; corners outside the tree have none.
template <int kAxes, class Visit>
void visit_corner_leaves(const Orthtree<kAxes>& tree, const Vec3& point_mm, double cutoff_mm,
                         const Visit& visit) {
  const Vec3 half = Vec3::Constant(cutoff_mm / std::sqrt(static_cast<double>(kAxes)));
  const Vec3 low_mm = point_mm - half, high_mm = point_mm + half;
  std::array<const TreeNode*, Orthtree<kAxes>::kChildren> seen{};
  std::size_t count = 0;
  for (std::uint32_t corner = 0; corner < seen.size(); ++corner) {
    Vec3 at = low_mm;
    for (int axis = 0; axis < kAxes; ++axis)
      if ((corner >> axis & 1u) != 0) at[axis] = high_mm[axis];
    const TreeNode* leaf = tree.leaf_at(at);
    const auto end = seen.begin() + static_cast<std::ptrdiff_t>(count);
    if (leaf == nullptr || std::find(seen.begin(), end, leaf) != end) continue;
    seen[count++] = leaf;
    visit(IndexRange{leaf->begin, leaf->end});
  }
}

/// Queries around every 97th point.
template <int kAxes>
CornerTestCount count_corner_test(const Orthtree<kAxes>& tree, const cloud::Cloud& cloud, double cutoff_mm) {
  constexpr std::size_t kStride = 97;
  CornerTestCount count;
  const std::span<const std::uint32_t> order = tree.order();
  for (std::size_t query = 0; query < order.size(); query += kStride) {
    const Vec3 at = cloud.local_mm(order[query]);
    const auto within = [&](const IndexRange& range) {
      std::uint64_t found = 0;
      for (std::size_t place = range.begin; place < range.end; ++place)
        found += place != query && (cloud.local_mm(order[place]) - at).squaredNorm() <= cutoff_mm * cutoff_mm;
      return found;
    };
    std::uint64_t exact = 0, corners = 0;
    visit_segment_ranges(tree, at, at, Vec3::Constant(cutoff_mm), [&](IndexRange range) {
      count.looked_at_exact += range.end - range.begin;
      exact += within(range);
      return true;
    });
    visit_corner_leaves(tree, at, cutoff_mm, [&](const IndexRange& range) {
      count.looked_at_corners += range.end - range.begin;
      corners += within(range);
    });
    count.within += exact;
    count.missed += exact - corners;
  }
  return count;
}

/// Points missed by the printed eight- and four-point tests, by cut-off in tenths of the resolution; no
/// timing.
template <class Tree>
void corners(benchmark::State& state) {
  const Model& m = model(state.range(0));
  const Tree tree = built<Tree>(m);
  CornerTestCount count;
  for (auto _ : state)
    count = count_corner_test(tree, m.cloud, 0.1 * static_cast<double>(state.range(1)) * resolution_mm(m));
  state.counters["missed"] = static_cast<double>(count.missed) / static_cast<double>(count.within);
  state.counters["looked_at"] =
      static_cast<double>(count.looked_at_corners) / static_cast<double>(count.looked_at_exact);
}

constexpr std::int64_t kSizes[] = {10000, 100489, 1002001};
#define PALPATE_SIZES ->Arg(kSizes[0])->Arg(kSizes[1])->Arg(kSizes[2])
#define PALPATE_SIZES_BY(a, b) ->ArgsProduct({{kSizes[0], kSizes[1], kSizes[2]}, {a, b}})

BENCHMARK(build<UniformGrid>) PALPATE_SIZES->Unit(benchmark::kMillisecond);
BENCHMARK(build<Octree>) PALPATE_SIZES->Unit(benchmark::kMillisecond);
BENCHMARK(build<Quadtree3d>) PALPATE_SIZES->Unit(benchmark::kMillisecond);
BENCHMARK(build<DynamicGrid>) PALPATE_SIZES->Unit(benchmark::kMillisecond);
BENCHMARK(access<UniformGrid>) PALPATE_SIZES;
BENCHMARK(access<Octree>) PALPATE_SIZES;
BENCHMARK(access<Quadtree3d>) PALPATE_SIZES;
BENCHMARK(query<UniformGrid, false>) PALPATE_SIZES_BY(50, 5000);
BENCHMARK(query<Octree, false>) PALPATE_SIZES_BY(50, 5000);
BENCHMARK(query<Quadtree3d, false>) PALPATE_SIZES_BY(50, 5000);
BENCHMARK(query<UniformGrid, true>) PALPATE_SIZES_BY(50, 5000);
BENCHMARK(query<Octree, true>) PALPATE_SIZES_BY(50, 5000);
BENCHMARK(query<DynamicGrid, false>) PALPATE_SIZES_BY(50, 5000);

BENCHMARK(move<DynamicGrid>) PALPATE_SIZES_BY(50, 500);
BENCHMARK(corners<Octree>)->ArgsProduct({{kSizes[1]}, {10, 20, 30, 50}})->Iterations(1);
BENCHMARK(corners<Quadtree3d>)->ArgsProduct({{kSizes[1]}, {10, 20, 30, 50}})->Iterations(1);

}  // namespace
}  // namespace palpate::benchmarks
