#include "device/plugins/plugin_host.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <thread>

#include <palpate/options.h>
#include <palpate/result.h>

namespace palpate::device {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPluginPrefix = "palpate-";
constexpr std::size_t kPluginText = 1024;
using PluginText = std::array<char, kPluginText>;

/// A plug-in listed even if absent.
struct KnownPlugin {
  const char* name;
  const char* what;
  const char* remedy;
};
constexpr std::array kKnownPlugins = {
    KnownPlugin{
        "dhd", "Force Dimension omega, delta, sigma, lambda, and the Novint Falcon",
        "its plug-in: install the Force Dimension SDK from its maker, set DHD_ROOT to its folder, and build "
        "and install Palpate again (docs/how-to/connect-a-device.md)"},
    KnownPlugin{
        "openhaptics", "3D Systems Touch, Touch X, Phantom",
        "its plug-in: install OpenHaptics and the device driver from 3D Systems, set OH_SDK_BASE to its "
        "folder, and build and install Palpate again (docs/how-to/connect-a-device.md)"}};

std::string text_of(const PluginText& text) {
  return {text.begin(), std::find(text.begin(), text.end(), '\0')};
}

bool is_whole(const palpate_plugin* plugin) noexcept {
  return plugin->name != nullptr && plugin->what != nullptr && plugin->look != nullptr &&
         plugin->open != nullptr && plugin->close != nullptr && plugin->limits != nullptr &&
         plugin->read != nullptr && plugin->send != nullptr && plugin->zero != nullptr &&
         plugin->facts != nullptr;
}

/// List entries of one plug-in: loads and asks it.
std::vector<DeviceEntry> look_for_plugin(const std::string& name, const std::string& what,
                                         const std::string& remedy) {
  DeviceEntry entry{name, what, DeviceStatus::kMissing, {}};
  const fs::path file = plugin_file(name);
  if (file.empty()) {
    entry.needs = {remedy};
    return {entry};
  }
  const Result<LoadedPlugin> library = load_device_plugin(file);
  if (!library) {
    entry.needs = {library.error().message()};
    return {entry};
  }
  PluginText text{};
  const int count = (*library)->look(text.data(), kPluginText);
  if (count <= 0) {
    entry.needs = {count < 0 ? text_of(text) : "to be connected and switched on"};
    return {entry};
  }
  entry.status = DeviceStatus::kReady;
  entry.what += ": " + text_of(text);
  return {entry};
}

/// Parses the index after the colon of "dhd:1".
Result<std::uint32_t> index_of(const std::string& device_name) {
  const std::size_t colon = device_name.find(':');
  if (colon == std::string::npos) return 0U;
  constexpr NumberRange kIndices{0, 15};
  const Result<long long> index = read_integer(device_name.substr(colon + 1), kIndices);
  if (!index) return Error{"'" + device_name + "': the device's index " + index.error().what};
  return static_cast<std::uint32_t>(*index);
}

/// For a guard process: loads, opens, releases.
bool release_plugin(const fs::path& file, std::uint32_t index) {
  const Result<LoadedPlugin> library = load_device_plugin(file);
  if (!library) return false;
  const palpate_plugin& plugin = **library;
  PluginText text{};
  void* const device = plugin.open(index, text.data(), kPluginText);
  if (device == nullptr) return false;
  const bool released = plugin.zero(device) == 0;
  plugin.close(device);
  return released;
}

Result<MadeDevice> make_plugin_device(const DeviceRequest& request, const Clock& clock,
                                      const std::string& name, const std::string& remedy) {
  if (!request.description.empty() || !request.options.empty())
    return Error{"'" + request.name + "' has neither description file nor options", "leave them out"};
  PALPATE_ASSIGN(const std::uint32_t index, index_of(request.name));
  const fs::path file = plugin_file(name);
  if (file.empty()) return Error{"there is no plug-in for '" + name + "'", "it needs " + remedy};
  PALPATE_ASSIGN(LoadedPlugin library, load_device_plugin(file));
  MadeDevice made;
  auto device = std::make_unique<PluginDevice>(std::move(library), index, request.name, clock);
  made.facts = [device = device.get()] { return device->facts(); };
  made.device = std::move(device);
  made.zero = [file, index] { return release_plugin(file, index); };
  made.unproven = {"the plug-in was run with a pretended library alone, never with its maker's and a device"};
  return made;
}

void add_plugin(Drivers& drivers, const std::string& name, const std::string& what,
                const std::string& remedy) {
  drivers.add({name, "plug-in", [name, what, remedy] { return look_for_plugin(name, what, remedy); },
               [name, remedy](const DeviceRequest& request, const Clock& clock) {
                 return make_plugin_device(request, clock, name, remedy);
               }});
}

}  // namespace

Result<LoadedPlugin> load_device_plugin(const fs::path& file) {
  PALPATE_ASSIGN(LoadedPlugin plugin,
                 load_plugin<palpate_plugin>(file, PALPATE_PLUGIN_ENTRY, PALPATE_PLUGIN_ABI));
  if (!is_whole(plugin.get())) return not_of_this_version(file);
  return plugin;
}

fs::path plugin_file(const std::string& name) {
  for (const PluginFile& known : plugin_files(kPluginPrefix))
    if (known.name == name) return known.file;
  return {};
}

PluginDevice::~PluginDevice() {
  close();
  give_back();
}

void PluginDevice::give_back() noexcept {
  void* const device = device_.exchange(nullptr);
  // Later cut_force calls find no device; earlier ones are waited for.
  while (cutting_.load() > 0) std::this_thread::yield();
  if (device != nullptr) library_->close(device);
}

Status PluginDevice::open() {
  close();
  give_back();
  PluginText text{};
  void* const device = library_->open(index_, text.data(), kPluginText);
  if (device == nullptr) return Error{text_of(text), "look at cable, power and the maker's software", name_};
  device_.store(device);
  state_ = {};
  state_.homed = false;  // until reported
  open_ = true;
  Status good = take_limits();
  if (!good) close();
  return good;
}

Status PluginDevice::take_limits() {
  palpate_plugin_limits told{};
  if (library_->limits(device_.load(), &told) != 0)
    return Error{"the plug-in tells no limits", "look at the maker's software", name_};
  limits_ = {told.force_max_n,
             {Vec3{told.low_mm[0], told.low_mm[1], told.low_mm[2]},
              Vec3{told.high_mm[0], told.high_mm[1], told.high_mm[2]}},
             told.resolution_mm,
             told.rate_hz,
             told.stiffness_max_n_per_mm,
             told.damping_max_n_s_per_mm,
             WorkspaceShape::kBox};
  if (!(std::isfinite(told.force_max_n) && told.force_max_n > 0.0) ||
      told.shape > static_cast<std::uint32_t>(WorkspaceShape::kCylinder))
    return Error{"the plug-in's limits are none", "look at the maker's software", name_};
  limits_.workspace_shape = static_cast<WorkspaceShape>(told.shape);
  return Done{};
}

void PluginDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  static_cast<void>(library_->zero(device_.load()));
}

DeviceState PluginDevice::read() noexcept {
  state_.status = ReadStatus::kLost;
  if (!open_) return state_;
  palpate_plugin_state told{};
  if (library_->read(device_.load(std::memory_order_relaxed), &told) != 0) return state_;
  constexpr std::uint32_t kMaxStatus = 3;
  state_.status = told.status <= kMaxStatus ? static_cast<ReadStatus>(told.status) : ReadStatus::kGarbled;
  if (state_.status != ReadStatus::kFresh) return state_;
  state_.position_mm = Vec3{told.position_mm[0], told.position_mm[1], told.position_mm[2]};
  state_.buttons = told.buttons;
  state_.homed = told.homed == 1;
  state_.packet_ns = clock_.now_ns() - std::max<std::int64_t>(0, told.age_ns);
  return state_;
}

void PluginDevice::send(GovernedForce force) noexcept {
  if (!open_) return;
  const Vec3& n = force.newtons();
  const double force_n[3] = {n.x(), n.y(), n.z()};
  static_cast<void>(library_->send(device_.load(std::memory_order_relaxed), force_n));
}

bool PluginDevice::cut_force() noexcept {
  cutting_.fetch_add(1);
  void* const device = device_.load();
  const bool cut = device != nullptr && library_->zero(device) == 0;
  cutting_.fetch_sub(1);
  return cut;
}

DeviceFacts PluginDevice::facts() const {
  DeviceFacts facts;
  PluginText text{};
  void* const device = device_.load();
  if (device == nullptr || library_->facts(device, text.data(), kPluginText) != 0) return facts;
  const std::string lines = text_of(text);
  for (std::size_t at = 0; at < lines.size();) {
    const std::size_t end = std::min(lines.find('\n', at), lines.size());
    const std::string line = lines.substr(at, end - at);
    if (const std::size_t equals = line.find('='); equals != std::string::npos)
      facts.emplace_back(line.substr(0, equals), line.substr(equals + 1));
    at = end + 1;
  }
  return facts;
}

void register_plugin_drivers(Drivers& drivers) {
  for (const KnownPlugin& known : kKnownPlugins) add_plugin(drivers, known.name, known.what, known.remedy);
  // Other plug-ins, by file; a taken name is not replaced.
  for (const PluginFile& known : plugin_files(kPluginPrefix))
    if (drivers.of(known.name) == nullptr)
      add_plugin(drivers, known.name, "a plug-in that was installed here", "the file of its plug-in");
}

}  // namespace palpate::device
