// From the device's frame to the scene's: where the HIP is for a position of the device, and which way a
// force of the scene pushes there.
//
// Positions go by a similarity: a mm of the device is `world_per_device` mm of the scene. Forces keep their
// newtons. So a surface of k N/mm is felt as k times world_per_device: what a device can hold, and whether
// the loop is stable, is a matter of that product, and all limits are judged in the device's frame.
#pragma once

#include "toolkit/geometry/rigid_transform.h"

namespace palpate::device {

struct DeviceMap {
  geometry::RigidTransform world_from_device;  ///< of a device whose mm are the scene's
  double world_per_device = 1.0;               ///< above 0; 0: the HIP is held where the translation is

  DeviceMap() = default;
  /// 1:1.
  DeviceMap(const geometry::RigidTransform& rigid) : world_from_device(rigid) {}  // NOLINT: the same at 1:1
  DeviceMap(const geometry::RigidTransform& rigid, double factor)
      : world_from_device(rigid), world_per_device(factor) {}

  [[nodiscard]] Vec3 world_mm(const Vec3& device_mm) const noexcept {
    return world_from_device * Vec3(world_per_device * device_mm);
  }
  /// Not of a HIP that is held.
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
