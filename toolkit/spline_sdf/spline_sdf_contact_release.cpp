// Checks the HIP's surroundings: surfaces that a free HIP is behind, and agreement with the held place.
#include <algorithm>
#include <cmath>

#include "toolkit/geometry/god_object_check.h"
#include "toolkit/spline_sdf/spline_sdf_contact.inl"

namespace palpate::spline_sdf {
namespace {

/// A HIP deeper behind a closed piece than this did not enter legally: it exceeds the surface's accuracy.
constexpr double kInside = 1e-3;
/// Largest depth, in spacings, at which contact is regained; deeper ones would kick.
constexpr double kRegained = 0.5;
/// Normal steps from a HIP to the surface above: the first is accurate to the field's slope, three more to
/// its curvature.
constexpr int kToSurface = 6;
/// The field's slope is one where it represents a single surface.
constexpr double kTellingSlope = 0.5;

}  // namespace

/// Computes how far the HIP may move without contact. A HIP now behind a tight piece and before in front of
/// it crossed it and is in contact; one that entered through a hole is not.
void SplineSdfContact::update_free_radius(const Vec3& h) noexcept {
  free_centre_ = h;
  const BrickRef place = grid_->find(h);
  if (place.brick == BrickGrid::kNone) {
    in_front_ = false;
    const double edge = grid_->cube_edge();
    clear_ = edge;
    for (Eigen::Index a = 0; a < 3; ++a) {
      const double in = h[a] - edge * std::floor(h[a] / edge);
      clear_ = std::min({clear_, in, edge - in});
    }
    return;
  }
  const Jet jet = jet_at(place, place_in(place, h));
  const float allowed = free_side_[grid_->bricks[place.brick].piece];
  in_front_ = in_front_ || jet.value * allowed > 0.0f;
  const double behind = -static_cast<double>(jet.value * allowed);
  if (in_front_ && is_tight(place) && behind > kInside && behind < kRegained * spacing_) {
    hold_on_surface_above(h, place, jet, allowed);
    return;
  }
  clear_ = kMarchShare * std::abs(static_cast<double>(jet.value));
}

/// Begins contact at the surface above h, which is behind it.
void SplineSdfContact::hold_on_surface_above(const Vec3& h, const BrickRef& place, const Jet& jet,
                                             float side) noexcept {
  Vec3 at = h;
  BrickRef there = place;
  Jet here = jet;
  for (int i = 0; i < kToSurface; ++i) {
    const auto size_sq = static_cast<double>(here.gradient.squaredNorm());
    if (!(size_sq > 0.0)) return;
    Vec3 step = here.gradient.cast<double>() * (-static_cast<double>(here.value) / size_sq);
    const double length = step.norm();
    if (length > kLongestStep) step *= kLongestStep / length;
    at += step;
    if (!query(at, there, here)) return;
    if (length < kOnSurface) break;
  }
  if (may_touch(there, at)) hold_at(at, there, here, side);
}

bool SplineSdfContact::hold_near(const Vec3& god_object_mm, const Vec3& outward) noexcept {
  const Vec3 at = grid_->in_voxels(god_object_mm);
  const BrickRef place = grid_->find(at);
  if (place.brick == BrickGrid::kNone) return false;
  const Jet jet = jet_at(place, place_in(place, at));
  // The side that was felt before is right; a start that saw too little may have taken the other.
  const float faces = jet.gradient.cast<double>().dot(outward) < 0.0 ? -1.0f : 1.0f;
  float& free = free_side_[grid_->bricks[place.brick].piece];
  hold_on_surface_above(at, place, jet, faces);
  if (contact_ && free != 0.0f) free = faces;
  return contact_;
}

bool SplineSdfContact::hold_if_inside(const Vec3& h_mm, double most_mm) noexcept {
  const Vec3 h = grid_->in_voxels(h_mm);
  const BrickRef place = grid_->find(h);
  if (place.brick == BrickGrid::kNone) return false;
  const Jet jet = jet_at(place, place_in(place, h));
  const float free = free_side_[grid_->bricks[place.brick].piece];
  const double behind = -static_cast<double>(jet.value * free);
  if (is_tight(place) && behind > 0.0 && behind <= most_mm * grid_->per_voxel)
    hold_on_surface_above(h, place, jet, free);
  return contact_;
}

/// Takes contact with the surface above h if h is behind it as at the held place. False, with nothing
/// changed, if not, or if that surface ends there.
bool SplineSdfContact::hold_if_behind(const Vec3& h) noexcept {
  const BrickRef place = grid_->find(h);
  if (place.brick == BrickGrid::kNone) return false;
  const Jet jet = jet_at(place, place_in(place, h));
  if (!(static_cast<double>(jet.value * side_) < -kInside)) return false;
  contact_ = false;
  hold_on_surface_above(h, place, jet, side_);
  const bool held = contact_;
  contact_ = true;
  return held;
}

/// The rule of geometry/god_object_check.h, applied once in kCheckPeriodFrames frames, which is soon enough
/// for a hand.
void SplineSdfContact::check_held_position(const Vec3& h) noexcept {
  const auto side = static_cast<double>(side_);
  const auto query = [&](const Vec3& at) noexcept -> geometry::NearestSurface {
    const BrickRef place = grid_->find(at);
    if (place.brick == BrickGrid::kNone) return {};
    const Jet jet = jet_at(place, place_in(place, at));
    const auto size = static_cast<double>(jet.gradient.norm());
    // Half way between sheets the field has no direction.
    return {size > kTellingSlope, side * static_cast<double>(jet.value),
            jet.gradient.cast<double>() * (side / std::max(size, kTellingSlope))};
  };
  const Vec3 outward = normal_ * side;
  const geometry::NearestSurface at = query(h);
  followed_ = geometry::follow_outward(at, follows_ ? followed_ : outward, outward);
  follows_ = true;
  if (frames_unchecked_ < geometry::kCheckPeriodFrames) return;
  frames_unchecked_ = 0;
  switch (geometry::check_god_object(at, h, god_, outward, followed_, spacing_,
                                     geometry::kMuchNearerShareRounded, query)) {
    case geometry::GodObjectVerdict::kKeep:
      return;
    case geometry::GodObjectVerdict::kMove:
      if (const BrickRef place = grid_->find(h); place.brick != BrickGrid::kNone)
        hold_on_surface_above(h, place, jet_at(place, place_in(place, h)), side_);
      return;
    case geometry::GodObjectVerdict::kFree:
      contact_ = false;
      in_front_ = true;
      clear_ = -1.0;
      tested_to_ = h;
      return;
  }
}

}  // namespace palpate::spline_sdf
