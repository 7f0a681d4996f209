#include "device/spacemouse/spacemouse_reports.h"

#include <algorithm>

namespace palpate::device {
namespace {

constexpr std::uint16_t kLogitech = 0x046d, k3Dconnexion = 0x256f;
constexpr std::array kModels = {
    SpaceMouseModel{kLogitech, 0xc603, "SpaceMouse Plus XT", true},
    SpaceMouseModel{kLogitech, 0xc605, "CADman", false},
    SpaceMouseModel{kLogitech, 0xc606, "SpaceMouse Classic", true},
    SpaceMouseModel{kLogitech, 0xc621, "Spaceball 5000", false},
    SpaceMouseModel{kLogitech, 0xc623, "SpaceTraveler", false},
    SpaceMouseModel{kLogitech, 0xc625, "SpacePilot", false},
    SpaceMouseModel{kLogitech, 0xc626, "SpaceNavigator", false},
    SpaceMouseModel{kLogitech, 0xc627, "SpaceExplorer", false},
    SpaceMouseModel{kLogitech, 0xc628, "SpaceNavigator for Notebooks", false},
    SpaceMouseModel{kLogitech, 0xc629, "SpacePilot Pro", false},
    SpaceMouseModel{kLogitech, 0xc62b, "SpaceMouse Pro", false},
    SpaceMouseModel{kLogitech, 0xc640, "NuLOOQ", true},
    SpaceMouseModel{k3Dconnexion, 0xc62e, "SpaceMouse Wireless (cable)", false},
    SpaceMouseModel{k3Dconnexion, 0xc62f, "SpaceMouse Wireless (receiver)", false},
    SpaceMouseModel{k3Dconnexion, 0xc631, "SpaceMouse Pro Wireless (cable)", false},
    SpaceMouseModel{k3Dconnexion, 0xc632, "SpaceMouse Pro Wireless (receiver)", false},
    SpaceMouseModel{k3Dconnexion, 0xc633, "SpaceMouse Enterprise", false},
    SpaceMouseModel{k3Dconnexion, 0xc635, "SpaceMouse Compact", false},
    SpaceMouseModel{k3Dconnexion, 0xc636, "SpaceMouse Module", false},
    SpaceMouseModel{k3Dconnexion, 0xc638, "SpaceMouse Pro Wireless (Bluetooth)", false},
    SpaceMouseModel{k3Dconnexion, 0xc63a, "SpaceMouse Wireless (Bluetooth)", false},
    SpaceMouseModel{k3Dconnexion, 0xc641, "3Dconnexion device without buttons", false},
    SpaceMouseModel{k3Dconnexion, 0xc652, "Universal receiver", false}};

constexpr std::uint8_t kAxesNumber = 1, kTurnsNumber = 2, kButtonsNumber = 3;
constexpr std::size_t kThree = 7, kSix = 13;  // bytes with the number
constexpr std::size_t kFewestButtons = 2, kMostButtons = 7;

void take_three(std::span<const std::uint8_t> bytes, std::array<std::int16_t, 3>& into) noexcept {
  for (std::size_t i = 0; i < into.size(); ++i)
    into[i] = static_cast<std::int16_t>(static_cast<std::uint16_t>(bytes[2 * i] | (bytes[2 * i + 1] << 8U)));
}

}  // namespace

std::span<const SpaceMouseModel> spacemouse_models() noexcept {
  return kModels;
}

const SpaceMouseModel* spacemouse_model(std::uint16_t vendor, std::uint16_t product) noexcept {
  const auto* at = std::find_if(kModels.begin(), kModels.end(), [&](const SpaceMouseModel& model) {
    return model.vendor == vendor && model.product == product;
  });
  return at == kModels.end() ? nullptr : at;
}

std::optional<SpaceMouseReport> decoded_spacemouse(std::span<const std::uint8_t> bytes) noexcept {
  using Kind = SpaceMouseReport::Kind;
  if (bytes.empty()) return std::nullopt;
  SpaceMouseReport report;
  const std::size_t size = bytes.size();
  switch (bytes[0]) {
    case kAxesNumber:
      if (size != kThree && size != kSix) return std::nullopt;
      report.kind = Kind::kAxes;
      take_three(bytes.subspan(1), report.axes);
      report.has_turns = size == kSix;
      if (report.has_turns) take_three(bytes.subspan(kThree), report.turns);
      return report;
    case kTurnsNumber:
      if (size != kThree) return std::nullopt;
      report.kind = Kind::kTurns;
      report.has_turns = true;
      take_three(bytes.subspan(1), report.turns);
      return report;
    case kButtonsNumber:
      if (size < kFewestButtons || size > kMostButtons) return std::nullopt;
      report.kind = Kind::kButtons;
      for (std::size_t i = 1; i < std::min<std::size_t>(size, 1 + sizeof(report.buttons)); ++i)
        report.buttons |= static_cast<std::uint32_t>(bytes[i]) << (8 * (i - 1));
      return report;
    default:
      return report;
  }
}

}  // namespace palpate::device
