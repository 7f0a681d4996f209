// Neighbour building and grid build by size, beside other people's trees. All on one thread; the _threads
// rows of ours use all.
#include <benchmark/benchmark.h>

#include <cmath>
#include <map>

#include "experiments/benchmarks/rivals.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/neighbourhood/knn.h"
#include "toolkit/partition/uniform_grid.h"

namespace palpate::benchmarks {
namespace {

const cloud::Cloud& surface(std::int64_t points) {
  static std::map<std::int64_t, cloud::Cloud> made;
  auto found = made.find(points);
  if (found == made.end()) {
    const std::string spec = "sinusoid:mesh=false:points=" + std::to_string(points);
    found = made.emplace(points, cloud::generate(parse_named_options(spec).value()).value().cloud).first;
  }
  return found->second;
}

template <class Run>
void over(benchmark::State& state, Run&& run) {
  const cloud::Cloud& cloud = surface(state.range(0));
  for (auto _ : state) {
    auto result = run(cloud);
    benchmark::DoNotOptimize(result);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(cloud.size()));
}

void modified_knn(benchmark::State& state) {
  over(state, [](const auto& c) { return neighbourhood::modified_knn(c, {}, 1); });
}
void modified_knn_threads(benchmark::State& state) {
  over(state, [](const auto& c) { return neighbourhood::modified_knn(c, {}, 0); });
}
void exact_knn(benchmark::State& state) {
  over(state, [](const auto& c) { return neighbourhood::exact_knn(c, 1); });
}
void scanner_path(benchmark::State& state) {
  over(state, [](const auto& c) { return neighbourhood::scanner_path(c, 1).value(); });
}
void nanoflann(benchmark::State& state) {
  over(state, knn_nanoflann);
}
void cgal(benchmark::State& state) {
  over(state, knn_cgal);
}
void pcl(benchmark::State& state) {
  over(state, knn_pcl);
}
void grid_build(benchmark::State& state) {
  over(state, [](const auto& c) {
    const double spacing = 100.0 / std::sqrt(static_cast<double>(c.size()));
    return partition::UniformGrid::build(c, kCellPerResolution * spacing, 1);
  });
}

constexpr std::int64_t kSmall = 10201, kMiddle = 101761, kLarge = 1002001;
#define PALPATE_SIZES Arg(kSmall)->Arg(kMiddle)->Arg(kLarge)->Unit(benchmark::kMillisecond)
BENCHMARK(modified_knn)->PALPATE_SIZES;
BENCHMARK(modified_knn_threads)->PALPATE_SIZES->UseRealTime();
BENCHMARK(exact_knn)->PALPATE_SIZES;
BENCHMARK(scanner_path)->PALPATE_SIZES;
BENCHMARK(nanoflann)->PALPATE_SIZES;
BENCHMARK(cgal)->PALPATE_SIZES;
BENCHMARK(pcl)->PALPATE_SIZES;
BENCHMARK(grid_build)->PALPATE_SIZES;

}  // namespace
}  // namespace palpate::benchmarks
