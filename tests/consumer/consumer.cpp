// A whole application: generated points, a renderer by name, a hundred frames, the force printed.
#include <cstdio>
#include <memory>

#include "toolkit/cloud/generate.h"
#include "toolkit/core/options.h"
#include "toolkit/render/registry.h"

int main() {
  const auto spec = palpate::parse_named_options("sinusoid:points=10201");
  if (!spec) return 1;
  auto model = palpate::cloud::generate(*spec);
  if (!model) {
    std::fprintf(stderr, "%s\n", model.error().message().c_str());
    return 1;
  }

  palpate::render::SceneInput scene;
  scene.models.resize(1);
  scene.models[0].name = "sinusoid";
  const auto surface = model->surface;
  scene.models[0].analytic = surface;
  scene.models[0].original_mesh = model->original_mesh;
  scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(std::move(model->cloud));

  palpate::render::Registry registry;
  palpate::render::register_toolkit_renderers(registry);
  auto renderer = registry.make("cloud", {});
  if (!renderer) {
    std::fprintf(stderr, "%s\n", renderer.error().message().c_str());
    return 1;
  }
  const auto prepared = (*renderer)->prepare(scene, {});
  if (!prepared) {
    std::fprintf(stderr, "%s\n", prepared.error().message().c_str());
    return 1;
  }

  // Down along the normal at the middle of the model, from 1 mm outside to 1 mm inside.
  const auto middle = surface->at(0.5, 0.5);
  (*renderer)->reset(middle.point_mm + middle.normal);
  palpate::render::Frame frame;
  for (int i = 0; i <= 100; ++i)
    frame = (*renderer)->step(middle.point_mm + (1.0 - 0.02 * i) * middle.normal, 1e-3);
  std::printf("1 mm deep: contact %d, force %.3f N\n", frame.contact ? 1 : 0, frame.force_n.norm());
  // A spring of 0.5 N/mm, pressed by 1 mm: half a newton, outward, up to the spacing of the points.
  return frame.contact && frame.force_n.dot(middle.normal) > 0.25 && frame.force_n.norm() < 1.0 ? 0 : 1;
}
