// Benchmarks the segment-box test, contact frames by size, dents, and batches of moved points. Renderers use
// the same contact frames of the same path.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include <palpate/baselines.h>
#include <palpate/registry.h>
#include "experiments/benchmarks/generated_scene.h"
#include "toolkit/core/random.h"
#include "toolkit/deformation/deformer.h"
#include "toolkit/geometry/segment_box.h"

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
  auto [scene, path] =
      experiments::generated_scene("sinusoid:points=" + std::to_string(points), "weave:frames=50000").value();
  for (std::int64_t i = 1; i < models; ++i) {
    scene.models.push_back(scene.models.back());
    scene.models.back().world_from_model.translation_mm.x() += kApartMm;
  }
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
  // Times whole contact runs; steps free frames between them untimed.
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

/// A deformable flat square of so many points, 0.1 mm apart.
render::SceneInput yielding_scene(std::int64_t points) {
  const double extent_mm = 0.1 * std::sqrt(static_cast<double>(points));
  const std::string spec =
      "plane:jitter=0.3:points=" + std::to_string(points) + ":extent_mm=" + std::to_string(extent_mm);
  auto model = cloud::generate(parse_named_options(spec).value()).value();
  render::SceneInput scene;
  render::ModelInput input;
  input.cloud = std::make_shared<cloud::Cloud>(std::move(model.cloud));
  input.surface.dent = {0.1, 1.0, 50.0};
  input.moves = std::make_shared<render::MoveQueue>();
  scene.models.push_back(input);
  return scene;
}

std::unique_ptr<render::HapticRenderer> made(const char* spec, const render::SceneInput& scene) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  const NamedOptions named = parse_named_options(spec).value();
  auto renderer = registry.make(named.name, named.options).value();
  return renderer->prepare(scene, {}) ? std::move(renderer) : nullptr;
}

/// Presses and drags at a different place per iteration; counts frames in which points moved.
void dent(benchmark::State& state, const char* spec) {
  const render::SceneInput scene = yielding_scene(state.range(0));
  const auto renderer = made(spec, scene);
  if (renderer == nullptr) return state.SkipWithError("preparation failed");
  auto& editable = dynamic_cast<deformation::Editable&>(*renderer);
  const double half = 0.3 * scene.models[0].cloud->box_mm().extent_mm().x();
  Random random(1);
  double t = 0.0;
  renderer->restart(Vec3(0, 0, 1), t);
  std::int64_t frames = 0;
  for (auto _ : state) {
    state.PauseTiming();
    const Vec3 start(random.uniform(-half, half), random.uniform(-half, half), 0.01);
    renderer->release_contact(start);
    (void)editable.undo(0);
    const std::uint64_t before = editable.deform_counters(0).moved;
    state.ResumeTiming();
    for (int i = 1; i <= 200; ++i)
      (void)renderer->step(start + Vec3(0.005 * i, 0, -std::min(0.005 * i, 0.6)), t += 1e-3);
    frames += editable.deform_counters(0).moved > before ? 200 : 0;
  }
  state.counters["per_frame"] = benchmark::Counter(static_cast<double>(frames),
                                                   benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

/// A batch of 512 points, adjacent or anywhere (range 1: 0, 1), and the frame that applies it.
void batch(benchmark::State& state, const char* spec) {
  const render::SceneInput scene = yielding_scene(state.range(0));
  const auto renderer = made(spec, scene);
  if (renderer == nullptr) return state.SkipWithError("preparation failed");
  const cloud::Cloud& cloud = *scene.models[0].cloud;
  Random random(2);
  double t = 0.0;
  const Vec3 away(0, 0, 20);
  renderer->restart(away, t);
  for (auto _ : state) {
    state.PauseTiming();
    render::MoveBatch& moves = *scene.models[0].moves->begin();
    const std::uint64_t first = random.below(cloud.size() - render::kMaxBatch);
    for (; moves.count < render::kMaxBatch; ++moves.count) {
      const auto point =
          static_cast<std::uint32_t>(state.range(1) == 0 ? first + moves.count : random.below(cloud.size()));
      moves.point[moves.count] = point;
      moves.to_mm[moves.count] = (cloud.local_mm(point) + Vec3(0, 0, 0.05 * random.normal())).cast<float>();
    }
    scene.models[0].moves->publish();
    state.ResumeTiming();
    (void)renderer->step(away, t += 1e-3);
  }
}

/// Most models are away from the probe; each has 10,201 points, or 1,024 with a thousand models.
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
BENCHMARK_CAPTURE(frame, cloud_vertices, "cloud-vertices")->PALPATE_SIZES;
BENCHMARK_CAPTURE(frame, mesh_godobject, "mesh-godobject:mesh=original")->PALPATE_SIZES;
BENCHMARK_CAPTURE(dent, cloud, "cloud")->Arg(kSizes[0])->Arg(kSizes[2])->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(batch, cloud, "cloud")
    ->Args({kSizes[2], 0})
    ->Args({kSizes[2], 1})
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(frame, analytic, "analytic")->Arg(kSizes[0])->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate::benchmarks
