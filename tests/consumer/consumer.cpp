// A whole application: generated points, a renderer by name, a hundred frames, the force printed.
#include <cstdio>
#include <memory>

#include <palpate/generate.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#ifdef CONSUMER_BASELINES
#include <palpate/baselines.h>
#endif
#ifdef CONSUMER_DEVICE
#include "device.h"
#endif

namespace {

int failed(const palpate::Error& error) {
  std::fprintf(stderr, "%s\n", error.message().c_str());
  return 1;
}

// Down along the normal at the middle of the model, from 1 mm outside to 1 mm inside.
int press(const palpate::render::Registry& registry, const char* name,
          const palpate::render::SceneInput& scene) {
  auto renderer = registry.make(name, {});
  if (!renderer) return failed(renderer.error());
  const auto prepared = (*renderer)->prepare(scene, {});
  if (!prepared) return failed(prepared.error());

  const auto middle = scene.models[0].analytic->at(0.5, 0.5);
  (*renderer)->restart(middle.point_mm + middle.normal, 0.0);
  palpate::render::Frame frame;
  for (int i = 0; i <= 100; ++i)
    frame = (*renderer)->step(middle.point_mm + (1.0 - 0.02 * i) * middle.normal, 1e-3 * (i + 1));
  std::printf("%s, 1 mm deep: contact %d, force %.3f N\n", name, frame.contact ? 1 : 0, frame.force_n.norm());
  // A spring of 0.5 N/mm, pressed by 1 mm: half a newton, outward, up to the spacing of the points.
  return frame.contact && frame.force_n.dot(middle.normal) > 0.25 && frame.force_n.norm() < 1.0 ? 0 : 1;
}

}  // namespace

int main() {
  const auto spec = palpate::parse_named_options("sinusoid:points=10201");
  if (!spec) return failed(spec.error());
  auto model = palpate::cloud::generate(*spec);
  if (!model) return failed(model.error());

  palpate::render::SceneInput scene;
  scene.models.resize(1);
  scene.models[0].name = "sinusoid";
  scene.models[0].analytic = model->surface;
  scene.models[0].original_mesh = model->original_mesh;
  scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(std::move(model->cloud));

  palpate::render::Registry registry;
  palpate::render::register_toolkit_renderers(registry);
  int status = press(registry, "cloud", scene);
#ifdef CONSUMER_BASELINES
  palpate::baselines::register_baseline_renderers(registry);
  status |= press(registry, "mesh-godobject", scene);
#endif
#ifdef CONSUMER_DEVICE
  auto renderer = registry.make("cloud", {});
  if (!renderer) return failed(renderer.error());
  const auto prepared = (*renderer)->prepare(scene, {});
  if (!prepared) return failed(prepared.error());
  const auto middle = scene.models[0].analytic->at(0.5, 0.5);
  status |= hold(**renderer, middle.point_mm, middle.normal);
#endif
  return status;
}
