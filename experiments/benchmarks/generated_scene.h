// A generated model and a path over it, for programs that measure.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include <palpate/generate.h>
#include <palpate/options.h>
#include <palpate/paths.h>
#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::experiments {

struct GeneratedScene {
  render::SceneInput input;
  trace::ProbePath path;
};

/// A generator and a path as on the command line: "sinusoid:points=10201", "weave:frames=600".
inline Result<GeneratedScene> generated_scene(const std::string& generator, const std::string& path) {
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
  GeneratedScene scene;
  PALPATE_ASSIGN(const NamedOptions way, parse_named_options(path));
  PALPATE_ASSIGN(scene.path, paths::make_path(way, target));
  scene.input.models.push_back(std::move(model));
  return scene;
}

}  // namespace palpate::experiments
