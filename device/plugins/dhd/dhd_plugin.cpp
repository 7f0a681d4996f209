// Plug-in for Force Dimension's DHD library: omega, delta, sigma, lambda, and the Novint Falcon, without a
// firmware file. The library's calls wait for USB, so they have a thread.
#include <dhdc.h>

#include <array>
#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "device/plugins/plugin_exchange.h"

namespace {

using palpate::Vec3;
using palpate::device::copy_plugin_text;
using palpate::device::PluginExchange;

constexpr double kMmPerM = 1000.0;
// The library's calls take as long as USB; this is the pause if they do not wait.
constexpr std::chrono::microseconds kDhdRest{200};
constexpr int kMostWrong = 3;

/// Cautious values from the makers' pages: half of the advertised workspace.
struct DhdModel {
  const char* begins;
  double force_max_n, half_mm, resolution_mm, stiffness_n_per_mm;
};
constexpr std::array kDhdModels = {
    DhdModel{"omega", 12.0, 40.0, 0.01, 14.5}, DhdModel{"delta", 20.0, 80.0, 0.03, 14.5},
    DhdModel{"sigma", 20.0, 45.0, 0.01, 14.5}, DhdModel{"lambda", 20.0, 60.0, 0.01, 14.5},
    DhdModel{"", 8.0, 40.0, 0.06, 3.0}};  // the Falcon, and unknown devices

const DhdModel& model_of(const std::string& name) {
  for (const DhdModel& model : kDhdModels)
    if (name.rfind(model.begins, 0) == 0) return model;
  return kDhdModels.back();
}

class DhdDevice {
 public:
  DhdDevice(int id, std::string name) : id_(id), name_(std::move(name)) {
    thread_ = std::thread([this] { run(); });
  }
  DhdDevice(const DhdDevice&) = delete;
  DhdDevice& operator=(const DhdDevice&) = delete;
  ~DhdDevice() {
    ending_.store(true);
    thread_.join();
    const auto id = static_cast<char>(id_);
    static_cast<void>(dhdSetForce(0.0, 0.0, 0.0, id));
    static_cast<void>(dhdEnableForce(0, id));
    static_cast<void>(dhdClose(id));
  }
  [[nodiscard]] const std::string& name() const noexcept { return name_; }

  PluginExchange exchange;

 private:
  void run() {
    const auto id = static_cast<char>(id_);
    int wrong = 0;
    while (!ending_.load()) {
      palpate_plugin_state state{{0.0, 0.0, 0.0}, 0, 0, 1, 0, 0};
      double m[3] = {0.0, 0.0, 0.0};
      const bool read = dhdGetPosition(&m[0], &m[1], &m[2], id) >= 0;
      for (int axis = 0; axis < 3; ++axis) state.position_mm[axis] = kMmPerM * m[axis];
      state.buttons = static_cast<std::uint32_t>(dhdGetButtonMask(id));
      const Vec3 force_n = exchange.force();
      const bool sent = dhdSetForce(force_n.x(), force_n.y(), force_n.z(), id) >= 0;
      wrong = read && sent ? 0 : wrong + 1;
      constexpr std::uint32_t kGone = 3;
      if (wrong >= kMostWrong) state.status = kGone;
      if (read || wrong >= kMostWrong) exchange.state(state);
      std::this_thread::sleep_for(kDhdRest);
    }
  }

  int id_;
  std::string name_;
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

using DhdCalls = palpate::device::PluginCalls<DhdDevice>;

int32_t dhd_look(char* text, uint32_t size) {
  const int count = dhdGetDeviceCount();
  copy_plugin_text(count < 0 ? dhdErrorGetLastStr() : std::to_string(count) + " connected", text, size);
  return count;
}

void* dhd_open(uint32_t index, char* text, uint32_t size) {
  const int id = dhdOpenID(static_cast<char>(index));
  if (id < 0) {
    copy_plugin_text(dhdErrorGetLastStr(), text, size);
    return nullptr;
  }
  const char* const name = dhdGetSystemName(static_cast<char>(id));
  if (dhdSetForce(0.0, 0.0, 0.0, static_cast<char>(id)) < 0 || dhdEnableForce(1, static_cast<char>(id)) < 0) {
    copy_plugin_text(dhdErrorGetLastStr(), text, size);
    static_cast<void>(dhdClose(static_cast<char>(id)));
    return nullptr;
  }
  return new DhdDevice(id, name != nullptr ? name : "");
}

void dhd_close(void* device) {
  delete static_cast<DhdDevice*>(device);
}

int32_t dhd_limits(void* device, palpate_plugin_limits* limits) {
  constexpr double kRateHz = 1000.0;
  const DhdModel& model = model_of(DhdCalls::device_of(device).name());
  *limits = {};
  limits->force_max_n = model.force_max_n;
  for (int axis = 0; axis < 3; ++axis) {
    limits->low_mm[axis] = -model.half_mm;
    limits->high_mm[axis] = model.half_mm;
  }
  limits->resolution_mm = model.resolution_mm;
  limits->rate_hz = kRateHz;
  limits->stiffness_max_n_per_mm = model.stiffness_n_per_mm;
  limits->shape = 1;
  return 0;
}

int32_t dhd_facts(void* device, char* text, uint32_t size) {
  copy_plugin_text("model=" + DhdCalls::device_of(device).name() + "\n", text, size);
  return 0;
}

constexpr palpate_plugin kDhdPlugin = {PALPATE_PLUGIN_ABI,
                                       sizeof(palpate_plugin),
                                       "dhd",
                                       "Force Dimension omega, delta, sigma, lambda, and the Novint Falcon",
                                       dhd_look,
                                       dhd_open,
                                       dhd_close,
                                       dhd_limits,
                                       DhdCalls::read,
                                       DhdCalls::send,
                                       DhdCalls::zero,
                                       dhd_facts};

}  // namespace

extern "C" __attribute__((visibility("default"))) const palpate_plugin* palpate_plugin_entry() {
  return &kDhdPlugin;
}
