// What 3Dconnexion's devices report, and which they are. Source: spacenavd and the makers' ids (facts).
//
//   number 1     X, Y, Z, int16 little-endian (7 bytes), newer ones with Rx, Ry, Rz after them (13)
//   number 2     Rx, Ry, Rz (7)
//   number 3     buttons, a bit each, up to 6 bytes
//   number 0x17  battery
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace palpate::device {

struct SpaceMouseModel {
  std::uint16_t vendor, product;
  const char* name;
  bool axes_as_is;  ///< else y and z are swapped and turned: (x, -z, -y)
};
/// Every model that is opened; keyboards and CadMouse, which share the maker's id, are not among them.
[[nodiscard]] std::span<const SpaceMouseModel> spacemouse_models() noexcept;
/// nullptr: none that is opened.
[[nodiscard]] const SpaceMouseModel* spacemouse_model(std::uint16_t vendor, std::uint16_t product) noexcept;

// A multi-axis controller of the generic desktop page: so keyboards of the same id are told apart.
inline constexpr std::uint16_t kSpaceMousePage = 0x01, kSpaceMouseUsage = 0x08;

struct SpaceMouseReport {
  enum class Kind : std::uint8_t { kAxes, kTurns, kButtons, kOther };
  Kind kind = Kind::kOther;
  std::array<std::int16_t, 3> axes{}, turns{};
  bool has_turns = false;
  std::uint32_t buttons = 0;
};
/// Nothing where the length does not fit the number. Numbers that are not known are kOther.
[[nodiscard]] std::optional<SpaceMouseReport> decoded_spacemouse(
    std::span<const std::uint8_t> bytes) noexcept;

}  // namespace palpate::device
