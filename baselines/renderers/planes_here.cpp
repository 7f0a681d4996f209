#include "baselines/renderers/planes_here.h"

#include <algorithm>

namespace palpate::baselines {
namespace {

/// Facets that meet in one place, as far as they count for planes.
constexpr std::size_t kMaxMeeting = 64;
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
  if (mesh.goes_round(at.half, at.feature)) return meeting;
  if (at.feature >= kCorner) {
    mesh.around_corner(at.half, static_cast<std::uint32_t>(at.feature - kCorner),
                       [&](HalfFacet half) { meeting.add(half); });
    return meeting;
  }
  for_edges_at(mesh, at, [&](HalfFacet over) noexcept { meeting.add(over); });
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

PlanesHere::PlanesHere(const SurfaceMesh& mesh, const Crossings* crossings, const SurfacePosition& at,
                       const Vec3& probe) noexcept
    : pull_(at.point - probe) {
  const Meeting meeting = meeting_at(mesh, at);
  for (std::size_t i = 0; i < meeting.size; ++i)
    if (bounds(mesh, meeting.half[i], meeting)) add(mesh.normal(meeting.half[i]));
  if (size_ == 0) {
    bool boundary = false;
    const Vec3 n = mesh.pseudonormal(at.half, at.feature, &boundary);
    if (n != Vec3::Zero()) add(n);
  }
  walls_at(mesh, crossings, at, [&](HalfFacet wall) noexcept { add(mesh.normal(wall)); });
}

void PlanesHere::add(const Vec3& normal) noexcept {
  if (size_ < normal_.size()) {
    normal_[size_++] = normal;
    return;
  }
  std::size_t least = size_;
  double depth = normal.dot(pull_);
  for (std::size_t i = 0; i < size_; ++i) {
    if ((normal_[i] - normal).norm() < geometry::kFlatShare) return;
    if (normal_[i].dot(pull_) < depth) {
      depth = normal_[i].dot(pull_);
      least = i;
    }
  }
  if (least < size_) normal_[least] = normal;
}

Vec3 PlanesHere::left_of(const Vec3& way) const noexcept {
  std::array<geometry::HalfSpace, render::kMaxPlanesATouch> planes;
  for (std::size_t i = 0; i < size_; ++i) planes[i] = {normal_[i], 0.0};
  return geometry::nearest_allowed(std::span(planes).first(size_), way, render::kJointSlack * way.norm())
      .point;
}

bool stands_on_other(const SurfaceMesh& mesh, const Crossings* crossings,
                     const SurfacePosition& at) noexcept {
  bool any = false;
  walls_at(mesh, crossings, at, [&](HalfFacet) noexcept { any = true; });
  return any;
}

}  // namespace palpate::baselines
