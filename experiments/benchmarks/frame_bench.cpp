// The segment-box test, and the frame in contact by size: one renderer after the other over the same contact
// frames of the same path.
#include <benchmark/benchmark.h>

#include <memory>

#include "baselines/register.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/random.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/renderers/toolkit_renderers.h"
#include "toolkit/trace/paths.h"

namespace palpate::benchmarks {
namespace {

void segment_box(benchmark::State& state) {
  Random random(1);
  std::vector<Vec3> centres;
  for (int i = 0; i < 1024; ++i)
    centres.emplace_back(random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3));
  const geometry::SegmentProbe probe(Vec3(-0.02, 0.01, 0.03), Vec3(0.02, -0.01, 0.0));
  const Vec3 half = Vec3::Constant(0.075);
  std::size_t hits = 0;
  for (auto _ : state)
    for (const Vec3& c : centres) hits += geometry::segment_touches_box(probe, c, half);
  benchmark::DoNotOptimize(hits);
  state.SetItemsProcessed(state.iterations() * 1024);
}
BENCHMARK(segment_box);

/// `models` in a row, the path over the first.
void run_frames(benchmark::State& state, const char* spec, std::int64_t points, std::int64_t models) {
  constexpr double kApartMm = 150.0;  // models are 100 mm wide
  auto model =
      cloud::generate(parse_named_options("sinusoid:points=" + std::to_string(points)).value()).value();
  render::SceneInput scene;
  render::ModelInput input;
  input.cloud = std::make_shared<cloud::Cloud>(std::move(model.cloud));
  input.original_mesh = model.original_mesh;
  input.analytic = model.surface;
  for (std::int64_t i = 0; i < models; ++i) {
    scene.models.push_back(input);
    input.world_from_model.translation_mm.x() += kApartMm;
  }
  trace::PathTarget target;
  target.surface = model.surface.get();
  target.box_mm = model.surface->box_mm();
  const auto path = trace::make_path(parse_named_options("weave:frames=50000").value(), target).value();
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  const NamedOptions named = parse_named_options(spec).value();
  auto renderer = registry.make(named.name, named.options).value();
  if (!renderer->prepare(scene, {})) {
    state.SkipWithError("preparation failed");
    return;
  }
  renderer->restart(path.hip_mm[0], -path.t_s[1]);
  // Contact runs are timed as wholes; free frames between them are stepped untimed.
  std::size_t at = 0;
  std::int64_t contacts = 0;
  render::Frame last;
  for (auto _ : state) {
    state.PauseTiming();
    do {
      if (at == path.size()) {
        at = 0;
        renderer->restart(path.hip_mm[0], -path.t_s[1]);
      }
      last = renderer->step(path.hip_mm[at], path.t_s[at]);
      ++at;
    } while (!last.contact);
    state.ResumeTiming();
    while (last.contact && at < path.size()) {
      last = renderer->step(path.hip_mm[at], path.t_s[at]);
      ++at;
      ++contacts;
    }
    benchmark::DoNotOptimize(last);
  }
  state.counters["per_frame"] = benchmark::Counter(static_cast<double>(contacts),
                                                   benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void frame(benchmark::State& state, const char* spec) {
  run_frames(state, spec, state.range(0), 1);
}

/// Most of the models are away from the probe; each has 10,201 points up to a hundred, 1,024 in a thousand.
void models(benchmark::State& state) {
  run_frames(state, "cloud", state.range(1), state.range(0));
}
BENCHMARK(models)
    ->Args({1, 10201})
    ->Args({10, 10201})
    ->Args({100, 10201})
    ->Args({1, 1024})
    ->Args({1000, 1024})
    ->Unit(benchmark::kMicrosecond);

constexpr std::int64_t kSizes[] = {10201, 101761, 1002001, 10004569};
#define PALPATE_SIZES \
  Arg(kSizes[0])->Arg(kSizes[1])->Arg(kSizes[2])->Arg(kSizes[3])->Unit(benchmark::kMicrosecond)
BENCHMARK_CAPTURE(frame, cloud, "cloud")->PALPATE_SIZES;
BENCHMARK_CAPTURE(frame, heightfield, "heightfield")->PALPATE_SIZES;
BENCHMARK_CAPTURE(frame, heightfield_lookup, "heightfield-literal:response=lookup")->PALPATE_SIZES;
BENCHMARK_CAPTURE(frame, cloud_unshaded, "cloud:shading=none")->PALPATE_SIZES;
BENCHMARK_CAPTURE(frame, mesh_godobject, "mesh-godobject:mesh=original")->PALPATE_SIZES;
BENCHMARK_CAPTURE(frame, analytic, "analytic")->Arg(kSizes[0])->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate::benchmarks
