#include <algorithm>
#include <chrono>
#include <thread>

#include "tests/device/stubs/HD/hd.h"
#include "tests/device/stubs/stub_device.h"

namespace {

constexpr HDerror kStubError = 0x0301;
struct Scheduler {
  HDSchedulerCallback callback = nullptr;
  void* data = nullptr;
  std::atomic<bool> running{false};
  std::thread thread;
} scheduler;

}  // namespace

StubDevice& stub_hd_device() {
  static StubDevice device;
  return device;
}

HHD hdInitDevice(HDstring /*name*/) {
  if (stub_hd_device().connected == 0) return HD_INVALID_HANDLE;
  ++stub_hd_device().open;
  return 1;
}
void hdDisableDevice(HHD /*device*/) {
  --stub_hd_device().open;
}
void hdMakeCurrentDevice(HHD /*device*/) {}
void hdEnable(HDenum what) {
  if (what == HD_FORCE_OUTPUT) stub_hd_device().force_on = true;
}
void hdBeginFrame(HHD /*device*/) {}
void hdEndFrame(HHD /*device*/) {}
void hdGetDoublev(HDenum what, HDdouble* into) {
  const StubDevice& device = stub_hd_device();
  if (what == HD_CURRENT_POSITION) {
    into[0] = device.x_mm;
    into[1] = device.y_mm;
    into[2] = device.z_mm;
  }
  if (what == HD_NOMINAL_MAX_CONTINUOUS_FORCE) *into = 0.88;
  if (what == HD_NOMINAL_MAX_STIFFNESS) *into = 1.0;
  if (what == HD_NOMINAL_MAX_DAMPING) *into = 0.003;
  if (what == HD_USABLE_WORKSPACE_DIMENSIONS) {
    const double box[6] = {-80.0, -60.0, -35.0, 80.0, 60.0, 35.0};
    std::copy(box, box + 6, into);
  }
}
void hdGetIntegerv(HDenum /*what*/, HDint* into) {
  *into = static_cast<HDint>(stub_hd_device().buttons.load());
}
void hdSetDoublev(HDenum what, const HDdouble* from) {
  if (what != HD_CURRENT_FORCE) return;
  stub_hd_device().force_x_n = from[0];
  stub_hd_device().force_z_n = from[2];
}
HDstring hdGetString(HDenum what) {
  return what == HD_DEVICE_MODEL_TYPE ? "Touch" : "12345";
}
HDenum hdCheckCalibration() {
  return stub_hd_device().calibrated ? HD_CALIBRATION_OK : HD_CALIBRATION_NEEDS_UPDATE;
}
HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback callback, void* data, HDushort /*priority*/) {
  scheduler.callback = callback;
  scheduler.data = data;
  return 1;
}
void hdUnschedule(HDSchedulerHandle /*task*/) {
  scheduler.callback = nullptr;
}
void hdStartScheduler() {
  scheduler.running = true;
  scheduler.thread = std::thread([] {
    while (scheduler.running) {
      scheduler.callback(scheduler.data);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
}
void hdStopScheduler() {
  scheduler.running = false;
  if (scheduler.thread.joinable()) scheduler.thread.join();
}
HDErrorInfo hdGetError() {
  const StubDevice& device = stub_hd_device();
  return {device.connected == 0 || device.fails ? kStubError : HD_SUCCESS, 0, 1};
}
HDstring hdGetErrorString(HDerror /*code*/) {
  return "no device is configured";
}
