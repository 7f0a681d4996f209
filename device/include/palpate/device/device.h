// Haptic devices for the servo loop, and their place in a scene.
//
// Position in, governed force out. Device frame, mm and N; drivers convert counts and motor commands below
// the interface. A DeviceMap leads to the scene's frame.
//
// First:
//   auto opened = device.open();  // zero force commanded
//   if (!opened) return failed(opened.error());
//   const palpate::device::DeviceState state = device.read();
//   if (state.status == palpate::device::ReadStatus::kFresh) target_mm = state.position_mm;
//   device.close();
//
// Mapped:
//   palpate::geometry::RigidTransform world_from_device;
//   world_from_device.translation_mm = {0.0, 0.0, 40.0};
//   const palpate::device::DeviceMap map(world_from_device, 2.0);  // a mm of the device is 2 mm of the scene
//   const Vec3 hip = map.world_mm(state.position_mm);
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::device {

/// The only force type that devices accept. Only the governor can make one, so the compiler refuses any way
/// around it. Device frame, N. For one sending: movable, not copyable, zero after a move, so that no old
/// force can be sent again past the slew limit.
class GovernedForce {
 public:
  GovernedForce(const GovernedForce&) = delete;
  GovernedForce& operator=(const GovernedForce&) = delete;
  GovernedForce(GovernedForce&& other) noexcept : newtons_(other.newtons_) { other.newtons_.setZero(); }
  GovernedForce& operator=(GovernedForce&&) = delete;
  ~GovernedForce() = default;

  [[nodiscard]] const Vec3& newtons() const noexcept { return newtons_; }

 private:
  friend class ForceGovernor;
  explicit GovernedForce(const Vec3& newtons) noexcept : newtons_(newtons) {}

  Vec3 newtons_;
};

/// The shape of the workspace; it fills its box.
enum class WorkspaceShape : std::uint8_t {
  kBox,
  kEllipsoid,  ///< arms on a ball joint; a sphere in a cubic box
  kCylinder,   ///< about the box's z axis, elliptic in general
};

/// A device's capabilities.
struct DeviceLimits {
  double force_max_n = 0.0;             ///< continuous, in any direction
  geometry::Aabb workspace_mm;          ///< device frame
  double resolution_mm = 0.0;           ///< smallest step of position
  double rate_hz = 0.0;                 ///< packets of the link per second
  double stiffness_max_n_per_mm = 0.0;  ///< the stiffest wall without oscillation; 0: unknown
  double damping_max_n_s_per_mm = 0.0;  ///< the largest damping it can render; 0: unknown
  WorkspaceShape workspace_shape = WorkspaceShape::kBox;
};

/// A received packet, for recordings.
struct RawPacket {
  static constexpr std::size_t kMost = 64;
  std::array<std::uint8_t, kMost> bytes{};
  std::uint8_t size = 0;  ///< 0: none

  /// Keeps a packet, cut to kMost.
  void keep(std::span<const std::uint8_t> packet) noexcept {
    size = static_cast<std::uint8_t>(std::min(packet.size(), kMost));
    std::copy_n(packet.begin(), size, bytes.begin());
  }
};

enum class ReadStatus : std::uint8_t {
  kFresh,       ///< a new state since the last read
  kNothingNew,  ///< the link is silent: the last state again
  kGarbled,     ///< bytes without a valid packet for too long
  kLost,        ///< the device is gone
};

struct DeviceState {
  ReadStatus status = ReadStatus::kNothingNew;
  Vec3 position_mm = Vec3::Zero();  ///< as measured, unchecked; the governor checks it
  std::uint32_t buttons = 0;        ///< one bit each
  std::int64_t packet_ns = 0;       ///< arrival of the newest packet, on the servo's clock
  bool homed = true;                ///< its zero is known; else positions are meaningless
  RawPacket raw{};
  /// Progress of homing in the driver's own count; MadeDevice::homing_prompt turns it into words, outside the
  /// frame.
  std::uint8_t homing_step = 0;
};

/// One device. Owned and used by one thread at a time (the servo thread between open and close), except
/// cut_force. The destructor of a device with motors closes it.
class Device {
 public:
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  virtual ~Device() = default;

  /// Its name for the user and recordings.
  [[nodiscard]] virtual std::string name() const = 0;
  /// Makes the device ready with zero force. The call may take long and fail.
  [[nodiscard]] virtual Status open() = 0;
  /// Commands zero force and closes. Safe at any time, and repeatedly.
  virtual void close() noexcept = 0;
  /// Valid while open.
  [[nodiscard]] virtual DeviceLimits limits() const noexcept = 0;

  /// The newest state. Never blocks or allocates.
  [[nodiscard]] virtual DeviceState read() noexcept = 0;
  /// Commands a force. Never blocks or allocates. Call it every frame: the device may hold its last force for
  /// ever.
  virtual void send(GovernedForce force) noexcept = 0;

  /// Commands zero force now, for watchdogs and program ends: from any thread, also during read or send and
  /// after close(). Never blocks or allocates; its command is made in open(). False: nothing was sent
  /// (closed, gone or unsupported). Required of devices with motors; a simulated one in the servo's thread
  /// has nothing to cut.
  virtual bool cut_force() noexcept { return false; }
};

/// Maps positions and forces between device and scene. Positions map by a similarity: a device mm is
/// `world_per_device` scene mm. Forces keep their newtons. A surface of k N/mm therefore feels like k times
/// world_per_device, which decides stability; all limits are judged in the device's frame.
struct DeviceMap {
  geometry::RigidTransform world_from_device;  ///< of a device whose mm are the scene's
  double world_per_device = 1.0;               ///< above 0; 0: the HIP is held at the translation

  DeviceMap() = default;
  /// 1:1.
  DeviceMap(const geometry::RigidTransform& rigid) : world_from_device(rigid) {}  // NOLINT: the same at 1:1
  DeviceMap(const geometry::RigidTransform& rigid, double factor)
      : world_from_device(rigid), world_per_device(factor) {}

  [[nodiscard]] Vec3 world_mm(const Vec3& device_mm) const noexcept {
    return world_from_device * Vec3(world_per_device * device_mm);
  }
  /// Undefined for a held HIP.
  [[nodiscard]] Vec3 device_mm(const Vec3& world_mm) const noexcept {
    return (world_from_device.inverse() * world_mm) / world_per_device;
  }
  [[nodiscard]] Vec3 device_n(const Vec3& world_n) const noexcept {
    return world_from_device.inverse().rotate(world_n);
  }
  [[nodiscard]] Vec3 world_n(const Vec3& device_n) const noexcept {
    return world_from_device.rotate(device_n);
  }
};

}  // namespace palpate::device
