// Frames of every toolkit renderer on a fixed scene, between callgrind marks; see
// tests/experiments/frame_instructions_test.cpp. Omits renderers on Embree, CGAL or PCL, which choose
// instructions by processor.
//
//   frame_instructions        marks each as NAME FRAMES
//   frame_instructions names  the names alone
#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/registry.h>
#include "experiments/benchmarks/generated_scene.h"
#include "toolkit/core/instruction_counter.h"

namespace {

using namespace palpate;

// Random points and a raster; many frames make a path's start negligible.
constexpr const char* kCloud =
    "sinusoid:points=2601:extent_mm=20:wavelength_mm=20:amplitude_mm=1:sampling=random:seed=3";
constexpr const char* kRaster = "sinusoid:points=2601:extent_mm=20:wavelength_mm=20:amplitude_mm=1";
constexpr const char* kPath = "weave:frames=3600:depth_mm=0.5:clearance_mm=0.3:period_frames=300";

struct Counted {
  const char* name;  ///< as after --renderers
  const char* scene;
};
constexpr Counted kCounted[] = {
    {"cloud", kCloud},        {"cloud-smooth", kCloud},         {"cloud-literal", kRaster},
    {"heightfield", kRaster}, {"heightfield-literal", kRaster},
};

int count(const Counted& counted, const render::Registry& registry) {
  auto scene = experiments::generated_scene(counted.scene, kPath);
  if (!scene) return 1;
  // Points alone.
  scene->input.models.front().original_mesh = nullptr;
  scene->input.models.front().analytic = nullptr;
  const NamedOptions named = parse_named_options(counted.name).value();
  auto renderer = registry.make(named.name, named.options);
  if (!renderer || !(*renderer)->prepare(scene->input, {1, nullptr})) return 1;
  const trace::ProbePath& path = scene->path;
  (*renderer)->restart(path.hip_mm[0], -path.t_s[1]);
  render::HapticRenderer& counting = **renderer;
  begin_counting();
  for (std::size_t k = 0; k < path.size(); ++k) (void)counting.step(path.hip_mm[k], path.t_s[k]);
  end_counting(fmt::format("{} {}", counted.name, path.size()).c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::string_view(argv[1]) == "names") {
    for (const Counted& counted : kCounted) fmt::print("{}\n", counted.name);
    return 0;
  }
  if (argc != 1) {
    fmt::print(stderr, "usage: frame_instructions [names]\n");
    return 2;
  }
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  for (const Counted& counted : kCounted)
    if (const int status = count(counted, registry); status != 0) {
      fmt::print(stderr, "frame_instructions: {} cannot be prepared\n", counted.name);
      return status;
    }
  return 0;
}
