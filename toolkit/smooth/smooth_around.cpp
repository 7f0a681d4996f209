// The HIP's own surroundings: what a free HIP is behind of, and whether the place held agrees with them.
#include <algorithm>
#include <cmath>

#include "toolkit/geometry/held_place.h"
#include "toolkit/smooth/smooth_contact.inl"

namespace palpate::render {
namespace {

/// A HIP behind a closed piece by more than this was not let in: the surface is known to it.
constexpr double kInside = 1e-3;
/// So many spacings behind it at most: what is regained deeper would come as a kick.
constexpr double kRegained = 0.5;
/// Normal steps from a HIP to the surface above it: the first is right to the field's slope, three more to
/// its curvature.
constexpr int kToSurface = 6;
/// The field's slope is one where it tells of one surface.
constexpr double kTellingSlope = 0.5;

}  // namespace

/// How far the HIP may go before anything can be met. One that is behind a tight piece, and was in front of
/// it before, is in contact: it went through. One that came in through a hole is not.
void SmoothContact::look_where_free(const Vec3& h) noexcept {
  looked_at_ = h;
  const Place place = grid_->find(h);
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
    touch_below(h, place, jet, allowed);
    corrected_ = contact_;
    uncorrected_mm_ = Vec3::Zero();
    return;
  }
  clear_ = kMarch * std::abs(static_cast<double>(jet.value));
}

/// Contact at the place of the surface above h, which is behind it.
void SmoothContact::touch_below(const Vec3& h, const Place& place, const Jet& jet, float side) noexcept {
  Vec3 at = h;
  Place there = place;
  Jet here = jet;
  for (int i = 0; i < kToSurface; ++i) {
    const auto size_sq = static_cast<double>(here.gradient.squaredNorm());
    if (!(size_sq > 0.0)) return;
    Vec3 step = here.gradient.cast<double>() * (-static_cast<double>(here.value) / size_sq);
    const double length = step.norm();
    if (length > kLongestStep) step *= kLongestStep / length;
    at += step;
    if (!look(at, there, here)) return;
    if (length < kOnSurface) break;
  }
  if (may_touch(there, at)) hold_at(at, there, here, side);
}

/// Contact with the surface above h, where h is behind it as it came to the place held. False, with nothing
/// changed, where it is not, or that surface ends there.
bool SmoothContact::touch_where_behind(const Vec3& h) noexcept {
  const Place place = grid_->find(h);
  if (place.brick == BrickGrid::kNone) return false;
  const Jet jet = jet_at(place, place_in(place, h));
  if (!(static_cast<double>(jet.value * side_) < -kInside)) return false;
  const Vec3 god = god_;
  contact_ = false;
  touch_below(h, place, jet, side_);
  const bool held = contact_;
  if (held) {
    corrected_ = true;
    uncorrected_mm_ = (god - h) * grid_->voxel_mm;
  }
  contact_ = true;
  return held;
}

/// The rule of geometry/held_place.h, looked at once in kLookEvery frames: more often is no sooner than a
/// hand feels.
void SmoothContact::agree_with(const Vec3& h) noexcept {
  unlooked_ = 0;
  const auto side = static_cast<double>(side_);
  const auto look = [&](const Vec3& at) noexcept -> geometry::Surroundings {
    const Place place = grid_->find(at);
    if (place.brick == BrickGrid::kNone) return {};
    const Jet jet = jet_at(place, place_in(place, at));
    const auto size = static_cast<double>(jet.gradient.norm());
    // Half way between two sheets the field has no direction.
    return {size > kTellingSlope, side * static_cast<double>(jet.value),
            jet.gradient.cast<double>() * (side / std::max(size, kTellingSlope))};
  };
  switch (geometry::judge_held_place(h, god_, normal_ * side, spacing_, geometry::kMuchNearerRounded, look)) {
    case geometry::HeldPlace::kKeep:
      return;
    case geometry::HeldPlace::kMove:
      note_correction(h);
      if (const Place place = grid_->find(h); place.brick != BrickGrid::kNone)
        touch_below(h, place, jet_at(place, place_in(place, h)), side_);
      return;
    case geometry::HeldPlace::kFree:
      note_correction(h);
      contact_ = false;
      in_front_ = true;
      clear_ = -1.0;
      tested_to_ = h;
      return;
  }
}

}  // namespace palpate::render
