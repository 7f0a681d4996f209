// The closed box with sharp edges.
#include <fmt/format.h>

#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

/// A face: the axis it is perpendicular to and the side (-1 or 1) it is on.
struct Face {
  int axis = 2;
  double side = 1.0;
};

// A god object sliding over edges crosses each face at most once.
constexpr int kFaces = 6;

class Slab final : public AnalyticSurface {
 public:
  Slab(double extent_mm, double thickness_mm) : half_(0.5 * extent_mm, 0.5 * extent_mm, 0.5 * thickness_mm) {}

  [[nodiscard]] std::string formula() const override {
    return fmt::format("|x| <= {0}, |y| <= {0}, |z| <= {1}", half_.x(), half_.z());
  }
  [[nodiscard]] Aabb box_mm() const override { return {-half_, half_}; }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override;
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    const Vec3 over = p.cwiseAbs() - half_;
    return over.maxCoeff() < 0.0 ? over.maxCoeff() : over.cwiseMax(0.0).norm();
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override;
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a, const Vec3& b) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    return {{(2.0 * u - 1.0) * half_.x(), (2.0 * v - 1.0) * half_.y(), half_.z()}, Vec3::UnitZ()};
  }

 private:
  [[nodiscard]] SurfacePoint on_face(const Face& face, const Vec3& p) const noexcept {
    SurfacePoint s{p.cwiseMax(-half_).cwiseMin(half_), Vec3::Zero()};
    s.point_mm[face.axis] = face.side * half_[face.axis];
    s.normal[face.axis] = face.side;
    return s;
  }
  [[nodiscard]] static double side_of(double x) noexcept { return x < 0.0 ? -1.0 : 1.0; }

  Vec3 half_;
};

SurfacePoint Slab::closest(const Vec3& p) const noexcept {
  // Inside: the nearest face. Outside: the clamped point, on the face that p is farthest beyond.
  const Vec3 over = p.cwiseAbs() - half_;
  int axis = 2;
  for (int i = 0; i < 2; ++i)
    if (over[i] > over[axis]) axis = i;
  return on_face({axis, side_of(p[axis])}, p);
}

SurfacePoint Slab::track(const SurfacePoint& from, const Vec3& p) const noexcept {
  Face face;
  from.normal.cwiseAbs().maxCoeff(&face.axis);
  face.side = side_of(from.normal[face.axis]);
  for (int i = 0; i < kFaces; ++i) {
    // If p's foot is beyond an edge of the face and p below that edge, descends to the next face.
    Face next = face;
    double farthest = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double beyond = std::abs(p[axis]) - half_[axis];
      if (axis != face.axis && beyond > farthest) {
        farthest = beyond;
        next = {axis, side_of(p[axis])};
      }
    }
    const bool below = face.side * p[face.axis] < half_[face.axis];
    if (next.axis == face.axis || !below) break;
    face = next;
  }
  return on_face(face, p);
}

std::optional<SurfacePoint> Slab::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  double enter = -1.0, leave = 1.0;
  Face face;
  for (int axis = 0; axis < 3; ++axis) {
    const double rounding = gamma(4) * (std::abs(a[axis]) + half_[axis]);
    if (d[axis] == 0.0) {
      if (std::abs(a[axis]) >= half_[axis]) return std::nullopt;
      continue;
    }
    const double side = d[axis] < 0.0 ? 1.0 : -1.0;  // the side of entry
    const double height = side * a[axis] - half_[axis];
    double t_in = height / std::abs(d[axis]);
    if (std::abs(height) <= rounding) t_in = 0.0;  // on the face and going in
    const double t_out = (side * a[axis] + half_[axis]) / std::abs(d[axis]);
    if (t_in > enter) {
      enter = t_in;
      face = {axis, side};
    }
    leave = std::min(leave, t_out);
  }
  if (!(enter >= 0.0 && enter < leave)) return std::nullopt;  // starts inside, or misses
  return on_face(face, a + enter * d);
}

}  // namespace

std::shared_ptr<const AnalyticSurface> make_slab(double extent_mm, double thickness_mm) {
  const bool good =
      std::isfinite(extent_mm) && extent_mm > 0.0 && std::isfinite(thickness_mm) && thickness_mm > 0.0;
  if (!good) return nullptr;
  return std::make_shared<Slab>(extent_mm, thickness_mm);
}

}  // namespace palpate::geometry
