// The file that describes an arm: what it is called on USB, what it says, how it is built, what its motors
// bear. TOML; docs/devices.md has the table of its keys. Known models come with Palpate.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "device/arms/arm_kinematics.h"
#include "device/arms/arm_protocol.h"
#include "device/interface/device.h"
#include "device/links/hid_link.h"
#include "toolkit/core/result.h"

namespace palpate::device {

/// When the arm is known to be in its rest pose, in which `rest_counts` are right.
enum class ArmRest : std::uint8_t {
  kStart,    ///< when a program opens it, and it then lies still for half a second
  kButton,   ///< when its calibration button is pressed (report14)
  kPowerOn,  ///< when it is switched on: its counters begin there at 0
};
enum class ArmButton : std::uint8_t {
  kNone,
  kEncoderD,  ///< pressed: encoder d is 10,000 higher
};

struct ArmDescription {
  std::string name;   ///< "polhem-v3"
  std::string what;   ///< for people
  std::string notes;  ///< what nobody has confirmed on hardware, for people; may be empty

  ArmForm form = ArmForm::kReport8;
  HidAddress hid;                ///< of reports
  std::size_t report_bytes = 0;  ///< with padding; 0: without
  std::string serial_line;       ///< of text; may hold `*`
  std::int32_t model = 0;        ///< of text: which it must name; 0: any

  ArmGeometry geometry;
  std::array<double, 3> capstan_mm{}, body_mm{}, counts_per_turn{}, sign{1.0, 1.0, 1.0};
  std::array<double, 3> torque_n_mm_per_a{};

  ArmRest rest = ArmRest::kStart;
  std::array<double, 3> rest_counts{};
  bool rest_in_firmware = false;  ///< the arm's own counters are set (report14)
  ArmButton button = ArmButton::kNone;

  double current_cap_a = 0.0;
  double amplifiers_off_after_s = 0.0;  ///< of the firmware, after the last command; 0: not known

  DeviceLimits limits;  ///< resolution and rate follow from the rest
  bool weight = false;  ///< its weight is held
  ArmMasses masses;

  /// Body angle of one count, with its sign.
  [[nodiscard]] double rad_per_count(std::size_t joint) const noexcept;
  /// Current for a torque about a joint.
  [[nodiscard]] double ma_per_n_mm(std::size_t joint) const noexcept;
  [[nodiscard]] ArmAngles angles_of(const std::array<double, 3>& counts) const noexcept;
};

/// `name` is the file, for messages. What is wrong is said with line and remedy.
[[nodiscard]] Result<ArmDescription> parse_arm_description(std::string_view text, const std::string& name);
[[nodiscard]] Result<ArmDescription> read_arm_description(const std::string& path);

/// A description that comes with Palpate, or one of the user's.
struct KnownArm {
  std::string name;
  std::string file;       ///< empty: it is built in
  std::string_view text;  ///< of what is built in
};
/// Those in the user's folder ($XDG_CONFIG_HOME/palpate/devices or ~/.config/palpate/devices, NAME.toml) come
/// before, and stand for, those of the same name that are built in. In the order of names.
[[nodiscard]] std::vector<KnownArm> known_arms();
[[nodiscard]] std::vector<KnownArm> built_in_arms();
/// By name; an Error with the nearest known one.
[[nodiscard]] Result<ArmDescription> find_arm(const std::string& name);

}  // namespace palpate::device
