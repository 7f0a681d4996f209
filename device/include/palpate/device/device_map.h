// Maps device positions to scene positions, and scene forces to device forces.
//
// Positions map by a similarity: a device mm is `world_per_device` scene mm. Forces keep their newtons. A
// surface of k N/mm therefore feels like k times world_per_device, which decides stability; all limits are
// judged in the device's frame.
//
// First:
//   palpate::geometry::RigidTransform world_from_device;
//   world_from_device.translation_mm = {0.0, 0.0, 40.0};
//   const palpate::device::DeviceMap map(world_from_device, 2.0);  // a mm of the device is 2 mm of the scene
//   const Vec3 hip = map.world_mm(state.position_mm);
#pragma once

#include <palpate/geometry.h>

namespace palpate::device {

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
