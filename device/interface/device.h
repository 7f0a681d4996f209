// What every haptic device looks like to the servo loop: a position in, a governed force out. Device frame:
// mm and N; conversions from counts and to motor commands happen below this interface.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "device/interface/governed_force.h"
#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::device {

/// Of what shape the places are that a device reaches; it fills its box.
enum class WorkspaceShape : std::uint8_t {
  kBox,
  kEllipsoid,  ///< arms on a ball joint; with a cube for a box: a sphere
  kCylinder,   ///< about the box's z axis, elliptic where the box is
};

/// What a device can do. All are properties of the device, none of the user.
struct DeviceLimits {
  double force_max_n = 0.0;             ///< continuous, in any direction
  geometry::Aabb workspace_mm;          ///< device frame
  double resolution_mm = 0.0;           ///< smallest step of position
  double rate_hz = 0.0;                 ///< frames the link carries in a second
  double stiffness_max_n_per_mm = 0.0;  ///< the stiffest wall it holds without swinging; 0: not known
  double damping_max_n_s_per_mm = 0.0;  ///< the most damping that it can show; 0: not known
  WorkspaceShape workspace_shape = WorkspaceShape::kBox;
};

/// A packet as it came over the link, for recordings.
struct RawPacket {
  static constexpr std::size_t kMost = 64;
  std::array<std::uint8_t, kMost> bytes{};
  std::uint8_t size = 0;  ///< 0: the device has none
};

enum class ReadStatus : std::uint8_t {
  kFresh,       ///< a new state since the last read
  kNothingNew,  ///< the link is silent: the last state again
  kGarbled,     ///< bytes come, and no packet among them for too long
  kLost,        ///< the device is gone
};

struct DeviceState {
  ReadStatus status = ReadStatus::kNothingNew;
  Vec3 position_mm = Vec3::Zero();  ///< as measured; may be anything, the governor checks
  std::uint32_t buttons = 0;        ///< one bit each
  std::int64_t packet_ns = 0;       ///< when the newest packet came, on the servo's clock
  bool homed = true;                ///< its zero is known; without it positions mean nothing
  RawPacket raw{};
  /// While it is not homed: how far that has come, in the driver's own count. MadeDevice::homing_prompt makes
  /// words of it, outside the frame.
  std::uint8_t homing_step = 0;
};

/// One device. Owned and used by one thread at a time (the servo thread between open and close), but for
/// cut_force. The destructor of one with motors closes it.
class Device {
 public:
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  virtual ~Device() = default;

  /// Its name for people and recordings.
  [[nodiscard]] virtual std::string name() const = 0;
  /// Makes it ready, with zero force commanded. May take long and fail.
  [[nodiscard]] virtual Status open() = 0;
  /// Commands zero force and lets go. Safe to call at any time, twice too.
  virtual void close() noexcept = 0;
  /// Valid while open.
  [[nodiscard]] virtual DeviceLimits limits() const noexcept = 0;

  /// The newest state. Never blocks, never allocates.
  [[nodiscard]] virtual DeviceState read() noexcept = 0;
  /// Commands a force. Never blocks, never allocates. Without a call the device may hold its last force for
  /// ever: send every frame.
  virtual void send(GovernedForce force) noexcept = 0;

  /// Commands zero force now, for watchdogs and for the end of a program: from any thread, also while another
  /// one reads or sends, and after close(). Never blocks, never allocates; what it sends was made in open().
  /// False: nothing was sent, for the device is closed or gone, or cannot do this. A device with motors must
  /// be able to; one that only pretends, within the servo's thread, has nothing to cut.
  virtual bool cut_force() noexcept { return false; }
};

}  // namespace palpate::device
