// Clouds with exact truths for `cloud-smooth`, and how a path over them is scored.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

namespace palpate::spline_sdf {

inline constexpr double kTestStiffness = 0.5;  // N/mm, the default

/// A closed surface: the signed distance of a place, and its foot.
using Truth = std::function<double(const Vec3&, Vec3&)>;

struct TorusSpec {
  std::size_t points = 60000;
  double noise = 0.0;     ///< spacings
  double outliers = 0.0;  ///< share
  double scale = 1.0;
  Vec3 at = Vec3::Zero();
};
inline constexpr double kRing = 15.0, kTube = 6.0;

inline double torus_spacing(const TorusSpec& t) {
  return t.scale *
         std::sqrt(4.0 * std::numbers::pi * std::numbers::pi * kRing * kTube / static_cast<double>(t.points));
}

inline std::vector<Vec3> torus_points(const TorusSpec& t) {
  Random random(7);
  std::vector<Vec3> points;
  while (points.size() < t.points) {
    const double a = 2.0 * std::numbers::pi * random.uniform(), b = 2.0 * std::numbers::pi * random.uniform();
    if (random.uniform() * (kRing + kTube) > kRing + kTube * std::cos(b)) continue;
    const double r = kTube + t.noise * torus_spacing(t) / t.scale * random.normal();
    Vec3 p((kRing + r * std::cos(b)) * std::cos(a), (kRing + r * std::cos(b)) * std::sin(a), r * std::sin(b));
    if (random.uniform() < t.outliers)
      p = Vec3{random.uniform() - 0.5, random.uniform() - 0.5, 0.4 * (random.uniform() - 0.5)} *
          (2.2 * (kRing + kTube));
    points.push_back(t.at + t.scale * p);
  }
  return points;
}

inline Truth torus_truth(const TorusSpec& t) {
  return [t](const Vec3& x, Vec3& closest) {
    const Vec3 d = (x - t.at) / t.scale;
    const double across = std::hypot(d.x(), d.y());
    const Vec3 ring(d.x() / across * kRing, d.y() / across * kRing, 0.0);
    const Vec3 out = d - ring;
    closest = t.at + t.scale * (ring + out * (kTube / out.norm()));
    return t.scale * (out.norm() - kTube);
  };
}

/// Over the torus: from 0.4 mm outside to 1.8 mm inside, 900 frames to and fro.
inline std::vector<Vec3> torus_path(const TorusSpec& t, std::size_t frames) {
  std::vector<Vec3> path;
  for (std::size_t k = 0; k < frames; ++k) {
    const double s = static_cast<double>(k), a = 0.0018 * s, b = 0.0065 * s;
    const double h = 1.1 * std::cos(2.0 * std::numbers::pi * s / 900.0) - 0.7;
    const double r = kTube + h;
    path.push_back(t.at + t.scale * Vec3((kRing + r * std::cos(b)) * std::cos(a),
                                         (kRing + r * std::cos(b)) * std::sin(a), r * std::sin(b)));
  }
  return path;
}

inline Truth sphere_truth(double radius) {
  return [radius](const Vec3& x, Vec3& closest) {
    closest = x * (radius / x.norm());
    return x.norm() - radius;
  };
}

/// Over a sphere: from 0.4 mm outside to 1.8 mm inside, 900 frames to and fro.
inline std::vector<Vec3> sphere_path(double radius, std::size_t frames) {
  std::vector<Vec3> path;
  for (std::size_t k = 0; k < frames; ++k) {
    const double s = static_cast<double>(k), a = 0.003 * s, b = 1.2 * std::sin(0.0011 * s);
    const double h = 1.1 * std::cos(2.0 * std::numbers::pi * s / 900.0) - 0.7;
    path.push_back((radius + h) * Vec3(std::cos(a) * std::cos(b), std::sin(a) * std::cos(b), std::sin(b)));
  }
  return path;
}

struct Score {
  double rms_percent = 0.0;
  int missed = 0, false_ones = 0, jumps = 0, bounds = 0;
};

/// Frames beyond `slack` mm count as missed or false; a jump is one that a hand feels and the truth has not.
inline Score score(test::Stepped& renderer, const std::vector<Vec3>& path, const Truth& truth, double slack,
                   double felt_n = 0.0275) {
  Score out;
  double error = 0.0, size = 0.0;
  Vec3 last = Vec3::Zero(), last_true = Vec3::Zero();
  renderer->restart(path.front());
  for (const Vec3& h : path) {
    const render::Frame frame = renderer->step(h, 0.001);
    Vec3 closest;
    const double d = truth(h, closest);
    const Vec3 force = d < 0.0 ? Vec3(kTestStiffness * (closest - h)) : Vec3(Vec3::Zero());
    if (d < 0.0) {
      error += (frame.force_n - force).squaredNorm();
      size += force.squaredNorm();
    }
    out.missed += d < -slack && !frame.contact;
    out.false_ones += d > slack && frame.contact;
    out.jumps += (frame.force_n - last).norm() - (force - last_true).norm() > felt_n;
    out.bounds += frame.status != render::FrameStatus::kOk;
    last = frame.force_n;
    last_true = force;
  }
  out.rms_percent = 100.0 * std::sqrt(error / size);
  return out;
}

inline void expect_kept(const Score& s) {
  EXPECT_EQ(s.missed, 0);
  EXPECT_EQ(s.false_ones, 0);
  EXPECT_EQ(s.bounds, 0);
}

inline Score torus_score(const TorusSpec& t, const std::string& spec = "cloud-smooth",
                         std::size_t frames = 9000) {
  test::Stepped renderer = render::prepared(render::cloud_of(torus_points(t)), spec, 2);
  return score(renderer, torus_path(t, frames), torus_truth(t), 0.1 * t.scale, 0.0275 * t.scale);
}

/// Edges and parts of different density: bricks of several sizes.
inline std::shared_ptr<const cloud::Cloud> block_cloud() {
  Random random(5);
  std::vector<Vec3> points;
  for (int i = 0; i < 10000; ++i) {
    Vec3 p(20.0 * random.uniform(), 20.0 * random.uniform(), 20.0 * random.uniform());
    const int face = static_cast<int>(6.0 * random.uniform());
    p[face / 2] = face % 2 == 0 ? 0.0 : 20.0;
    // A quarter of the points on one half.
    if (p.x() > 10.0 && random.uniform() > 0.25) continue;
    points.push_back(p);
  }
  return render::cloud_of(points).models.front().cloud;
}

inline std::shared_ptr<const SplineSdf> surface_of(const std::shared_ptr<const cloud::Cloud>& cloud) {
  render::PrepareReport report;
  return build_spline_sdf(*cloud, {}, {2, nullptr}, report).value();
}

}  // namespace palpate::spline_sdf
