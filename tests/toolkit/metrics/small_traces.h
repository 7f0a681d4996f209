// Traces for scores worked out by hand: the truth is the half space z < 0 at 0.5 N/mm unless a test differs.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <initializer_list>
#include <string>
#include <vector>

#include <palpate/accuracy.h>

namespace palpate::metrics {

inline constexpr double kStiffness = 0.5;

class HalfSpace final : public TruthSurface {
 public:
  double signed_distance_mm(const Vec3& p_mm) const override { return p_mm.z(); }
  geometry::SurfacePoint closest(const Vec3& p_mm) const override {
    return {{p_mm.x(), p_mm.y(), 0.0}, Vec3::UnitZ()};
  }
};

/// Matter between z = -thickness and 0.
class Slab final : public TruthSurface {
 public:
  explicit Slab(double thickness_mm) : t_(thickness_mm) {}
  double signed_distance_mm(const Vec3& p) const override { return std::abs(p.z() + t_ / 2) - t_ / 2; }
  geometry::SurfacePoint closest(const Vec3& p) const override {
    const bool upper = p.z() > -t_ / 2;
    return {{p.x(), p.y(), upper ? 0.0 : -t_}, upper ? Vec3(Vec3::UnitZ()) : Vec3(-Vec3::UnitZ())};
  }

 private:
  double t_;
};

struct Tiny {
  trace::ProbePath path;
  trace::ForceTrace trace;
  trace::ReferenceTrace reference;

  Tiny(std::initializer_list<double> heights_mm = {}) {
    for (const double z_mm : heights_mm) add(z_mm);
  }
  /// The HIP at (x, 0, z) with a local resolution; the truth follows, the frame is the truth until changed.
  render::Frame& add(double z_mm, double resolution_mm = 0.1, double x_mm = 0.0) {
    const Vec3 hip_mm(x_mm, 0.0, z_mm);
    path.name = "tiny.csv";
    path.t_s.push_back(0.001 * static_cast<double>(path.t_s.size()));
    path.hip_mm.push_back(hip_mm);
    trace::TruthFrame truth;
    truth.signed_distance_mm = z_mm;
    truth.local_resolution_mm = resolution_mm;
    truth.frame.contact = z_mm < 0.0;
    truth.frame.god_object_mm = z_mm < 0.0 ? Vec3(x_mm, 0.0, 0.0) : hip_mm;
    truth.frame.force_n = kStiffness * (truth.frame.god_object_mm - hip_mm);
    reference.name = "analytic";
    reference.exactness = "exact";
    reference.frames.push_back(truth);
    trace.frames.push_back(truth.frame);
    return trace.frames.back();
  }
  [[nodiscard]] Result<Accuracy> scored(AccuracyFrames* per_frame = nullptr,
                                        const AccuracyOptions& options = {}) const {
    return score(path, trace, reference, &half_space, options, per_frame);
  }
  [[nodiscard]] Accuracy scores(AccuracyFrames* per_frame = nullptr,
                                const AccuracyOptions& options = {}) const {
    const Result<Accuracy> a = scored(per_frame, options);
    EXPECT_TRUE(a) << (a ? "" : a.error().message());
    return a ? *a : Accuracy{};
  }

  static inline const HalfSpace half_space;
};

}  // namespace palpate::metrics
