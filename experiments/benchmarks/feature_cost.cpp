// One scene's frames, some times over, and nothing else: what instruction counters run (feature_costs).
//
//   feature_cost FEATURES REPEATS [timed]      FEATURES: bare, or of friction, varied, texture, soft, many,
//   joined by
//   +
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>

#include "toolkit/cloud/generate.h"
#include "toolkit/core/clock.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"
#include "toolkit/trace/paths.h"

namespace palpate {
namespace {

bool asks(std::string_view features, std::string_view one) {
  return features.find(one) != std::string_view::npos;
}

render::SceneInput scene_of(std::string_view features, cloud::GeneratedModel& made) {
  render::ModelInput model;
  model.cloud = std::make_shared<const cloud::Cloud>(made.cloud);
  model.analytic = made.surface;
  surface::Surface& s = model.surface;
  if (asks(features, "soft")) s.deformation = 0.5;
  if (asks(features, "friction")) s.friction = {0.7, 0.5};
  if (asks(features, "texture")) {
    s.texture.kind = surface::TextureKind::kNoise;
    s.texture.depth_mm = 0.1;
    s.texture.wavelength_mm = 2.0;
  }
  if (asks(features, "varied")) {
    auto p = std::make_shared<surface::PointProperties>();
    for (std::size_t i = 0; i < made.cloud.size(); ++i)
      p->deformation.push_back(made.cloud.x_mm[i] > 0.0f ? 0.5f : 0.0f);
    s.per_point = p;
  }
  render::SceneInput scene;
  scene.models.push_back(model);
  if (asks(features, "many"))
    for (int i = 1; i < 100; ++i) {
      scene.models.push_back(model);
      scene.models.back().world_from_model.translation_mm.x() = 300.0 * i;
    }
  return scene;
}

/// `timed` reads the clock around each pass: then no two runs execute the same instructions.
int run(std::string_view features, int repeats, bool timed) {
  auto made = cloud::generate(parse_named_options("sinusoid:points=10201").value());
  if (!made) return 1;
  const render::SceneInput scene = scene_of(features, *made);
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  auto renderer = registry.make("cloud", {});
  if (!renderer || !(*renderer)->prepare(scene, {1, nullptr})) return 1;
  trace::PathTarget target;
  target.surface = made->surface.get();
  target.cloud = scene.models[0].cloud.get();
  target.box_mm = target.cloud->box_mm();
  target.spacing_mm = made->nominal_spacing_mm;
  const auto path = trace::make_path(parse_named_options("weave:frames=4500").value(), target);
  if (!path) return 1;
  Vec3 sum = Vec3::Zero();
  std::int64_t fastest_ns = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < repeats; ++i) {
    (*renderer)->restart(path->hip_mm[0], -path->t_s[1]);
    const std::int64_t start_ns = timed ? monotonic_ns() : 0;
    for (std::size_t k = 0; k < path->size(); ++k)
      sum += (*renderer)->step(path->hip_mm[k], path->t_s[k]).force_n;
    if (timed) fastest_ns = std::min(fastest_ns, monotonic_ns() - start_ns);
  }
  // Printed, so that the frames are not optimised away, and so that two runs can be seen to do the same: as
  // bits, whose printing takes the same instructions whatever they are.
  const auto bits = [](double x) { return std::bit_cast<std::uint64_t>(x); };
  fmt::print("{} frames, bits of the sum of forces {:016x} {:016x} {:016x}\n",
             path->hip_mm.size() * static_cast<std::size_t>(repeats), bits(sum.x()), bits(sum.y()),
             bits(sum.z()));
  if (timed)
    fmt::print("fastest pass: {:.4f} us a frame\n",
               1e-3 * static_cast<double>(fastest_ns) / static_cast<double>(path->hip_mm.size()));
  return 0;
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) {
  const bool timed = argc == 4 && std::string_view(argv[3]) == "timed";
  if (argc != 3 && !timed) {
    fmt::print(stderr, "usage: feature_cost FEATURES REPEATS [timed]\n");
    return 2;
  }
  return palpate::run(argv[1], std::atoi(argv[2]), timed);
}
