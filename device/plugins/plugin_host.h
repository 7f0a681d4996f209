// Loads plug-ins and makes devices of them.
#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <palpate/device/drivers.h>
#include "device/interface/driver_options.h"
#include "device/plugins/plugin.h"

namespace palpate::device {

/// A loaded module, kept loaded while one of its devices lives.
class PluginLibrary {
 public:
  /// An Error says what the system's loader misses, or that the version differs.
  [[nodiscard]] static Result<std::shared_ptr<PluginLibrary>> load(const std::filesystem::path& file);
  PluginLibrary(const PluginLibrary&) = delete;
  PluginLibrary& operator=(const PluginLibrary&) = delete;
  ~PluginLibrary();

  [[nodiscard]] const palpate_plugin& plugin() const noexcept { return *plugin_; }

 private:
  PluginLibrary(void* handle, const palpate_plugin* plugin) noexcept : handle_(handle), plugin_(plugin) {}
  void* handle_;
  const palpate_plugin* plugin_;
};

/// Plug-in folders in search order: those of $PALPATE_PLUGINS (separated by colons), then lib/palpate/plugins
/// beside the program's bin.
[[nodiscard]] std::vector<std::filesystem::path> plugin_folders();
/// The file palpate-NAME.so in the first folder that has it; empty: none.
[[nodiscard]] std::filesystem::path plugin_file(const std::string& name);

/// A device of a plug-in. Invalid limits fail to open; an invalid status reads as garbled.
class PluginDevice final : public Device {
 public:
  PluginDevice(std::shared_ptr<PluginLibrary> library, std::uint32_t index, std::string name,
               const Clock& clock)
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

  std::shared_ptr<PluginLibrary> library_;
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
