#include "baselines/renderers/mesh_probe.h"

#include <algorithm>
#include <cmath>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/renderers/facet_walk.h"

namespace palpate::baselines {
namespace {

/// Within this many margins of an edge or corner pseudonormals decide the side: the float hit may name any
/// facet there.
constexpr double kNearFeatureMargins = 4.0;
/// Distance before such a hit at which the side is tested, in margins: clear of the margin.
constexpr double kLookBackMargins = 16.0;

double least_edge_distance(const Facet& f, const Vec3& p) noexcept {
  double least = closest_on_edge(f, 0, p).distance_sq;
  for (std::uint32_t e = 1; e < 3; ++e) least = std::min(least, closest_on_edge(f, e, p).distance_sq);
  return std::sqrt(least);
}

}  // namespace

MeshProbe::MeshProbe(const SurfaceMesh& mesh, const SegmentIndex& index, const Crossings& crossings,
                     const PieceOrientation& sides)
    : mesh_(&mesh),
      index_(&index),
      crossings_(crossings.any() ? &crossings : nullptr),
      free_side_(mesh, sides) {}

void MeshProbe::reset(const Vec3& hip) noexcept {
  attached_ = false;
  bound_hit_ = false;
  anchor_ = hip;
  at_ = {};
  moves_ = 0;
  free_side_.begin_at(hip);
}

void MeshProbe::start_from(const Vec3& hip) noexcept {
  attached_ = false;
  anchor_ = hip;
}

void MeshProbe::continue_from(const MeshProbe& before, const Vec3& camera_mm, double reach_mm) noexcept {
  anchor_ = before.anchor_;
  if (before.attached_) {
    const Vec3& held = before.at_.point;
    anchor_ = held;
    const std::uint32_t facet = index_->nearest(held, reach_mm);
    if (facet == kNoFacet) return;
    attach_at(half_facet(facet, side_of(before.at_.half)), held, held);
    return;
  }
  const Vec3 away = camera_mm - anchor_;
  const double distance = away.norm();
  if (!(distance > 0.0)) return;
  const Vec3 start = anchor_ + away * (std::min(reach_mm, distance) / distance);
  if (index_->first_hit(start, anchor_) && !before.index_->first_hit(start, anchor_)) anchor_ = start;
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
      if (!free_side_.touches(at_.half)) {
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

/// At rest the HIP is in front of the god object (free) or behind it, by the pseudonormal. Past a rim it is
/// free too, but only by more than an edge: see SurfaceMesh::longest_edge_sq. Past a rim on another sheet the
/// planes there decide.
bool MeshProbe::outside(const Vec3& hip, Vec3& away) const noexcept {
  bool boundary = false;
  away = mesh_->pseudonormal(at_.half, at_.feature, &boundary);
  const Vec3 r = hip - at_.point;
  const double height = away.dot(r);
  if (height > 0.0) return true;
  if (mesh_->counts().two_sided_facets > 0 && mesh_->is_free_edge(at_.half, at_.feature)) {
    const double length = r.norm();
    if (length > 0.0) away = r / length;
    return true;
  }
  if (!boundary) return false;
  double past_sq = r.squaredNorm() - height * height;
  if (is_on_other_sheet(*mesh_, crossings_, at_))
    past_sq = ContactPlanes(*mesh_, crossings_, at_, hip).allowed_motion(r).squaredNorm();
  return past_sq > mesh_->longest_edge_sq(facet_of(at_.half));
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
  attach_at(half_facet(facet, towards > 0.0 ? 0u : 1u), near, from);
  return true;
}

void MeshProbe::attach_at(HalfFacet half, const Vec3& near, const Vec3& from) noexcept {
  const FacetPoint p = closest_point_before_walls(*mesh_, crossings_, half, from, near);
  at_ = {half, p.feature, p.point, p.distance_sq};
  attached_ = true;
}

/// Side at an edge or corner: the pseudonormal's sign at the facet nearest to a point shortly before the hit.
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
  attach_at(half_facet(best, towards > 0.0 ? 0u : 1u), nearest.point, from);
  return true;
}

/// First facet around the present one's vertices that the way to the HIP pierces from its free side, in
/// double: too near for the float query.
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

void MeshProbe::planes_near(const Vec3& at, const render::ModelPose& pose,
                            render::JointPlanes& planes) const noexcept {
  SurfacePosition near = at_;
  slide(*mesh_, crossings_, at, near);
  const ContactPlanes here(*mesh_, crossings_, near, at);
  for (const Vec3& normal : here.normals()) {
    const Vec3 n = pose.direction_to_world(normal);
    planes.add({n, n.dot(pose.to_world(near.point))});
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
    if (const std::uint32_t wall = first_wall(*mesh_, *crossings_, at_.half, g, hip, &fraction);
        wall != kNoFacet) {
      const bool front = mesh_->normal(half_facet(wall, 0)).dot(g - mesh_->facet(wall).corner[0]) > 0.0;
      attach_at(half_facet(wall, front ? 0u : 1u), g + (hip - g) * fraction, just_off(*mesh_, at_));
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
