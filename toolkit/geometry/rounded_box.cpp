// The closed box with round edges: all places at `radius` from an inner core box.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

/// A god object sliding over edges crosses each face at most once.
constexpr int kRoundedBoxFaces = 6;
/// Newton steps on a convex function from the side without overshoot.
constexpr int kRoundedBoxEntrySteps = 64;

class RoundedBox final : public AnalyticSurface {
 public:
  RoundedBox(const Vec3& extent_mm, double radius_mm)
      : half_(0.5 * extent_mm),
        core_(half_ - Vec3::Constant(radius_mm)),
        radius_(radius_mm),
        ways_(rounded_box_half_arcs(extent_mm, radius_mm)) {}

  [[nodiscard]] std::string formula() const override {
    return fmt::format("|x| <= {}, |y| <= {}, |z| <= {}, edges of radius {}", half_.x(), half_.y(), half_.z(),
                       radius_);
  }
  [[nodiscard]] Aabb box_mm() const override { return {-half_, half_}; }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    const Vec3 over = p.cwiseAbs() - core_;
    if (over.maxCoeff() > 0.0) return round(p, Vec3::UnitZ());
    int axis = 0;
    over.maxCoeff(&axis);
    return on_face(axis, side_of(p[axis]), p);
  }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    const Vec3 over = p.cwiseAbs() - core_;
    return (over.maxCoeff() > 0.0 ? over.cwiseMax(0.0).norm() : over.maxCoeff()) - radius_;
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override;
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a, const Vec3& b) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    // Equal areas on the sphere, then equal angles on the cube.
    const double z = 1.0 - 2.0 * v, angle = 2.0 * std::numbers::pi * u,
                 ring = std::sqrt(std::max(0.0, 1.0 - z * z));
    const Vec3 n(ring * std::cos(angle), ring * std::sin(angle), z);
    const Vec3 cube = n / n.cwiseAbs().maxCoeff();
    const auto even = [](double s) { return 4.0 / std::numbers::pi * std::atan(s); };
    return placed(Vec3(even(cube.x()), even(cube.y()), even(cube.z())));
  }

  [[nodiscard]] SurfacePoint placed(const Vec3& share) const noexcept {
    Vec3 middle, way;
    for (int i = 0; i < 3; ++i) {
      const double s = share[i] * ways_[i];
      middle[i] = std::clamp(s, -core_[i], core_[i]);
      way[i] = std::tan((s - middle[i]) / radius_);
    }
    const Vec3 n = way.normalized();
    return {middle + radius_ * n, n};
  }

 private:
  [[nodiscard]] static double side_of(double x) noexcept { return x < 0.0 ? -1.0 : 1.0; }
  [[nodiscard]] SurfacePoint on_face(int axis, double side, const Vec3& p) const noexcept {
    SurfacePoint s{p.cwiseMax(-core_).cwiseMin(core_), Vec3::Zero()};
    s.point_mm[axis] = side * half_[axis];
    s.normal[axis] = side;
    return s;
  }
  /// For p outside the core; `otherwise` is the normal if p is on it.
  [[nodiscard]] SurfacePoint round(const Vec3& p, const Vec3& otherwise) const noexcept {
    const Vec3 middle = p.cwiseMax(-core_).cwiseMin(core_), way = p - middle;
    const double size = way.norm();
    const Vec3 n = size > 0.0 ? Vec3(way / size) : otherwise;
    return {middle + radius_ * n, n};
  }

  Vec3 half_, core_;
  double radius_;
  Vec3 ways_;
};

// As on a sharp box: past the end of its face, a god object deeper than the next face's core descends that
// face; one less deep is on the edge between them, where the distance has one minimum.
SurfacePoint RoundedBox::track(const SurfacePoint& from, const Vec3& p) const noexcept {
  int axis = 0;
  from.normal.cwiseAbs().maxCoeff(&axis);
  double side = side_of(from.normal[axis]);
  for (int i = 0; i < kRoundedBoxFaces; ++i) {
    if (side * p[axis] >= core_[axis]) return round(p, side * Vec3::Unit(axis));
    int next = axis;
    double farthest = 0.0;
    for (int other = 0; other < 3; ++other) {
      const double beyond = std::abs(p[other]) - core_[other];
      if (other == axis || beyond <= farthest) continue;
      farthest = beyond;
      next = other;
    }
    if (next == axis) break;
    axis = next;
    side = side_of(p[axis]);
  }
  return on_face(axis, side, p);
}

// The distance to a convex body is convex along a segment.
std::optional<SurfacePoint> RoundedBox::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  const double rounding = gamma(16) * (a.cwiseAbs().maxCoeff() + d.cwiseAbs().maxCoeff() + half_.maxCoeff());
  double t = 0.0;
  if (signed_distance_mm(a) < -rounding) return std::nullopt;  // inside; a convex body is left only once
  for (int step = 0; step < kRoundedBoxEntrySteps; ++step) {
    const Vec3 p = a + t * d;
    const SurfacePoint s = closest(p);
    const double slope = s.normal.dot(d), height = signed_distance_mm(p);
    if (!(slope < 0.0)) return std::nullopt;
    if (height <= rounding) return s;
    t -= height / slope;
    if (!(t <= 1.0)) return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace

Vec3 rounded_box_half_arcs(const Vec3& extent_mm, double radius_mm) noexcept {
  // Half a face's flat part plus half the quarter turn to the next face.
  return 0.5 * extent_mm + Vec3::Constant((0.25 * std::numbers::pi - 1.0) * radius_mm);
}

std::shared_ptr<const AnalyticSurface> make_rounded_box(const Vec3& extent_mm, double radius_mm) {
  for (int i = 0; i < 3; ++i)
    if (!is_length(extent_mm[i])) return nullptr;
  if (!is_length(radius_mm) || !(2.0 * radius_mm <= extent_mm.minCoeff())) return nullptr;
  return std::make_shared<RoundedBox>(extent_mm, radius_mm);
}

Vec3 rounded_box_point(const AnalyticSurface& box, const Vec3& share) noexcept {
  return static_cast<const RoundedBox&>(box).placed(share).point_mm;
}

}  // namespace palpate::geometry
