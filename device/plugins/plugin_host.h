// Loads plug-ins and makes devices of them.
#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include <palpate/device/drivers.h>
#include "device/interface/driver_options.h"
#include "device/plugins/plugin.h"
#include "toolkit/core/plugin_module.h"

namespace palpate::device {

/// Kept loaded while one of its devices lives.
using LoadedPlugin = std::shared_ptr<const palpate_plugin>;
[[nodiscard]] Result<LoadedPlugin> load_device_plugin(const std::filesystem::path& file);

/// The file palpate-NAME.so in the first plug-in folder that has it; empty: none.
[[nodiscard]] std::filesystem::path plugin_file(const std::string& name);

/// A device of a plug-in. Invalid limits fail to open; an invalid status reads as garbled.
class PluginDevice final : public Device {
 public:
  PluginDevice(LoadedPlugin library, std::uint32_t index, std::string name, const Clock& clock)
      : library_(std::move(library)), index_(index), name_(std::move(name)), clock_(clock) {}
  ~PluginDevice() override;

  [[nodiscard]] std::string name() const override { return name_; }
  [[nodiscard]] Status open() override;
  /// Commands zero. The plug-in's device stays open until the next open() or the destructor; until then any
  /// thread may cut, and the release waits for it.
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return limits_; }
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;
  [[nodiscard]] DeviceFacts facts() const;

 private:
  [[nodiscard]] Status take_limits();
  void give_back() noexcept;

  LoadedPlugin library_;
  std::uint32_t index_;
  std::string name_;
  const Clock& clock_;
  std::atomic<void*> device_{nullptr};
  std::atomic<int> cutting_{0};  // threads within cut_force
  bool open_ = false;
  DeviceLimits limits_;
  DeviceState state_;
};

/// Registers "dhd" and "openhaptics", present or not, and all other plug-ins.
void register_plugin_drivers(Drivers& drivers);

}  // namespace palpate::device
