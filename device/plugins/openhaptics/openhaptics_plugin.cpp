// Plug-in for 3D Systems' OpenHaptics HD library: Touch, Touch X, Phantom. The library's own servo thread
// calls it.
#include <HD/hd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>

#include "device/plugins/plugin_exchange.h"

namespace {

using palpate::Vec3;
using palpate::device::copy_plugin_text;
using palpate::device::PluginExchange;

/// Whether the library noted an error since the last call; gives its text.
bool failed_now(std::string& why) {
  const HDErrorInfo info = hdGetError();
  if (info.errorCode == HD_SUCCESS) return false;
  why = hdGetErrorString(info.errorCode);
  return true;
}

struct TouchDevice {
  HHD handle = HD_INVALID_HANDLE;
  HDSchedulerHandle task = 0;
  bool scheduled = false;
  std::string model, serial;
  palpate_plugin_limits limits{};
  PluginExchange exchange;
  std::atomic<bool> ending{false};
};

/// Called in the library's thread, every millisecond.
HDCallbackCode HDCALLBACK touch_frame(void* data) {
  TouchDevice& touch = *static_cast<TouchDevice*>(data);
  palpate_plugin_state state{{0.0, 0.0, 0.0}, 0, 0, 1, 0, 0};
  hdBeginFrame(touch.handle);
  HDint buttons = 0;
  hdGetDoublev(HD_CURRENT_POSITION, state.position_mm);
  hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
  const Vec3 force_n = touch.ending.load() ? Vec3(Vec3::Zero()) : touch.exchange.force();
  const HDdouble shown[3] = {force_n.x(), force_n.y(), force_n.z()};
  hdSetDoublev(HD_CURRENT_FORCE, shown);
  hdEndFrame(touch.handle);
  state.buttons = static_cast<std::uint32_t>(buttons);
  state.homed = hdCheckCalibration() == HD_CALIBRATION_OK ? 1 : 0;
  constexpr std::uint32_t kGone = 3;
  if (hdGetError().errorCode != HD_SUCCESS) state.status = kGone;
  touch.exchange.state(state);
  return HD_CALLBACK_CONTINUE;
}

void read_limits(TouchDevice& touch) {
  HDdouble force_n = 0.0, stiffness = 0.0, damping = 0.0;
  HDdouble box_mm[6] = {};
  hdGetDoublev(HD_NOMINAL_MAX_CONTINUOUS_FORCE, &force_n);
  hdGetDoublev(HD_NOMINAL_MAX_STIFFNESS, &stiffness);
  hdGetDoublev(HD_NOMINAL_MAX_DAMPING, &damping);
  hdGetDoublev(HD_USABLE_WORKSPACE_DIMENSIONS, box_mm);
  constexpr double kRateHz = 1000.0, kStepMm = 0.055;  // 450 dpi, the coarsest of the family
  touch.limits.force_max_n = force_n;
  for (int axis = 0; axis < 3; ++axis) {
    touch.limits.low_mm[axis] = box_mm[axis];
    touch.limits.high_mm[axis] = box_mm[axis + 3];
  }
  touch.limits.resolution_mm = kStepMm;
  touch.limits.rate_hz = kRateHz;
  touch.limits.stiffness_max_n_per_mm = stiffness;
  touch.limits.damping_max_n_s_per_mm = damping;
}

void touch_close(void* device) {
  const std::unique_ptr<TouchDevice> touch(static_cast<TouchDevice*>(device));
  constexpr std::chrono::milliseconds kZeroLeaves{10};  // ten frames with zero
  touch->ending.store(true);
  if (touch->scheduled) {
    std::this_thread::sleep_for(kZeroLeaves);
    hdStopScheduler();
    hdUnschedule(touch->task);
  }
  if (touch->handle != HD_INVALID_HANDLE) hdDisableDevice(touch->handle);
}

int32_t touch_look(char* text, uint32_t size) {
  // The library cannot list devices; it reads its configuration from this folder.
  if (std::getenv("GTDD_HOME") == nullptr) {
    copy_plugin_text("GTDD_HOME is not set: name the folder of the device's configuration", text, size);
    return -1;
  }
  copy_plugin_text("the default device of its configuration", text, size);
  return 1;
}

void* touch_open(uint32_t /*index*/, char* text, uint32_t size) {
  auto touch = std::make_unique<TouchDevice>();
  std::string why;
  touch->handle = hdInitDevice(HD_DEFAULT_DEVICE);
  if (failed_now(why)) {
    copy_plugin_text(why, text, size);
    return nullptr;
  }
  hdMakeCurrentDevice(touch->handle);
  read_limits(*touch);
  const HDstring model = hdGetString(HD_DEVICE_MODEL_TYPE), serial = hdGetString(HD_DEVICE_SERIAL_NUMBER);
  touch->model = model != nullptr ? model : "";
  touch->serial = serial != nullptr ? serial : "";
  hdEnable(HD_FORCE_OUTPUT);
  touch->task = hdScheduleAsynchronous(touch_frame, touch.get(), HD_MAX_SCHEDULER_PRIORITY);
  touch->scheduled = true;
  hdStartScheduler();
  if (failed_now(why)) {
    copy_plugin_text(why, text, size);
    touch_close(touch.release());
    return nullptr;
  }
  return touch.release();
}

using TouchCalls = palpate::device::PluginCalls<TouchDevice>;

int32_t touch_limits(void* device, palpate_plugin_limits* limits) {
  *limits = TouchCalls::device_of(device).limits;
  return 0;
}

int32_t touch_facts(void* device, char* text, uint32_t size) {
  const TouchDevice& touch = TouchCalls::device_of(device);
  copy_plugin_text("model=" + touch.model + "\nserial=" + touch.serial + "\n", text, size);
  return 0;
}

constexpr palpate_plugin kTouchPlugin = {PALPATE_PLUGIN_ABI, sizeof(palpate_plugin),
                                         "openhaptics",      "3D Systems Touch, Touch X, Phantom",
                                         touch_look,         touch_open,
                                         touch_close,        touch_limits,
                                         TouchCalls::read,   TouchCalls::send,
                                         TouchCalls::zero,   touch_facts};

}  // namespace

extern "C" __attribute__((visibility("default"))) const palpate_plugin* palpate_plugin_entry() {
  return &kTouchPlugin;
}
