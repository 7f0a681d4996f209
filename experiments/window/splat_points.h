// A model's points for drawing: in random order, so every prefix is an even sample, with colours and normals.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/renderer.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::experiments {

enum class ColourBy : std::uint8_t { kPlain, kHeight, kFile, kStiffness, kFriction, kError };
inline constexpr std::array kColours = {ColourBy::kPlain,     ColourBy::kHeight,   ColourBy::kFile,
                                        ColourBy::kStiffness, ColourBy::kFriction, ColourBy::kError};
[[nodiscard]] const char* colour_name(ColourBy by) noexcept;

using Rgba = std::array<std::uint8_t, 4>;
/// Of points without another colour. Ivory: light enough to show shading.
inline constexpr Rgba kPlainColour = {226, 216, 196, 255};
/// Components -127 to 127; 0: unknown.
using PackedNormal = std::array<std::int8_t, 4>;

/// The range of the colours.
struct ColourScale {
  double low = 0.0, high = 0.0;  ///< equal: one colour
  std::string unit;
  std::string nothing;  ///< why nothing is shown; empty: shown
};

/// A place's neighbours and planes, as the toolkit finds them for renderers.
struct Surroundings {
  search::NeighbourTable neighbours;  ///< in the cloud's order
  std::vector<PackedNormal> normals;  ///< in the cloud's order; outward on closed surfaces
  /// Half a vertex's box: the largest offset to a neighbour per axis (section 3.1.1.1).
  [[nodiscard]] Vec3 half_box_mm(const cloud::Cloud& cloud, std::uint32_t point) const noexcept;
};
/// O(n), on one thread beside a servo.
[[nodiscard]] Surroundings find_surroundings(const cloud::Cloud& cloud);

/// A fixed random permutation of 0 to n - 1. O(n).
[[nodiscard]] std::vector<std::uint32_t> even_order(std::size_t n);
/// Coordinates relative to the cloud's origin, three per point, in this order. O(n).
[[nodiscard]] std::vector<float> places_in_order(const cloud::Cloud& cloud,
                                                 std::span<const std::uint32_t> order);
/// Colours in this order. kError uses the model's formula, else its own faces, and may take a microsecond a
/// point; others are quick. `scale` gets the range.
[[nodiscard]] std::vector<Rgba> colours_in_order(const render::ModelInput& model,
                                                 std::span<const std::uint32_t> order, ColourBy by,
                                                 ColourScale& scale);
/// Colour of a share, 0 to 1: dark blue over green to yellow.
[[nodiscard]] Rgba ramp(double share) noexcept;
/// Colour of a signed error: blue (-1) over white to red (1).
[[nodiscard]] Rgba two_sided(double share) noexcept;

}  // namespace palpate::experiments
