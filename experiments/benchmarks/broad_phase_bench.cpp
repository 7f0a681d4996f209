// The slow phase by the number of models: a query near one of them, most being away, and following moved
// ones.
#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/geometry/broad_phase.h"

namespace palpate::benchmarks {
namespace {

/// Models of 100 mm, a third of the space theirs.
std::vector<geometry::Aabb> models(std::int64_t n, Random& random) {
  const double room_mm = 100.0 * std::cbrt(3.0 * static_cast<double>(n));
  std::vector<geometry::Aabb> boxes(static_cast<std::size_t>(n));
  for (geometry::Aabb& box : boxes) {
    const Vec3 p(random.uniform(0, room_mm), random.uniform(0, room_mm), random.uniform(0, room_mm));
    box = {p, p + Vec3::Constant(100.0)};
  }
  return boxes;
}

constexpr std::size_t kMost = 16;
constexpr double kReachMm = 5.0;
constexpr std::size_t kProbes = 1024;

void broad_phase_query(benchmark::State& state) {
  Random random(1);
  const std::vector<geometry::Aabb> boxes = models(state.range(0), random);
  const geometry::BroadPhase phase(boxes);
  std::vector<Vec3> probes;
  for (std::size_t i = 0; i < kProbes; ++i)
    probes.push_back(boxes[random.below(boxes.size())].centre_mm() +
                     60.0 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)));
  geometry::FoundBoxes<kMost> found;
  double nodes = 0.0, hits = 0.0;
  std::size_t at = 0;
  for (auto _ : state) {
    phase.query(probes[at++ % kProbes], kReachMm, found);
    nodes += found.query.nodes;
    hits += found.query.hits;
    benchmark::DoNotOptimize(found);
  }
  state.counters["nodes"] = benchmark::Counter(nodes, benchmark::Counter::kAvgIterations);
  state.counters["hits"] = benchmark::Counter(hits, benchmark::Counter::kAvgIterations);
}

void broad_phase_update(benchmark::State& state) {
  Random random(2);
  std::vector<geometry::Aabb> boxes = models(state.range(0), random);
  geometry::BroadPhase phase(boxes);
  for (auto _ : state) {
    for (geometry::Aabb& box : boxes) box = {box.low_mm + Vec3(0.1, 0, 0), box.high_mm + Vec3(0.1, 0, 0)};
    phase.update(boxes);
    benchmark::DoNotOptimize(phase);
  }
}

#define PALPATE_MODELS Arg(1)->Arg(10)->Arg(100)->Arg(1000)
BENCHMARK(broad_phase_query)->PALPATE_MODELS;
BENCHMARK(broad_phase_update)->PALPATE_MODELS;

}  // namespace
}  // namespace palpate::benchmarks
