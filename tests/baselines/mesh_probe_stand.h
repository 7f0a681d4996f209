// A mesh renderer with one model, to be stepped by hand.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

#include "baselines/register.h"
#include "tests/baselines/meshes.h"
#include "toolkit/cloud/cloud.h"
#include "toolkit/render/registry.h"

namespace palpate::test {

inline constexpr double kStiffness = 0.5;
inline constexpr double kDt = 1e-3;

struct Probe {
  std::unique_ptr<render::HapticRenderer> renderer;
  render::PrepareReport report;
  render::Frame to(const Vec3& hip) { return renderer->step(hip, kDt); }
  /// In straight steps of `step_mm`.
  render::Frame glide(const Vec3& from, const Vec3& to_mm, double step_mm) {
    const int steps = std::max(1, static_cast<int>(std::ceil((to_mm - from).norm() / step_mm)));
    render::Frame frame;
    for (int i = 1; i <= steps; ++i) frame = to(from + (to_mm - from) * (double(i) / steps));
    return frame;
  }
};

/// At rest, its points the mesh's vertices.
inline render::ModelInput model_of(const geometry::TriangleMesh& mesh) {
  render::ModelInput model;
  model.name = "test";
  auto cloud = cloud::build_cloud(mesh.vertices_mm, cloud::NonFinite::kRefuse);
  EXPECT_TRUE(cloud.ok());
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(cloud).value());
  model.original_mesh = std::make_shared<const geometry::TriangleMesh>(mesh);
  model.surface.stiffness_n_per_mm = kStiffness;
  return model;
}

inline Probe make_scene(const render::SceneInput& scene, const char* options) {
  render::Registry registry;
  baselines::register_baseline_renderers(registry);
  const auto named = parse_named_options(options);
  EXPECT_TRUE(named.ok());
  auto made = registry.make(named->name, named->options);
  EXPECT_TRUE(made.ok());
  Probe probe{std::move(made).value(), {}};
  auto report = probe.renderer->prepare(scene, {1, nullptr});
  EXPECT_TRUE(report.ok()) << (report.ok() ? "" : report.error().message());
  if (report.ok()) probe.report = *report;
  return probe;
}

inline Probe make(const geometry::TriangleMesh& mesh, const char* options = "mesh-godobject:mesh=original",
                  const geometry::RigidTransform& pose = {}, double limit_n = 0.0) {
  render::SceneInput scene;
  scene.force_limit_n = limit_n;
  scene.models.push_back(model_of(mesh));
  scene.models[0].world_from_model = pose;
  return make_scene(scene, options);
}

inline void expect_near(const Vec3& a, const Vec3& b, double tolerance) {
  EXPECT_LT((a - b).norm(), tolerance) << a.transpose() << " against " << b.transpose();
}

}  // namespace palpate::test
