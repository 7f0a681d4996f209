// Drawings over the cloud: hand, force and neighbourhood.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "experiments/window/camera.h"
#include "experiments/window/link.h"

struct ImDrawList;

namespace palpate::experiments {

/// Colours over the cloud: red, green, blue. Tests find items by them.
inline constexpr std::array<std::uint8_t, 3> kHipColour = {255, 92, 60}, kGodObjectColour = {90, 220, 255},
                                             kForceColour = {255, 200, 40},
                                             kWorkspaceColour = {120, 135, 160},
                                             kNearColour = {110, 235, 140}, kBoxColour = {235, 130, 235},
                                             kFacetColour = {255, 255, 255}, kCellColour = {255, 150, 60},
                                             kEmptyCellColour = {150, 160, 175};

/// World-frame lines for a camera whose view starts at the window's upper left corner.
class Overlay {
 public:
  Overlay(ImDrawList* onto, const Camera& camera, double width_px, double height_px);

  void line(const Vec3& a_mm, const Vec3& b_mm, const std::array<std::uint8_t, 3>& colour, float thick_px,
            float solid = 1.0f) const;
  /// The twelve edges of a box; corner k has bit 0 for x, 1 for y, 2 for z.
  void box(const std::array<Vec3, 8>& corners_mm, const std::array<std::uint8_t, 3>& colour, float thick_px,
           float solid) const;
  void ball(const Vec3& at_mm, const std::array<std::uint8_t, 3>& colour, float radius_px, bool filled) const;
  void arrow(const Vec3& from_mm, const Vec3& to_mm, const std::array<std::uint8_t, 3>& colour) const;
  void triangle(const std::array<Vec3, 3>& corners_mm, const std::array<std::uint8_t, 3>& colour) const;

 private:
  [[nodiscard]] std::optional<Pixel> seen(const Vec3& world_mm) const;
  /// The line without what is nearer than the near plane.
  [[nodiscard]] std::optional<SeenLine> seen_line(const Vec3& a_mm, const Vec3& b_mm) const;

  ImDrawList* onto_;
  Mat4 clip_from_world_;
  double width_px_, height_px_;
};

/// World corners of a box under a map.
template <class Map>
[[nodiscard]] std::array<Vec3, 8> corners_of(const Vec3& low, const Vec3& high, Map&& map) {
  std::array<Vec3, 8> corners;
  for (std::size_t k = 0; k < corners.size(); ++k)
    corners[k] = map(Vec3{(k & 1u) != 0 ? high.x() : low.x(), (k & 2u) != 0 ? high.y() : low.y(),
                          (k & 4u) != 0 ? high.z() : low.z()});
  return corners;
}

/// Length of a force arrow at the governor's limit, as a share of the scene's radius.
inline constexpr double kArrowAtLimit = 0.6;

/// Draws HIP, god object and force of the felt renderer's answer.
void draw_contact(const Overlay& overlay, const WatchedTick& now, double force_limit_n, double radius_mm);

}  // namespace palpate::experiments
