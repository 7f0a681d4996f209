// Scenes, renderers and paths for the tests of renderers.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/stepped.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"
#include "toolkit/trace/paths.h"

namespace palpate::render {

struct Scene {
  SceneInput input;
  std::shared_ptr<const geometry::AnalyticSurface> surface;
  double spacing_mm = 0.0;
};

inline Scene generated(const std::string& spec) {
  Result<cloud::GeneratedModel> made = cloud::generate(parse_named_options(spec).value());
  if (!made) throw std::runtime_error(made.error().message());
  cloud::GeneratedModel model = std::move(*made);
  Scene scene;
  ModelInput input;
  input.name = spec;
  input.cloud = std::make_shared<cloud::Cloud>(std::move(model.cloud));
  input.analytic = model.surface;
  scene.input.models.push_back(input);
  scene.surface = model.surface;
  scene.spacing_mm = model.nominal_spacing_mm;
  return scene;
}

inline SceneInput cloud_of(const std::vector<Vec3>& points) {
  SceneInput scene;
  ModelInput input;
  input.cloud = std::make_shared<cloud::Cloud>(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value());
  scene.models.push_back(input);
  return scene;
}

inline test::Stepped prepared(const SceneInput& scene, const std::string& spec, int threads = 1) {
  Registry registry;
  register_toolkit_renderers(registry);
  const NamedOptions named = parse_named_options(spec).value();
  auto renderer = registry.make(named.name, named.options).value();
  const auto report = renderer->prepare(scene, {threads, nullptr});
  EXPECT_TRUE(report) << (report ? "" : report.error().message());
  return renderer;
}

inline trace::ProbePath path_over(const Scene& scene, const std::string& spec) {
  trace::PathTarget target;
  target.surface = scene.surface.get();
  target.cloud = scene.input.models[0].cloud.get();
  target.box_mm = target.cloud->box_mm();
  target.spacing_mm = scene.spacing_mm;
  target.world_from_model = scene.input.models[0].world_from_model;
  Result<trace::ProbePath> path = trace::make_path(parse_named_options(spec).value(), target);
  if (!path) throw std::runtime_error(path.error().message());
  return std::move(*path);
}

/// A plane of 40 x 40 mm, z = 0 in its middle, put at `at`.
inline ModelInput plane_at(const Vec3& at, double spacing_mm = 0.5) {
  Scene scene = generated("plane:extent_mm=40:spacing_mm=" + std::to_string(spacing_mm));
  ModelInput input = scene.input.models[0];
  const geometry::Aabb box = input.cloud->box_mm();
  input.world_from_model.translation_mm = at - 0.5 * (box.low_mm + box.high_mm);
  return input;
}

/// The renderer on the scene's own clock.
inline test::Stepped on_clock(const SceneInput& scene, const std::string& spec) {
  test::Stepped renderer = prepared(scene, spec);
  renderer->drive(scene.simulation);
  return renderer;
}

}  // namespace palpate::render
