// Scenes, renderers and paths for the tests of renderers.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <palpate/generate.h>
#include <palpate/paths.h>
#include <palpate/registry.h>
#include "tests/stepped.h"

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

inline const Registry& toolkit_renderers() {
  static const Registry all = [] {
    Registry registry;
    register_toolkit_renderers(registry);
    return registry;
  }();
  return all;
}

inline std::unique_ptr<HapticRenderer> renderer_of(const std::string& spec) {
  const NamedOptions named = parse_named_options(spec).value();
  return toolkit_renderers().make(named.name, named.options).value();
}

inline Result<PrepareReport> prepare_report(const SceneInput& scene, const std::string& spec,
                                            int threads = 1) {
  return renderer_of(spec)->prepare(scene, {threads, nullptr});
}

inline test::Stepped prepared(const SceneInput& scene, const std::string& spec, int threads = 1) {
  auto renderer = renderer_of(spec);
  const auto report = renderer->prepare(scene, {threads, nullptr});
  EXPECT_TRUE(report) << (report ? "" : report.error().message());
  return renderer;
}

/// In a straight line in `frames` equal steps; the last frame, at `to`.
inline Frame glide(const test::Stepped& renderer, const Vec3& from, const Vec3& to, int frames = 2000) {
  Frame frame;
  for (int i = 0; i <= frames; ++i)
    frame = renderer->step(from + (to - from) * (static_cast<double>(i) / frames), 1e-3);
  return frame;
}

/// Steps of at most `step_mm` from the last place to `to`; the last frame.
inline Frame move(const test::Stepped& renderer, Vec3& at, const Vec3& to, double step_mm) {
  const Vec3 from = std::exchange(at, to);
  const double steps = std::max(1.0, std::ceil((to - from).norm() / step_mm));
  Frame frame;
  for (double k = 1.0; k <= steps; ++k) frame = renderer->step(from + (k / steps) * (to - from), 1e-3);
  return frame;
}

inline trace::ProbePath path_over(const Scene& scene, const std::string& spec) {
  paths::PathTarget target;
  target.surface = scene.surface.get();
  target.cloud = scene.input.models[0].cloud.get();
  target.box_mm = target.cloud->box_mm();
  target.spacing_mm = scene.spacing_mm;
  target.world_from_model = scene.input.models[0].world_from_model;
  Result<trace::ProbePath> path = paths::make_path(parse_named_options(spec).value(), target);
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
