// What is drawn over the cloud: where the hand is, what it feels, and what is near.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "experiments/window/camera.h"
#include "experiments/window/feed.h"

struct ImDrawList;

namespace palpate::experiments {

/// The colours of what is drawn over the cloud: red, green, blue. Tests find things by them.
inline constexpr std::array<std::uint8_t, 3> kHipColour = {255, 92, 60}, kGodObjectColour = {90, 220, 255},
                                             kForceColour = {255, 200, 40},
                                             kWorkspaceColour = {120, 135, 160},
                                             kNearColour = {110, 235, 140}, kBoxColour = {235, 130, 235},
                                             kFacetColour = {255, 255, 255}, kCellColour = {255, 150, 60},
                                             kEmptyCellColour = {150, 160, 175};

/// Lines of the world, to be seen from a camera in a part of the window that begins at its upper left corner.
class Overlay {
 public:
  Overlay(ImDrawList* onto, const Camera& camera, double width_px, double height_px);

  void line(const Vec3& a_mm, const Vec3& b_mm, const std::array<std::uint8_t, 3>& colour, float thick_px,
            float solid = 1.0f) const;
  /// The twelve edges of the box that has these corners: corner k at bit 0 for x, 1 for y, 2 for z.
  void box(const std::array<Vec3, 8>& corners_mm, const std::array<std::uint8_t, 3>& colour, float thick_px,
           float solid) const;
  void ball(const Vec3& at_mm, const std::array<std::uint8_t, 3>& colour, float radius_px, bool filled) const;
  void arrow(const Vec3& from_mm, const Vec3& to_mm, const std::array<std::uint8_t, 3>& colour) const;
  void triangle(const std::array<Vec3, 3>& corners_mm, const std::array<std::uint8_t, 3>& colour) const;

 private:
  [[nodiscard]] std::optional<Pixel> seen(const Vec3& world_mm) const;
  /// What is nearer than the near plane is cut off.
  [[nodiscard]] std::optional<SeenLine> seen_line(const Vec3& a_mm, const Vec3& b_mm) const;

  ImDrawList* onto_;
  Mat4 clip_from_world_;
  double width_px_, height_px_;
};

/// The world's corners of a box whose corners a map places.
template <class Map>
[[nodiscard]] std::array<Vec3, 8> corners_of(const Vec3& low, const Vec3& high, Map&& map) {
  std::array<Vec3, 8> corners;
  for (std::size_t k = 0; k < corners.size(); ++k)
    corners[k] = map(Vec3{(k & 1u) != 0 ? high.x() : low.x(), (k & 2u) != 0 ? high.y() : low.y(),
                          (k & 4u) != 0 ? high.z() : low.z()});
  return corners;
}

/// The arrow of a force is so long where it is the governor's limit, as a share of the scene's radius.
inline constexpr double kArrowAtLimit = 0.6;

/// HIP, god object and the force between them, as the felt renderer answered.
void draw_contact(const Overlay& overlay, const WatchedTick& now, double force_limit_n, double radius_mm);

}  // namespace palpate::experiments
