// Surfaces with edges: the closed box with sharp edges (slab) and with round ones (all places at `radius`
// from an inner core box), and the wedge of two half-planes along the y axis, ridge or valley.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

/// A face: the axis it is perpendicular to and the side (-1 or 1) it is on.
struct Face {
  int axis = 2;
  double side = 1.0;
};

/// Faces of a box; a god object sliding over edges crosses each at most once.
constexpr int kFaces = 6;

double side_of(double x) noexcept {
  return x < 0.0 ? -1.0 : 1.0;
}

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
    // If p's projection is beyond an edge of the face and p below that edge, descends to the next face.
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
    const Vec3 n = unit_sphere_at(u, v);
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
  for (int i = 0; i < kFaces; ++i) {
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

// Least angle of material or free space; sharper wedges are needles.
constexpr double kSharpestDeg = 10.0;

class Wedge final : public AnalyticSurface {
 public:
  Wedge(double angle_deg, double extent_mm) : angle_deg_(angle_deg), extent_(extent_mm) {
    const double half_angle = 0.5 * angle_deg * std::numbers::pi / 180.0;
    sin_ = std::sin(half_angle);
    cos_ = angle_deg == 180.0 ? 0.0 : std::cos(half_angle);
    slope_ = cos_ / sin_;
  }

  [[nodiscard]] std::string formula() const override {
    return fmt::format("z = -|x| / tan({} deg / 2)", angle_deg_);
  }
  [[nodiscard]] Aabb box_mm() const override {
    const double h = 0.5 * extent_, z = -slope_ * h;
    return {{-h, -h, std::min(z, 0.0)}, {h, h, std::max(z, 0.0)}};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    const SurfacePoint left = on_side(-1.0, p), right = on_side(1.0, p);
    return (left.point_mm - p).squaredNorm() < (right.point_mm - p).squaredNorm() ? left : right;
  }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    const double distance = (closest(p).point_mm - p).norm();
    return height_over(p) < 0.0 ? -distance : distance;
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override;
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a, const Vec3& b) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    const double x = (u - 0.5) * extent_;
    return {{x, (v - 0.5) * extent_, -slope_ * std::abs(x)}, normal_of(x < 0.0 ? -1.0 : 1.0)};
  }

 private:
  [[nodiscard]] double height_over(const Vec3& p) const noexcept { return p.z() + slope_ * std::abs(p.x()); }
  /// `side` is -1 for the half-plane of x <= 0, 1 for the other.
  [[nodiscard]] Vec3 normal_of(double side) const noexcept { return {side * cos_, 0.0, sin_}; }
  /// Distance of p's projection on the side's plane from the edge; negative beyond it.
  [[nodiscard]] double along_side(double side, const Vec3& p) const noexcept {
    return side * p.x() * sin_ - p.z() * cos_;
  }
  [[nodiscard]] SurfacePoint on_side(double side, const Vec3& p) const noexcept {
    const double s = std::max(0.0, along_side(side, p));
    return {{side * s * sin_, p.y(), -s * cos_}, normal_of(side)};
  }

  double angle_deg_, extent_, sin_ = 0.0, cos_ = 0.0, slope_ = 0.0;
};

SurfacePoint Wedge::track(const SurfacePoint& from, const Vec3& p) const noexcept {
  double side = from.point_mm.x() < 0.0 ? -1.0 : 1.0;
  if (from.point_mm.x() == 0.0 && from.normal.x() * cos_ < 0.0) side = -1.0;
  if (along_side(side, p) >= 0.0) return on_side(side, p);
  if (along_side(-side, p) > 0.0) return on_side(-side, p);
  // The edge is closest. p is outside a ridge if outside either half-plane, and outside a valley if outside
  // both; the normal chosen tells.
  SurfacePoint one = on_side(side, p), other = on_side(-side, p);
  const double depth_one = (one.point_mm - p).dot(one.normal),
               depth_other = (other.point_mm - p).dot(other.normal);
  const bool ridge = cos_ > 0.0;
  return (ridge ? depth_other < depth_one : depth_other > depth_one) ? other : one;
}

std::optional<SurfacePoint> Wedge::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  const Vec3 largest = a.cwiseAbs().cwiseMax(b.cwiseAbs());
  const double rounding = gamma(8) * (largest.z() + std::abs(slope_) * largest.x());
  // The height over the wedge is linear on each side of x = 0.
  const bool crosses = (a.x() < 0.0) != (b.x() < 0.0) && d.x() != 0.0;
  const double middle = crosses ? std::clamp(-a.x() / d.x(), 0.0, 1.0) : 1.0;
  const double ends[3] = {0.0, middle, 1.0};
  for (int i = 0; i < (crosses ? 2 : 1); ++i) {
    const Vec3 p0 = a + ends[i] * d, p1 = a + ends[i + 1] * d;
    // Exactly on the edge, despite the parameter's rounding.
    const double g0 = i == 1 ? p0.z() : height_over(p0);
    const double g1 = crosses && i == 0 ? p1.z() : height_over(p1);
    if (!(g0 >= -rounding && g1 < 0.0 && g1 < g0)) continue;
    const Vec3 entry = p0 + std::clamp(g0 / (g0 - g1), 0.0, 1.0) * (p1 - p0);
    const double side = crosses ? ((i == 0) == (a.x() < 0.0) ? -1.0 : 1.0) : (entry.x() < 0.0 ? -1.0 : 1.0);
    const double x = side < 0.0 ? std::min(entry.x(), 0.0) : std::max(entry.x(), 0.0);
    return SurfacePoint{{x, entry.y(), -slope_ * std::abs(x)}, normal_of(side)};
  }
  return std::nullopt;
}

}  // namespace

std::shared_ptr<const AnalyticSurface> make_slab(double extent_mm, double thickness_mm) {
  if (!is_length(extent_mm) || !is_length(thickness_mm)) return nullptr;
  return std::make_shared<Slab>(extent_mm, thickness_mm);
}

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

std::shared_ptr<const AnalyticSurface> make_wedge(double angle_deg, double extent_mm) {
  if (!(angle_deg >= kSharpestDeg && angle_deg <= 360.0 - kSharpestDeg)) return nullptr;
  if (!is_length(extent_mm)) return nullptr;
  return std::make_shared<Wedge>(angle_deg, extent_mm);
}

}  // namespace palpate::geometry
