#include "baselines/renderers/mesh_probe.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "baselines/renderers/vertex_normals.h"

namespace palpate::baselines {
namespace {

/// A hit this many margins from an edge or corner is decided by the features' pseudonormals: the float hit
/// may name any of the facets there.
constexpr double kNearFeatureMargins = 4.0;
/// How far before such a hit the side is looked up, in margins: clear of the margin itself.
constexpr double kLookBackMargins = 16.0;

/// The areas of a closed surface cancel as vectors; up to this share of all is taken for holes.
constexpr double kClosedShare = 0.1;

double least_edge_distance(const Facet& f, const Vec3& p) noexcept {
  double least = closest_on_edge(f, 0, p).distance_sq;
  for (std::uint32_t e = 1; e < 3; ++e) least = std::min(least, closest_on_edge(f, e, p).distance_sq);
  return std::sqrt(least);
}

}  // namespace

MeshProbe::MeshProbe(const SurfaceMesh& mesh, const SegmentIndex& index, const Crossings& crossings) noexcept
    : mesh_(&mesh), index_(&index), crossings_(crossings.any() ? &crossings : nullptr) {
  double area = 0.0, volume = 0.0;
  Vec3 vector_area = Vec3::Zero(), moment = Vec3::Zero();
  for (const Facet& facet : mesh.facets()) {
    const Vec3 a = facet.scaled_normal();
    const double size = a.norm();
    area += size;
    vector_area += a;
    volume += a.dot(facet.corner[0]);
    moment += size * facet.corner[0];
  }
  if (!(area > 0.0)) return;
  one_sided_ = vector_area.norm() <= kClosedShare * area;
  outer_ = front_ = volume - moment.dot(vector_area) / area >= 0.0 ? 0 : 1;
}

/// The solid angle under which the mesh is seen (van Oosterom and Strackee 1983): 4 pi from inside, 0 from
/// outside, and near those where there are holes.
bool MeshProbe::encloses(const Vec3& p) const noexcept {
  double angle = 0.0;
  for (const Facet& facet : mesh_->facets()) {
    const Vec3 a = facet.corner[0] - p, b = facet.corner[1] - p, c = facet.corner[2] - p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    angle +=
        2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return std::abs(angle) > 2.0 * std::numbers::pi;
}

void MeshProbe::reset(const Vec3& hip) noexcept {
  attached_ = false;
  bound_hit_ = false;
  anchor_ = hip;
  at_ = {};
  moves_ = 0;
  if (!one_sided_) return;
  front_ = mesh_->local_box_mm().contains(hip) && encloses(hip) ? 1 - outer_ : outer_;
}

void MeshProbe::start_from(const Vec3& hip) noexcept {
  attached_ = false;
  anchor_ = hip;
}

bool MeshProbe::update(const Vec3& hip) noexcept {
  bound_hit_ = false;
  for (int flight = 0; flight < kMaxFlights; ++flight) {
    if (!attached_) {
      const auto hit = index_->first_hit(anchor_, hip);
      if (!hit) {
        if (!index_->within(hip, index_->margin_mm())) anchor_ = hip;
        return false;
      }
      if (!attach(hit->facet, anchor_ + (hip - anchor_) * hit->fraction, anchor_, hip)) return false;
      if (one_sided_ && side_of(at_.half) != front_) {
        attached_ = false;
        anchor_ = hip;
        return false;
      }
    }
    const SlideCount slid = slide(*mesh_, crossings_, hip, at_);
    moves_ += slid.moves;
    Vec3 away = Vec3::Zero();
    const bool free = outside(hip, away);
    if (!slid.finished) {
      bound_hit_ = true;
      return !free;
    }
    if (!free) return true;
    if (at_.distance_sq <= index_->margin_mm() * index_->margin_mm()) return false;
    switch (fly(hip, away)) {
      case Flight::kFree:
        attached_ = false;
        anchor_ = hip;
        return false;
      case Flight::kStays:
        return false;
      case Flight::kMet:
        break;
    }
  }
  bound_hit_ = true;
  return false;
}

/// At rest the HIP is in front of the god object (free) or behind it, as the pseudonormal says. At a rim
/// nothing is behind, so it is free past the rim too; but only by more than an edge: see
/// SurfaceMesh::longest_edge_sq.
bool MeshProbe::outside(const Vec3& hip, Vec3& away) const noexcept {
  bool boundary = false;
  away = mesh_->pseudonormal(at_.half, at_.feature, &boundary);
  const Vec3 r = hip - at_.point;
  const double height = away.dot(r);
  return height > 0.0 ||
         (boundary && r.squaredNorm() - height * height > mesh_->longest_edge_sq(facet_of(at_.half)));
}

bool MeshProbe::attach(std::uint32_t facet, const Vec3& near, const Vec3& from, const Vec3& to) noexcept {
  const double margin = index_->margin_mm();
  const Facet& f = mesh_->facet(facet);
  const Vec3 n = mesh_->normal(half_facet(facet, 0));
  if (n == Vec3::Zero() || least_edge_distance(f, near) <= kNearFeatureMargins * margin)
    return attach_near_feature(facet, near, from);
  double towards = n.dot(from - f.corner[0]);
  if (std::abs(towards) <= margin) towards = -n.dot(to - from);
  if (std::abs(towards) <= mesh_->rounding_mm()) return false;
  const FacetPoint p = closest_on_facet(f, near);
  at_ = {half_facet(facet, towards > 0.0 ? 0u : 1u), p.feature, p.point, p.distance_sq};
  attached_ = true;
  return true;
}

/// The side at an edge or corner: of all facets around, the one nearest to a point shortly before the hit,
/// and the sign of its feature's pseudonormal there.
bool MeshProbe::attach_near_feature(std::uint32_t facet, const Vec3& near, const Vec3& from) noexcept {
  const double way = (from - near).norm();
  const double back = std::min(way, kLookBackMargins * index_->margin_mm());
  const Vec3 eye = way > 0.0 ? Vec3(near + (from - near) * (back / way)) : from;
  std::uint32_t best = facet;
  FacetPoint nearest = closest_on_facet(mesh_->facet(facet), eye);
  for (const std::uint32_t vertex : mesh_->facet(facet).vertex) {
    const auto star = mesh_->star(vertex);
    for (std::size_t i = 0; i < std::min<std::size_t>(star.size(), kMaxFan); ++i) {
      const FacetPoint p = closest_on_facet(mesh_->facet(star[i]), eye);
      if (p.distance_sq < nearest.distance_sq) {
        nearest = p;
        best = star[i];
      }
    }
  }
  bool boundary = false;
  const Vec3 n = mesh_->pseudonormal(half_facet(best, 0), nearest.feature, &boundary);
  const double towards = n.dot(eye - nearest.point);
  if (std::abs(towards) <= mesh_->rounding_mm()) return false;
  at_ = {half_facet(best, towards > 0.0 ? 0u : 1u), nearest.feature, nearest.point, nearest.distance_sq};
  attached_ = true;
  return true;
}

/// The first of the facets that share a vertex with the present one and that the way to the HIP pierces from
/// its free side, in double: these are too near for the float query.
std::uint32_t MeshProbe::first_around(const Vec3& hip, double& fraction) const noexcept {
  const std::uint32_t here = facet_of(at_.half);
  const Vec3& g = at_.point;
  const double clear = mesh_->rounding_mm();
  std::uint32_t first = kNoFacet;
  for (const std::uint32_t vertex : mesh_->facet(here).vertex) {
    const auto star = mesh_->star(vertex);
    for (std::size_t i = 0; i < std::min<std::size_t>(star.size(), kMaxFan); ++i) {
      if (star[i] == here) continue;
      const Facet& f = mesh_->facet(star[i]);
      const Vec3 n = mesh_->normal(half_facet(star[i], 0));
      const double before = n.dot(g - f.corner[0]), behind = n.dot(hip - f.corner[0]);
      const bool through = (before > clear && behind < -clear) || (before < -clear && behind > clear);
      if (!through) continue;
      const double t = before / (before - behind);
      if (first != kNoFacet && t >= fraction) continue;
      if (closest_on_facet(f, g + (hip - g) * t).distance_sq > clear * clear) continue;
      first = star[i];
      fraction = t;
    }
  }
  return first;
}

Vec3 MeshProbe::shaded_target(const Vec3& hip, std::span<const Vec3f> vertex_normals) const noexcept {
  const Vec3 n = mesh_->normal(at_.half);
  if (n == Vec3::Zero()) return at_.point;
  const Vec3 m = interpolated_normal(mesh_->facet(facet_of(at_.half)), vertex_normals, at_.point, n);
  const Vec3 first = hip + m * m.dot(at_.point - hip);
  return first - n * n.dot(first - at_.point);
}

namespace {

/// Facets that meet in one place, as far as they count for planes.
constexpr std::size_t kMaxMeeting = 16;
/// A place this many wall distances from an edge is on it: joint solutions lie on edges up to rounding.
constexpr double kOnEdge = 4.0;

struct Meeting {
  std::array<HalfFacet, kMaxMeeting> half{};
  std::size_t size = 0;
  void add(HalfFacet h) noexcept {
    if (size < half.size()) half[size++] = h;
  }
};

Meeting meeting_at(const SurfaceMesh& mesh, const SurfacePosition& at) noexcept {
  Meeting meeting;
  meeting.add(at.half);
  if (at.feature >= kCorner) {
    mesh.around_corner(at.half, static_cast<std::uint32_t>(at.feature - kCorner),
                       [&](HalfFacet half) { meeting.add(half); });
    return meeting;
  }
  const Facet& f = mesh.facet(facet_of(at.half));
  const double on = kOnEdge * wall_distance_mm(mesh);
  for (std::uint32_t e = 0; e < 3; ++e) {
    if (at.feature != kEdge + e && closest_on_edge(f, e, at.point).distance_sq > on * on) continue;
    if (const HalfFacet over = mesh.neighbour(at.half, e); over != kNoFacet) meeting.add(over);
  }
  return meeting;
}

/// Whether all that meets with the half-facet lies on its free side or in its plane.
bool bounds(const SurfaceMesh& mesh, HalfFacet half, const Meeting& meeting) noexcept {
  const Vec3 n = mesh.normal(half);
  const Vec3& on = mesh.facet(facet_of(half)).corner[0];
  const double clear = wall_distance_mm(mesh);
  for (std::size_t i = 0; i < meeting.size; ++i)
    for (const Vec3& corner : mesh.facet(facet_of(meeting.half[i])).corner)
      if (n.dot(corner - on) < -clear) return false;
  return n != Vec3::Zero();
}

}  // namespace

void MeshProbe::planes_near(const Vec3& at, const render::ModelPose& pose,
                            render::JointPlanes& planes) const noexcept {
  SurfacePosition near = at_;
  slide(*mesh_, crossings_, at, near);
  const auto add = [&](const Vec3& normal, const Vec3& point) {
    const Vec3 n = pose.direction_to_world(normal);
    planes.add({n, n.dot(pose.to_world(point))});
  };
  const Meeting meeting = meeting_at(*mesh_, near);
  bool any = false;
  for (std::size_t i = 0; i < meeting.size; ++i) {
    if (!bounds(*mesh_, meeting.half[i], meeting)) continue;
    add(mesh_->normal(meeting.half[i]), near.point);
    any = true;
  }
  if (!any) {
    bool boundary = false;
    const Vec3 n = mesh_->pseudonormal(near.half, near.feature, &boundary);
    if (n != Vec3::Zero()) add(n, near.point);
  }
  if (crossings_ == nullptr) return;
  const double keep = wall_distance_mm(*mesh_);
  for (const std::uint32_t wall : crossings_->of(facet_of(near.half))) {
    const Facet& f = mesh_->facet(wall);
    const Vec3 n = mesh_->normal(half_facet(wall, 0));
    const double height = n.dot(near.point - f.corner[0]);
    if (std::abs(height) > 2.0 * keep || closest_on_facet(f, near.point).distance_sq > 4.0 * keep * keep)
      continue;
    add(height < 0.0 ? Vec3(-n) : n, near.point);
  }
}

MeshProbe::Flight MeshProbe::fly(const Vec3& hip, const Vec3& away) noexcept {
  const Vec3 g = at_.point;
  const std::uint32_t here = facet_of(at_.half);
  const auto met = [&](std::uint32_t facet, const Vec3& near) noexcept {
    return attach(facet, near, g, hip) ? Flight::kMet : Flight::kStays;
  };
  double fraction = 1.0;
  if (crossings_ != nullptr)
    if (const std::uint32_t wall = first_wall(*mesh_, *crossings_, here, g, hip, &fraction);
        wall != kNoFacet) {
      const Facet& f = mesh_->facet(wall);
      const bool front = mesh_->normal(half_facet(wall, 0)).dot(g - f.corner[0]) > 0.0;
      const FacetPoint p = closest_on_facet(f, g + (hip - g) * fraction);
      at_ = {half_facet(wall, front ? 0u : 1u), p.feature, p.point, p.distance_sq};
      return Flight::kMet;
    }
  if (const std::uint32_t around = first_around(hip, fraction); around != kNoFacet)
    return met(around, g + (hip - g) * fraction);
  const Vec3 start = g + away * index_->margin_mm();
  if (const auto hit = index_->first_hit(start, hip, here))
    return met(hit->facet, start + (hip - start) * hit->fraction);
  return index_->within(hip, index_->margin_mm()) ? Flight::kStays : Flight::kFree;
}

}  // namespace palpate::baselines
