// Rivals on small models, to be stepped by hand.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <palpate/baselines.h>
#include <palpate/generate.h>
#include <palpate/registry.h>
#include "tests/baselines/meshes.h"
#include "tests/stepped.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"

namespace palpate::test {

inline constexpr double kStiffness = 0.5;
inline constexpr double kDt = 1e-3;

struct Probe {
  test::Stepped renderer;
  render::PrepareReport report;

  render::Frame to(const Vec3& hip) const { return renderer->step(hip, kDt); }
  /// In straight steps of at most `step_mm`.
  render::Frame glide(const Vec3& from, const Vec3& to_mm, double step_mm) const {
    const int steps = std::max(1, static_cast<int>(std::ceil((to_mm - from).norm() / step_mm)));
    render::Frame frame;
    for (int i = 1; i <= steps; ++i) frame = to(from + (to_mm - from) * (double(i) / steps));
    return frame;
  }
  /// The same, free at `from`.
  render::Frame press(const Vec3& from, const Vec3& to_mm, double step_mm) const {
    renderer->restart(from);
    return glide(from, to_mm, step_mm);
  }
};

inline cloud::Cloud cloud_of(const std::vector<Vec3>& points) {
  return value_of(cloud::build_cloud(points, cloud::NonFinite::kRefuse));
}
inline std::vector<Vec3> points_of(const cloud::Cloud& cloud) {
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < cloud.size(); ++i) points.push_back(cloud.point_mm(i));
  return points;
}
inline render::ModelInput model_of(cloud::Cloud cloud) {
  render::ModelInput model;
  model.name = "test";
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(cloud));
  model.surface.stiffness_n_per_mm = kStiffness;
  return model;
}
inline render::ModelInput model_of(const std::vector<Vec3>& points) {
  return model_of(cloud_of(points));
}
/// At rest, its points the mesh's vertices.
inline render::ModelInput model_of(const TriangleMesh& mesh) {
  render::ModelInput model = model_of(mesh.vertices_mm);
  model.original_mesh = std::make_shared<const TriangleMesh>(mesh);
  return model;
}
inline render::SceneInput scene_of(const render::ModelInput& model) {
  render::SceneInput scene;
  scene.models.push_back(model);
  return scene;
}

/// A rival by name and options, or why there is none.
inline Result<std::unique_ptr<render::HapticRenderer>> made(const std::string& options) {
  render::Registry registry;
  baselines::register_baseline_renderers(registry);
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(options));
  return registry.make(named.name, named.options);
}
inline test::Stepped rival(const std::string& options) {
  return value_of(made(options));
}
/// Why a scene is not prepared; there must be a reason with a remedy.
inline Error refusal(const std::string& options, const render::SceneInput& scene) {
  const auto report = rival(options)->prepare(scene, {});
  EXPECT_FALSE(report.ok()) << options;
  if (report.ok()) return {};
  EXPECT_FALSE(report.error().remedy.empty()) << report.error().message();
  return report.error();
}
inline Probe prepare(const render::SceneInput& scene, const std::string& options, int threads = 1) {
  Probe probe{rival(options), {}};
  probe.report = value_of(probe.renderer->prepare(scene, {threads, nullptr}));
  return probe;
}
inline Probe prepare(const render::ModelInput& model, const std::string& options, int threads = 1) {
  return prepare(scene_of(model), options, threads);
}
inline Probe make(const TriangleMesh& mesh, const std::string& options = "mesh-godobject:mesh=original",
                  const geometry::RigidTransform& pose = {}, double limit_n = 0.0) {
  render::SceneInput scene = scene_of(model_of(mesh));
  scene.force_limit_n = limit_n;
  scene.models[0].world_from_model = pose;
  return prepare(scene, options);
}
inline cloud::GeneratedModel generated(const std::string& generator) {
  return cloud::generate(parse_named_options(generator).value()).value();
}

/// A square grid of `n` x `n` points, `spacing` apart, on z = f(x, y).
template <class F>
std::vector<Vec3> height_points(int n, double spacing, F&& f, double jitter = 0.0) {
  Random random(5);
  std::vector<Vec3> points;
  for (int row = 0; row < n; ++row)
    for (int column = 0; column < n; ++column) {
      const double x = (column - 0.5 * (n - 1) + jitter * random.uniform(-1.0, 1.0)) * spacing;
      const double y = (row - 0.5 * (n - 1) + jitter * random.uniform(-1.0, 1.0)) * spacing;
      points.push_back({x, y, f(x, y)});
    }
  return points;
}

/// The same on z = 0.
inline std::vector<Vec3> flat_points(int n, double spacing) {
  return height_points(n, spacing, [](double, double) { return 0.0; });
}

/// The surface point wanders; the HIP goes `depth` in and as much out along the normal there, five times.
inline std::vector<Vec3> weaving(const geometry::AnalyticSurface& surface, std::size_t frames, double depth) {
  constexpr double kPi = 3.14159265358979323846;
  std::vector<Vec3> path;
  for (std::size_t i = 0; i < frames; ++i) {
    const double t = static_cast<double>(i) / static_cast<double>(frames);
    const auto at = surface.at(0.5 + 0.3 * std::sin(1.2 * t), 0.5 + 0.3 * std::sin(1.9 * t));
    path.push_back(at.point_mm + depth * std::cos(2.0 * kPi * 5.0 * t) * at.normal);
  }
  return path;
}

/// A generated model, a path that weaves over it, and its formula.
struct Sampled {
  render::ModelInput model;
  std::vector<Vec3> path;
  std::shared_ptr<const geometry::AnalyticSurface> surface;
};
inline Sampled sampled(const std::string& generator, double depth) {
  auto made = generated(generator + ":mesh=false");
  return {model_of(made.cloud), weaving(*made.surface, 4000, depth), made.surface};
}

struct Score {
  double relative = 0.0;  ///< RMS of the force error over that of the true force
  int missed = 0, false_frames = 0, contacts = 0;
};
/// `sure_mm`: so deep, or so far outside, a force must be there, or not.
inline Score score(const Sampled& set, const std::string& rival, double sure_mm) {
  const Probe probe = prepare(set.model, rival, 0);
  probe.renderer->restart(set.path.front());
  Score found;
  double error = 0.0, size = 0.0;
  for (const Vec3& hip : set.path) {
    const render::Frame frame = probe.to(hip);
    const double d = set.surface->signed_distance_mm(hip);
    const Vec3 truth =
        d < 0.0 ? Vec3(kStiffness * (set.surface->closest(hip).point_mm - hip)) : Vec3(Vec3::Zero());
    error += (frame.force_n - truth).squaredNorm();
    size += truth.squaredNorm();
    found.missed += d < -sure_mm && !frame.contact;
    found.false_frames += d > sure_mm && frame.contact;
    found.contacts += frame.contact;
  }
  found.relative = std::sqrt(error / size);
  return found;
}

inline void expect_near(const Vec3& a, const Vec3& b, double tolerance) {
  EXPECT_LT((a - b).norm(), tolerance) << a.transpose() << " against " << b.transpose();
}

/// In contact, with the god object there.
inline void expect_held(const render::Frame& frame, const Vec3& god_object_mm, double tolerance) {
  EXPECT_TRUE(frame.contact);
  expect_near(frame.god_object_mm, god_object_mm, tolerance);
}

/// The name of a parametrised test of a renderer: its letters and digits.
inline std::string test_name(const testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name;
}

}  // namespace palpate::test
