// The TOML description of an arm: USB identity, protocol, geometry and motor limits.
// docs/how-to/connect-a-device.md lists the keys. Known models come with Palpate.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/device/device.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "device/links/hid_link.h"
#include "device/links/newest_command.h"

namespace palpate::device {

// Closed-form forward kinematics and Jacobian of open arms with three motors: a three-joint chain
// (WoodenHaptics, Polhem v1, the aluminium edition) and the five-bar linkage of Polhem v2 and v3.
//
// Angles in rad, in the base frame: A turns the arm about z; B tilts the upper arm from the vertical (chain)
// or is the crank's angle (five-bar); C likewise for the forearm. Lengths in mm. Source: the makers'
// published kinematics, derived anew.

enum class ArmLinkage : std::uint8_t { kChain, kFiveBar };

struct ArmGeometry {
  ArmLinkage linkage = ArmLinkage::kChain;
  /// Chain: L_a (height of the shoulder), L_b, L_c. Five-bar: L0 (between the cranks), L1 (crank B), L2
  /// (crank C), L3 (rod), L4 (elbow back to rod), L5 (forearm).
  std::array<double, 6> lengths_mm{};
  Vec3 origin_mm = Vec3::Zero();  ///< of the device frame, in base coordinates
};

using ArmAngles = std::array<double, 3>;

struct ArmPose {
  Vec3 position_mm = Vec3::Zero();
  Mat3 mm_per_rad = Mat3::Zero();  ///< column i: derivative by angle i
};

/// Nothing if the linkage does not close, or only in its other form. A few dozen operations.
[[nodiscard]] std::optional<ArmPose> arm_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept;

/// Torques (N*mm) about A, B, C for a force (N): the transposed Jacobian, by virtual work.
[[nodiscard]] inline Vec3 torques_n_mm(const ArmPose& pose, const Vec3& force_n) noexcept {
  return pose.mm_per_rad.transpose() * force_n;
}

/// Masses of a chain's bodies, and the distances of their centres from each body's joint.
struct ArmMasses {
  double upper_kg = 0.0, upper_mm = 0.0;
  double fore_kg = 0.0, fore_mm = 0.0;
};
/// Torques (N*mm) about A, B, C that hold the chain against its weight. Zero for a five-bar.
[[nodiscard]] Vec3 weight_torques_n_mm(const ArmGeometry& geometry, const ArmMasses& masses,
                                       const ArmAngles& angles) noexcept;

/// Upper estimate (mm) of the smallest step made jointly by steps (rad) of the three angles.
[[nodiscard]] double arm_resolution_mm(const ArmGeometry& geometry,
                                       const std::array<double, 3>& step_rad) noexcept;

// Messages from and to open arms.
//
//   report8   8 bytes, little-endian int16: encoders a, b, c, counter / currents a, b, c in mA, 0
//   report14  14 bytes: encoders a..f, info (1: calibration button) / mA a, b, c, command, 3 attributes;
//             command 1 sets the encoders: attributes a, b, c, the currents' places d, e, f
//   text      "[model,a,b,c,d,e,f,error]\n" / "[mA,mA,mA]", blanks up to 15, "\n"
//
// Reports may be padded (Teensy: 64 bytes). None has its own checksum; USB has one. report8 arrives unasked,
// the others one per command. Source: the makers' published programs (facts).

enum class ArmForm : std::uint8_t { kReport8, kReport14, kText };

/// Whether it answers each command with one report and sends none unasked.
[[nodiscard]] constexpr bool alternates(ArmForm form) noexcept {
  return form != ArmForm::kReport8;
}
/// Bytes of a report without padding; 0 for text.
[[nodiscard]] constexpr std::size_t report_size(ArmForm form) noexcept {
  return form == ArmForm::kReport8 ? 8 : form == ArmForm::kReport14 ? 14 : 0;
}

struct ArmReport {
  std::array<std::int32_t, 6> counts{};  ///< three for report8
  std::uint16_t counter = 0;             ///< of report8
  bool calibrate = false;                ///< calibration button, of report14
  std::int32_t model = 0, error = 0;     ///< of text

  friend bool operator==(const ArmReport&, const ArmReport&) = default;
};

/// Decodes one report; nothing if it is not `padded` bytes long.
[[nodiscard]] std::optional<ArmReport> decoded_report(ArmForm form, std::size_t padded,
                                                      std::span<const std::uint8_t> bytes) noexcept;

/// Finds lines in a split, joined or damaged stream. One thread; no allocation.
class ArmLineReader {
 public:
  static constexpr std::size_t kMaxLine = 96;  ///< eight numbers of eleven characters, and separators
  [[nodiscard]] std::optional<ArmReport> take(std::uint8_t byte) noexcept;
  /// The last line of take(), without its end.
  [[nodiscard]] std::span<const std::uint8_t> line() const noexcept { return {last_.data(), last_size_}; }
  [[nodiscard]] std::uint32_t malformed_in_a_row() const noexcept { return malformed_in_a_row_; }
  void clear() noexcept { *this = {}; }

 private:
  void malformed() noexcept;

  std::array<std::uint8_t, kMaxLine> held_{}, last_{};
  std::size_t size_ = 0, last_size_ = 0;
  bool too_long_ = false;
  std::uint32_t malformed_in_a_row_ = 0;
};
/// Decodes a line without its end: exactly eight integers, at most 10 million, beyond any encoder.
[[nodiscard]] std::optional<ArmReport> decoded_line(std::span<const std::uint8_t> line) noexcept;

using Milliamps = std::array<std::int16_t, 3>;

/// `padded`: as for reports.
[[nodiscard]] CommandBytes encoded_currents(ArmForm form, std::size_t padded,
                                            const Milliamps& currents) noexcept;
/// Zero command for an unknown state. Text gets it twice: a board that holds half a line takes the first as
/// its rest.
[[nodiscard]] CommandBytes encoded_zero(ArmForm form, std::size_t padded) noexcept;
/// Sets the arm's counters; report14 only.
[[nodiscard]] CommandBytes encoded_counts(std::size_t padded,
                                          const std::array<std::int16_t, 6>& counts) noexcept;

/// When the arm is known to be in its rest pose, where `rest_counts` hold.
enum class ArmRest : std::uint8_t {
  kStart,    ///< when a program opens it and it lies still for half a second
  kButton,   ///< when its calibration button is pressed (report14)
  kPowerOn,  ///< at power-on: its counters start at 0
};
enum class ArmButton : std::uint8_t {
  kNone,
  kEncoderD,  ///< pressed: encoder d is 10,000 higher
};

struct ArmDescription {
  std::string name;   ///< "polhem-v3"
  std::string what;   ///< for people
  std::string notes;  ///< unconfirmed on hardware, for people; may be empty

  ArmForm form = ArmForm::kReport8;
  HidAddress hid;                ///< of reports
  std::size_t report_bytes = 0;  ///< with padding; 0: unpadded
  std::string serial_line;       ///< for text; may contain `*`
  std::int32_t model = 0;        ///< for text: model to expect; 0: any

  ArmGeometry geometry;
  std::array<double, 3> capstan_mm{}, body_mm{}, counts_per_turn{}, sign{1.0, 1.0, 1.0};
  std::array<double, 3> torque_n_mm_per_a{};

  ArmRest rest = ArmRest::kStart;
  std::array<double, 3> rest_counts{};
  bool rest_in_firmware = false;  ///< the arm sets its own counters (report14)
  ArmButton button = ArmButton::kNone;

  double current_cap_a = 0.0;
  double amplifiers_off_after_s = 0.0;  ///< after the last command, by the firmware; 0: unknown

  DeviceLimits limits;  ///< resolution and rate are derived
  bool weight = false;  ///< compensate the arm's weight
  ArmMasses masses;

  /// Signed body angle per count.
  [[nodiscard]] double rad_per_count(std::size_t joint) const noexcept;
  [[nodiscard]] double ma_per_n_mm(std::size_t joint) const noexcept;
  [[nodiscard]] ArmAngles angles_of(const std::array<double, 3>& counts) const noexcept;
};

/// `name` is the file name for messages. Errors give the line and the remedy.
[[nodiscard]] Result<ArmDescription> parse_arm_description(std::string_view text, const std::string& name);
[[nodiscard]] Result<ArmDescription> read_arm_description(const std::string& path);

struct KnownArm {
  std::string name;
  std::string file;       ///< empty: built in
  std::string_view text;  ///< of a built-in one
};
/// Sorted by name. Files NAME.toml in the user's folder ($XDG_CONFIG_HOME/palpate/devices or
/// ~/.config/palpate/devices) replace built-in descriptions of that name.
[[nodiscard]] std::vector<KnownArm> known_arms();
[[nodiscard]] std::vector<KnownArm> built_in_arms();
/// Finds by name; an Error suggests the nearest name.
[[nodiscard]] Result<ArmDescription> find_arm(const std::string& name);

}  // namespace palpate::device
