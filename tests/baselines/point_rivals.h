// Helpers of the tests of point-based rivals.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "baselines/register.h"
#include "tests/stepped.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/random.h"

namespace palpate::test {

inline constexpr double kStiffness = 0.5;
inline constexpr double kDt = 1e-3;

inline cloud::Cloud cloud_of(const std::vector<Vec3>& points) {
  auto built = cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  EXPECT_TRUE(built.ok());
  return std::move(built).value();
}

inline render::ModelInput model_of(cloud::Cloud cloud) {
  render::ModelInput model;
  model.name = "test";
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(cloud));
  model.surface.stiffness_n_per_mm = kStiffness;
  return model;
}

inline test::Stepped rival(const std::string& options) {
  render::Registry registry;
  baselines::register_baseline_renderers(registry);
  const auto named = parse_named_options(options);
  EXPECT_TRUE(named.ok());
  auto made = registry.make(named->name, named->options);
  EXPECT_TRUE(made.ok()) << made.error().message();
  return std::move(made).value();
}

struct Prepared {
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
};

inline Prepared prepare(const render::ModelInput& model, const std::string& options, int threads = 1) {
  Prepared made{rival(options), {}};
  render::SceneInput scene;
  scene.models.push_back(model);
  auto report = made.renderer->prepare(scene, {threads, nullptr});
  EXPECT_TRUE(report.ok()) << (report.ok() ? "" : report.error().message());
  if (report.ok()) made.report = *report;
  return made;
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

}  // namespace palpate::test
