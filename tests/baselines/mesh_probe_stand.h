// A mesh renderer with one model, to be stepped by hand.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

#include "baselines/register.h"
#include "tests/baselines/meshes.h"
#include "tests/stepped.h"
#include "toolkit/cloud/cloud.h"
#include "toolkit/render/registry.h"

namespace palpate::test {

inline constexpr double kStiffness = 0.5;
inline constexpr double kDt = 1e-3;

struct Probe {
  test::Stepped renderer;
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

/// A mesh renderer by name and options, or why there is none.
inline Result<std::unique_ptr<render::HapticRenderer>> made(const char* options) {
  render::Registry registry;
  baselines::register_baseline_renderers(registry);
  const auto named = parse_named_options(options);
  if (!named.ok()) return named.error();
  return registry.make(named->name, named->options);
}

inline Probe make_scene(const render::SceneInput& scene, const char* options) {
  auto renderer = made(options);
  EXPECT_TRUE(renderer.ok()) << (renderer.ok() ? "" : renderer.error().message());
  Probe probe{std::move(renderer).value(), {}};
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

/// Along the sinusoid 1.5 mm below it, in steps of `step_mm`: the most that the force's direction turns in
/// one.
inline double largest_turn(Probe& probe, double step_mm) {
  const auto below = [](double x) { return Vec3(x, 3, sinusoid(x, 3) - 1.5); };
  probe.renderer->restart({-20, 3, 30});
  Vec3 last = probe.glide({-20, 3, 30}, below(-20), 0.1).force_n;
  double most = 0.0;
  for (double x = -20; x < 20; x += step_mm) {
    const Vec3 force = probe.to(below(x)).force_n;
    most = std::max(most, (force.normalized() - last.normalized()).norm());
    last = force;
  }
  return most;
}

/// On facets the force turns at once where the god object crosses an edge, however small the step. Shaded it
/// turns there by the second pass alone: the target is put back on to the facet, off the shading normal by
/// the square of the sine of the angle between the two, about half of the edge's, on either side.
inline void expect_shading_to_smooth_edges(const std::string& renderer, double carriers) {
  const geometry::TriangleMesh coarse = height_mesh(30, 50.0, sinusoid);
  Probe bare = make(coarse, renderer.c_str());
  Probe shaded = make(coarse, (renderer + ":shading=interpolated").c_str());
  const double edge = largest_turn(bare, 0.02);
  EXPECT_GT(edge, 0.05) << "the facets' edges are felt";
  EXPECT_GT(largest_turn(bare, 0.005), 0.9 * edge);
  const double half = std::sin(0.5 * edge);
  EXPECT_LT(largest_turn(shaded, 0.02), carriers * 2.0 * half * half);
  EXPECT_LT(largest_turn(shaded, 0.005), carriers * 2.0 * half * half);
}

inline void expect_near(const Vec3& a, const Vec3& b, double tolerance) {
  EXPECT_LT((a - b).norm(), tolerance) << a.transpose() << " against " << b.transpose();
}

}  // namespace palpate::test
