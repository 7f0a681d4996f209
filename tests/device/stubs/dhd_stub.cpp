#include "tests/device/stubs/dhdc.h"
#include "tests/device/stubs/stub_device.h"

namespace {

constexpr double kMPerMm = 1e-3;

}  // namespace

StubDevice& stub_dhd_device() {
  static StubDevice device;
  return device;
}

int dhdGetDeviceCount() {
  return stub_dhd_device().connected.load();
}

int dhdOpenID(char index) {
  if (index >= stub_dhd_device().connected.load()) return -1;
  ++stub_dhd_device().open;
  return index;
}

int dhdClose(char /*id*/) {
  --stub_dhd_device().open;
  return 0;
}

int dhdEnableForce(unsigned char on, char /*id*/) {
  stub_dhd_device().force_on = on != 0;
  return 0;
}

int dhdGetPosition(double* x_m, double* y_m, double* z_m, char /*id*/) {
  const StubDevice& device = stub_dhd_device();
  if (device.fails) return -1;
  *x_m = kMPerMm * device.x_mm;
  *y_m = kMPerMm * device.y_mm;
  *z_m = kMPerMm * device.z_mm;
  return 0;
}

int dhdSetForce(double x_n, double /*y_n*/, double z_n, char /*id*/) {
  StubDevice& device = stub_dhd_device();
  if (device.fails) return -1;
  device.force_x_n = x_n;
  device.force_z_n = z_n;
  return 0;
}

unsigned int dhdGetButtonMask(char /*id*/) {
  return stub_dhd_device().buttons;
}

const char* dhdGetSystemName(char /*id*/) {
  return "omega.3";
}

const char* dhdErrorGetLastStr() {
  return "no device found";
}
