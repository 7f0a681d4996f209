// What the triangles of `cloud` cost to make, step by step: see docs/surface.md. Counters are ms of processor
// time a million points, of all threads together: they hold on a busy machine too.
#include <benchmark/benchmark.h>

#include <ctime>
#include <map>
#include <string>

#include "toolkit/cloud/generate.h"
#include "toolkit/stars/star_mesh.h"
#include "toolkit/stars/star_tree.h"

namespace palpate::benchmarks {
namespace {

const cloud::Cloud& points_of(const std::string& generator) {
  static std::map<std::string, cloud::Cloud> made;
  auto [at, fresh] = made.try_emplace(generator);
  if (fresh) at->second = cloud::generate(parse_named_options(generator).value()).value().cloud;
  return at->second;
}

/// A raster's points with a hundred square holes, and half of it a step higher: what reading leaves of a
/// scan.
const cloud::Cloud& scan_of(const std::string& generator) {
  static std::map<std::string, cloud::Cloud> made;
  auto [at, fresh] = made.try_emplace(generator);
  if (!fresh) return at->second;
  const cloud::Cloud& full = points_of(generator);
  const std::uint32_t columns = full.raster->columns, apart = columns / 10, wide = columns / 40;
  const double step = 0.1 * full.box_mm().extent_mm().maxCoeff();
  std::vector<Vec3> points;
  cloud::Property row{"row", {}}, column{"column", {}};
  for (std::uint32_t i = 0; i < full.size(); ++i) {
    const std::uint32_t r = i / columns, c = i % columns;
    if (r % apart < wide && c % apart < wide) continue;
    points.push_back(full.point_mm(i) + Vec3(0.0, 0.0, c > columns / 2 ? step : 0.0));
    row.values.push_back(static_cast<float>(r));
    column.values.push_back(static_cast<float>(c));
  }
  at->second = cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
  at->second.properties = {row, column};
  return at->second;
}

void make_stars_from(benchmark::State& state, const cloud::Cloud& cloud) {
  const auto threads = static_cast<int>(state.range(0));
  std::map<std::string, double> ms;
  for (auto _ : state) {
    std::string step;
    std::clock_t begin = 0;
    const auto next = [&](std::string_view name) {
      const std::clock_t now = std::clock();
      if (!step.empty()) ms[step] += 1e3 * static_cast<double>(now - begin) / CLOCKS_PER_SEC;
      step = name;
      begin = now;
    };
    const stars::StarMesh mesh = stars::StarMesh::build(cloud, threads, next);
    next("tree");
    benchmark::DoNotOptimize(stars::StarTree::build(mesh, threads).bytes());
    next("");
  }
  constexpr double kMillion = 1e6;
  const double runs = static_cast<double>(state.iterations()) * static_cast<double>(cloud.size()) / kMillion;
  double all = 0.0;
  for (const auto& [step, sum] : ms) {
    state.counters[step] = sum / runs;
    all += sum / runs;
  }
  state.counters["all"] = all;
}

void make_stars_of(benchmark::State& state, const std::string& generator) {
  make_stars_from(state, points_of(generator));
}
void make_stars_of_scan(benchmark::State& state, const std::string& generator) {
  make_stars_from(state, scan_of(generator));
}

void on_one_and_two_threads(benchmark::internal::Benchmark* b) {
  b->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
}

BENCHMARK_CAPTURE(make_stars_of, random, "torus:sampling=random:points=1000000:mesh=false")
    ->Apply(on_one_and_two_threads);
BENCHMARK_CAPTURE(make_stars_of, even, "ellipsoid:points=1000000:mesh=false")->Apply(on_one_and_two_threads);
BENCHMARK_CAPTURE(make_stars_of, lattice, "sinusoid:shuffle:points=1002001:mesh=false")
    ->Apply(on_one_and_two_threads);
BENCHMARK_CAPTURE(make_stars_of, raster, "sinusoid:points=1002001:mesh=false")->Apply(on_one_and_two_threads);
BENCHMARK_CAPTURE(make_stars_of_scan, raster, "sinusoid:points=1002001:mesh=false")
    ->Apply(on_one_and_two_threads);
BENCHMARK_CAPTURE(make_stars_of, noise, "torus:sampling=random:noise=0.22:points=428860:mesh=false")
    ->Apply(on_one_and_two_threads);

}  // namespace
}  // namespace palpate::benchmarks
