#include "experiments/window/overlay.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>

namespace palpate::experiments {
namespace {

constexpr float kLinePx = 2.0f, kArrowPx = 4.0f, kHeadPx = 15.0f;
constexpr float kHipPx = 8.0f, kGodObjectPx = 6.0f;
constexpr float kFacetSolid = 0.35f;
constexpr float kWholeByte = 255.0f;

ImU32 colour_of(const std::array<std::uint8_t, 3>& rgb, float solid) {
  return IM_COL32(rgb[0], rgb[1], rgb[2], static_cast<int>(solid * kWholeByte));
}

ImVec2 place_of(const Pixel& pixel) {
  return {static_cast<float>(pixel.x), static_cast<float>(pixel.y)};
}

}  // namespace

Overlay::Overlay(ImDrawList* onto, const Camera& camera, double width_px, double height_px)
    : onto_(onto),
      clip_from_world_(camera.clip_from_world(width_px, height_px)),
      width_px_(width_px),
      height_px_(height_px) {}

std::optional<Pixel> Overlay::seen(const Vec3& world_mm) const {
  if (!is_finite(world_mm)) return std::nullopt;
  return project(clip_from_world_, world_mm, width_px_, height_px_);
}

std::optional<SeenLine> Overlay::seen_line(const Vec3& a_mm, const Vec3& b_mm) const {
  if (!is_finite(a_mm) || !is_finite(b_mm)) return std::nullopt;
  return project_line(clip_from_world_, a_mm, b_mm, width_px_, height_px_);
}

void Overlay::line(const Vec3& a_mm, const Vec3& b_mm, const std::array<std::uint8_t, 3>& colour,
                   float thick_px, float solid) const {
  if (const std::optional<SeenLine> both = seen_line(a_mm, b_mm))
    onto_->AddLine(place_of(both->a), place_of(both->b), colour_of(colour, solid), thick_px);
}

void Overlay::box(const std::array<Vec3, 8>& corners_mm, const std::array<std::uint8_t, 3>& colour,
                  float thick_px, float solid) const {
  for (std::size_t k = 0; k < corners_mm.size(); ++k)
    for (const std::size_t bit : {std::size_t{1}, std::size_t{2}, std::size_t{4}})
      if ((k & bit) == 0) line(corners_mm[k], corners_mm[k | bit], colour, thick_px, solid);
}

void Overlay::ball(const Vec3& at_mm, const std::array<std::uint8_t, 3>& colour, float radius_px,
                   bool filled) const {
  const std::optional<Pixel> at = seen(at_mm);
  if (!at) return;
  if (filled) onto_->AddCircleFilled(place_of(*at), radius_px, colour_of(colour, 1.0f));
  onto_->AddCircle(place_of(*at), radius_px, filled ? IM_COL32(20, 20, 25, 255) : colour_of(colour, 1.0f), 0,
                   filled ? 1.0f : kLinePx);
}

void Overlay::arrow(const Vec3& from_mm, const Vec3& to_mm, const std::array<std::uint8_t, 3>& colour) const {
  const std::optional<SeenLine> both = seen_line(from_mm, to_mm);
  if (!both) return;
  const ImVec2 a = place_of(both->a), b = place_of(both->b);
  const float dx = b.x - a.x, dy = b.y - a.y, length = std::hypot(dx, dy);
  const ImU32 ink = colour_of(colour, 1.0f);
  if (length < 1.0f) {
    onto_->AddCircleFilled(b, kArrowPx, ink);
    return;
  }
  // The tip is beside or behind the eye: the shaft leaves the picture without a head.
  if (both->cut_b) {
    onto_->AddLine(a, b, ink, kArrowPx);
    return;
  }
  const float ux = dx / length, uy = dy / length, head = std::min(kHeadPx, 0.6f * length);
  const ImVec2 neck = {b.x - head * ux, b.y - head * uy};
  onto_->AddLine(a, neck, ink, kArrowPx);
  onto_->AddTriangleFilled(b, {neck.x - 0.45f * head * uy, neck.y + 0.45f * head * ux},
                           {neck.x + 0.45f * head * uy, neck.y - 0.45f * head * ux}, ink);
}

void Overlay::triangle(const std::array<Vec3, 3>& corners_mm,
                       const std::array<std::uint8_t, 3>& colour) const {
  const std::optional<Pixel> a = seen(corners_mm[0]), b = seen(corners_mm[1]), c = seen(corners_mm[2]);
  if (!a || !b || !c) return;
  onto_->AddTriangleFilled(place_of(*a), place_of(*b), place_of(*c), colour_of(colour, kFacetSolid));
  onto_->AddTriangle(place_of(*a), place_of(*b), place_of(*c), colour_of(colour, 1.0f), 1.5f);
}

void draw_contact(const Overlay& overlay, const WatchedTick& now, double force_limit_n, double radius_mm) {
  if (now.ticks == 0) return;
  const Vec3& hip_mm = now.tick.hip_mm;
  const render::Frame& frame = now.tick.frame;
  if (frame.contact) {
    overlay.line(hip_mm, frame.god_object_mm, kHipColour, kLinePx);
    // Shows the governor's force sent to the device, rotated into the world, not the renderer's.
    const Vec3 force_n = now.map.world_n(now.tick.sent_n);
    const double scale = force_limit_n > 0.0 ? kArrowAtLimit * radius_mm / force_limit_n : 0.0;
    overlay.arrow(frame.god_object_mm, frame.god_object_mm + scale * force_n, kForceColour);
    overlay.ball(frame.god_object_mm, kGodObjectColour, kGodObjectPx, true);
  }
  overlay.ball(hip_mm, kHipColour, kHipPx, false);
  overlay.ball(hip_mm, kHipColour, kHipPx / 2.5f, true);
}

}  // namespace palpate::experiments
