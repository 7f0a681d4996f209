// A model's points as a window draws them: in random order, so that every beginning of them is an even
// sample; with colours of a choice, and normals once these are known.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "toolkit/neighbourhood/neighbour_table.h"
#include "toolkit/render/renderer.h"

namespace palpate::experiments {

enum class ColourBy : std::uint8_t { kPlain, kHeight, kFile, kStiffness, kFriction, kError };
inline constexpr std::array kColours = {ColourBy::kPlain,     ColourBy::kHeight,   ColourBy::kFile,
                                        ColourBy::kStiffness, ColourBy::kFriction, ColourBy::kError};
[[nodiscard]] const char* colour_name(ColourBy by) noexcept;

using Rgba = std::array<std::uint8_t, 4>;
/// Components -127 to 127; 0: not known.
using PackedNormal = std::array<std::int8_t, 4>;

/// What the colours run over.
struct ColourScale {
  double low = 0.0, high = 0.0;  ///< equal: one colour
  std::string unit;
  std::string nothing;  ///< why there is nothing to show; empty: there is
};

/// What a renderer with points knows of a place, found by the window for itself: neighbours and planes as the
/// toolkit finds them for any renderer.
struct Surroundings {
  neighbourhood::NeighbourTable neighbours;  ///< in the cloud's order
  std::vector<PackedNormal> normals;         ///< in the cloud's order; outward where the surface is closed
  /// Half of the box of a vertex: the largest offset to a neighbour along each axis (section 3.1.1.1).
  [[nodiscard]] Vec3 half_box_mm(const cloud::Cloud& cloud, std::uint32_t point) const noexcept;
};
/// O(n), on one thread: it runs beside a servo.
[[nodiscard]] Surroundings find_surroundings(const cloud::Cloud& cloud);

/// 0 to n - 1 in a random order that is the same every time. O(n).
[[nodiscard]] std::vector<std::uint32_t> even_order(std::size_t n);
/// Coordinates relative to the cloud's origin, three a point, in this order. O(n).
[[nodiscard]] std::vector<float> places_in_order(const cloud::Cloud& cloud,
                                                 std::span<const std::uint32_t> order);
/// Colours in this order. kError asks the model's formula, else its own faces, and may take a microsecond a
/// point; the others are quick. `scale` says what was shown.
[[nodiscard]] std::vector<Rgba> colours_in_order(const render::ModelInput& model,
                                                 std::span<const std::uint32_t> order, ColourBy by,
                                                 ColourScale& scale);
/// The colour of a share, 0 to 1, of the scale: dark blue over green to yellow.
[[nodiscard]] Rgba ramp(double share) noexcept;
/// From blue (-1) over white to red (1): signed errors.
[[nodiscard]] Rgba two_sided(double share) noexcept;

}  // namespace palpate::experiments
