// A generated model and a weave path, for servo benchmarks.
#pragma once

#include <fmt/format.h>

#include <memory>
#include <string>
#include <utility>

#include <palpate/generate.h>
#include <palpate/options.h>
#include <palpate/paths.h>
#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::experiments {

struct WeaveScene {
  render::SceneInput input;
  trace::ProbePath path;
};

/// `generator` in scene syntax, such as sinusoid:points=10201; 1 mm deep.
inline Result<WeaveScene> weave_scene(const std::string& generator, long long frames) {
  WeaveScene scene;
  PALPATE_ASSIGN(const NamedOptions spec, parse_named_options(generator));
  PALPATE_ASSIGN(cloud::GeneratedModel generated, cloud::generate(spec));
  render::ModelInput model;
  model.name = spec.name;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(generated.cloud));
  model.original_mesh = generated.original_mesh;
  model.analytic = generated.surface;
  paths::PathTarget target;
  target.surface = model.analytic.get();
  target.cloud = model.cloud.get();
  target.box_mm = model.cloud->box_mm();
  PALPATE_ASSIGN(const NamedOptions weave,
                 parse_named_options(fmt::format("weave:frames={}:depth_mm=1", frames)));
  PALPATE_ASSIGN(scene.path, paths::make_path(weave, target));
  scene.input.models.push_back(std::move(model));
  return scene;
}

}  // namespace palpate::experiments
