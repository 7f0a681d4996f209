// What each idea of the frame of `cloud` saves: the same frames with all of them and with one left out, on
// points at random. Functions are named so that callgrind tells them apart: see idea_costs.
//
//   frame_ideas counted   each once, for callgrind; without it a benchmark
#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <string>
#include <utility>
#include <vector>

#include "experiments/benchmarks/ablated_contact.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/trace/paths.h"

namespace palpate::benchmarks {
namespace {

constexpr const char* kPoints = "torus:sampling=random:points=30000:mesh=false:seed=7";
constexpr const char* kPath = "weave:frames=9000:depth_mm=1:clearance_mm=1:period_frames=450:seed=5";

struct Scene {
  stars::StarMesh mesh;
  stars::StarTree tree;
  std::vector<Vec3> hip, far;
  std::vector<std::pair<std::size_t, std::size_t>> contact, free;  ///< runs of frames

  Scene() {
    const auto made = cloud::generate(parse_named_options(kPoints).value()).value();
    mesh = stars::StarMesh::build(made.cloud, 1);
    tree = stars::StarTree::build(mesh, 1);
    trace::PathTarget target;
    target.surface = made.surface.get();
    target.box_mm = made.surface->box_mm();
    const auto path = trace::make_path(parse_named_options(kPath).value(), target).value();
    const Vec3 above = Vec3(0, 0, target.box_mm.extent_mm().x());
    for (const Vec3& h : path.hip_mm) {
      hip.push_back(h - mesh.origin_mm());
      far.push_back(hip.back() + above);
    }
    AblatedContact<0> contacts(mesh, tree, hip[0]);
    bool before = false;
    for (std::size_t k = 0; k < hip.size(); ++k) {
      const bool in = contacts.update(hip[k]);
      auto& runs = in ? contact : free;
      if (k == 0 || in != before) runs.emplace_back(k, k);
      ++runs.back().second;
      before = in;
    }
  }
  static const Scene& get() {
    static const Scene scene;
    return scene;
  }
};

std::size_t frames_of(const std::vector<std::pair<std::size_t, std::size_t>>& runs) {
  std::size_t sum = 0;
  for (const auto& [begin, end] : runs) sum += end - begin;
  return sum;
}

/// One and the same under three names, which the compiler is not to join.
#if defined(__clang__)
#define PALPATE_COUNTED __attribute__((noinline))
#else
#define PALPATE_COUNTED __attribute__((noinline, no_icf))
#endif
template <unsigned kWithout>
PALPATE_COUNTED double idea_contact_frames(AblatedContact<kWithout>& contact, const Vec3* h,
                                           std::size_t count) {
  double sum = 0.0;
  for (std::size_t k = 0; k < count; ++k)
    if (contact.update(h[k])) sum += contact.pull().x() + contact.pull().y() + contact.pull().z();
  return sum;
}
template <unsigned kWithout>
PALPATE_COUNTED double idea_free_frames(AblatedContact<kWithout>& contact, const Vec3* h, std::size_t count) {
  double sum = 0.0;
  for (std::size_t k = 0; k < count; ++k)
    if (contact.update(h[k])) sum += 1.0;
  return sum;
}

/// The same, a width of the model above it: nothing is near.
template <unsigned kWithout>
PALPATE_COUNTED double idea_far_frames(AblatedContact<kWithout>& contact, const Vec3* h, std::size_t count) {
  double sum = 0.0;
  for (std::size_t k = 0; k < count; ++k)
    if (contact.update(h[k])) sum += 1.0;
  return sum;
}

/// All frames, run by run.
template <unsigned kWithout>
double one_pass(const Scene& scene) {
  AblatedContact<kWithout> contact(scene.mesh, scene.tree, scene.hip[0]);
  double sum = 0.0;
  std::size_t in = 0, out = 0;
  for (std::size_t at = 0; at < scene.hip.size();) {
    const bool is_free = out < scene.free.size() && scene.free[out].first == at;
    const auto [begin, end] = is_free ? scene.free[out++] : scene.contact[in++];
    sum += is_free ? idea_free_frames(contact, &scene.hip[begin], end - begin)
                   : idea_contact_frames(contact, &scene.hip[begin], end - begin);
    at = end;
  }
  AblatedContact<kWithout> above(scene.mesh, scene.tree, scene.far[0]);
  return sum + idea_far_frames(above, scene.far.data(), scene.far.size());
}

template <unsigned kWithout>
void frames_without(benchmark::State& state) {
  const Scene& scene = Scene::get();
  for (auto _ : state) benchmark::DoNotOptimize(one_pass<kWithout>(scene));
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(scene.hip.size()));
}
BENCHMARK(frames_without<0>);
BENCHMARK(frames_without<kLinear>);
BENCHMARK(frames_without<kCrossing>);
BENCHMARK(frames_without<kWarmStart | kLinear>);
BENCHMARK(frames_without<kRemembered | kClearance>);
BENCHMARK(frames_without<kLanes>);
BENCHMARK(frames_without<kLayers>);
BENCHMARK(frames_without<kPacked>);
BENCHMARK(frames_without<kPacked | kTriangleBoxes>);
BENCHMARK(frames_without<kClearance>);
BENCHMARK(frames_without<kReadAhead>);
BENCHMARK(frames_without<kEdges>);
BENCHMARK(frames_without<kAheadOfStep>);
BENCHMARK(frames_without<kReady>);
BENCHMARK(frames_without<kWide>);

std::size_t free_since(const Scene& scene, std::size_t begin) {
  for (const auto& [first, last] : scene.free)
    if (last == begin) return first;
  return begin;
}

/// What StarContact answers to the same frames.
double as_shipped(const Scene& scene) {
  stars::StarContact contact;
  contact.attach(scene.mesh, scene.tree);
  contact.reset(scene.hip[0]);
  stars::StarCounters counters;
  double sum = 0.0;
  for (const auto& [begin, end] : scene.contact) {
    double of_run = 0.0;
    for (std::size_t k = begin; k < end; ++k) {
      // The free frames since the last contact come first.
      for (std::size_t f = k == begin && begin > 0 ? free_since(scene, begin) : k; f < k; ++f)
        (void)contact.update(scene.hip[f], counters);
      if (contact.update(scene.hip[k], counters))
        of_run += contact.pull().x() + contact.pull().y() + contact.pull().z();
    }
    sum += of_run;
  }
  return sum;
}

/// How far the sum of a pass may be off: the four numbers, and the foot on an edge that was crossed, round
/// otherwise than the facet's foot does; who
/// looks for the nearest facet finds another one where two are near.
double allowed(unsigned without) {
  constexpr double kRounding = 1e-12, kElsewhere = 1e-2;
  if ((without & kWarmStart) != 0) return kElsewhere;
  return (without & (kLinear | kCrossing | kEdges)) != 0 ? kRounding : 0.0;
}

/// For callgrind. False where frames differ from those with all ideas.
template <unsigned... kWithout>
bool count() {
  const Scene& scene = Scene::get();
  if (!__builtin_cpu_supports("avx2"))
    fmt::print(stderr, "frame_ideas: no AVX2 here: its line is the scalar one\n");
  const double all = one_pass<0>(scene);
  bool same = as_shipped(scene) == all;
  if (!same) fmt::print(stderr, "frame_ideas: the renderer's frames are others than those with all ideas\n");
  const auto one = [&](unsigned without, double sum) {
    if (std::abs(sum - all) <= allowed(without) * std::abs(all)) return;
    fmt::print(stderr, "frame_ideas: without {} frames are others: {} for {}\n", without, sum, all);
    same = false;
  };
  (one(kWithout, one_pass<kWithout>(scene)), ...);
  fmt::print("{} frames in contact, {} free; sum {}\n", frames_of(scene.contact), frames_of(scene.free), all);
  return same;
}

}  // namespace
}  // namespace palpate::benchmarks

int main(int argc, char** argv) {
  using namespace palpate::benchmarks;
  if (argc == 2 && std::string(argv[1]) == "counted")
    return count<kLinear, kCrossing, kWarmStart | kLinear, kRemembered | kClearance, kLanes, kLayers, kPacked,
                 kPacked | kTriangleBoxes, kClearance, kReadAhead, kEdges, kAheadOfStep, kReady, kWide>()
               ? 0
               : 1;
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
