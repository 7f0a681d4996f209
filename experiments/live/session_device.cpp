#include "experiments/live/session_device.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include "device/drivers/all_drivers.h"
#include "experiments/live/any_device.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::experiments {
namespace {

constexpr const char* kRigDriver = "sim";
constexpr double kGuardMsPerS = 1e3;

/// Nothing but a driver reads a description or options.
Status only_plain(const DeviceArguments& arguments) {
  const auto none = [&](const char* what) {
    return Error{fmt::format("{} is for devices that a driver makes, and {} is not one", what,
                             shown(arguments.device)),
                 "leave it out",
                 {},
                 0};
  };
  if (!arguments.file.empty()) return none("--device-file");
  if (!arguments.options.empty()) return none("--device-option");
  return Done{};
}

}  // namespace

const device::Drivers& session_drivers() {
  static const device::Drivers kDrivers = [] {
    device::Drivers drivers;
    device::register_all_drivers(drivers);
    return drivers;
  }();
  return kDrivers;
}

std::string DeviceChoice::name() const {
  return rig ? std::string(kRigDriver) + ":" + rig->device_name() : request.name;
}

Result<DeviceChoice> choose_device(const DeviceArguments& arguments, const device::Drivers& drivers) {
  DeviceChoice choice;
  const device::Driver* driver = drivers.of(arguments.device);
  if (driver == nullptr) {
    std::vector<std::string> known;
    for (const device::Driver& one : drivers.all())
      if (one.make || one.name == kRigDriver) known.push_back(one.name);
    const std::string asked = arguments.device.substr(0, arguments.device.find(':'));
    return Error{
        fmt::format("no driver has a device {}", shown(arguments.device)),
        did_you_mean(asked, known, "choose from " + joined(known)) + "; `palpate devices` lists them",
        {},
        0};
  }
  if (driver->name == kRigDriver && !driver->make) {
    PALPATE_ASSIGN(choice.rig, device::simulated_rig_of_driver(arguments.device, arguments.grip));
    PALPATE_TRY(only_plain(arguments));
    return choice;
  }
  if (!driver->make)
    return Error{fmt::format("{} is no device that a hand can hold", shown(arguments.device)),
                 "give --device sim, with --path for where its hand goes",
                 {},
                 0};
  std::error_code code;
  if (!arguments.file.empty() && !std::filesystem::is_regular_file(arguments.file, code))
    return Error{"there is no such device description", "give --device-file an existing file", arguments.file,
                 0};
  choice.driver = driver;
  choice.request.name = arguments.device;
  choice.request.description = arguments.file;
  PALPATE_ASSIGN(choice.request.options, option_pairs(arguments.options));
  choice.guard_kill_after_s = arguments.guard_kill_after_ms / kGuardMsPerS;
  return choice;
}

Result<SessionDevice> SessionDevice::make(const DeviceChoice& choice, const Clock& clock, double period_s) {
  SessionDevice made;
  made.choice_ = choice;
  made.clock_ = &clock;
  made.period_s_ = period_s;
  made.heart_ = std::make_unique<device::Heartbeat>();
  if (choice.rig) return made;
  PALPATE_ASSIGN(device::MadeDevice device, choice.driver->make(choice.request, clock));
  if (device.zero) {
    PALPATE_ASSIGN(device::Guard guard, device::Guard::start(device.zero, {choice.guard_kill_after_s}));
    made.guard_ = std::make_unique<device::Guard>(std::move(guard));
  }
  made.inner_ = std::move(device.device);
  made.device_ = std::make_unique<device::ReplugDevice>(*made.inner_);
  made.unproven_ = std::move(device.unproven);
  made.facts_ = std::move(device.facts);
  return made;
}

SessionDevice::~SessionDevice() {
  if (device_) device_->close();
}

void SessionDevice::say_unproven() const {
  for (const std::string& what : unproven_)
    fmt::print(stderr, "palpate: not confirmed by hardware: {}\n", what);
}

std::vector<std::string> SessionDevice::facts() const {
  std::vector<std::string> sentences;
  if (!facts_) return sentences;
  for (const auto& [key, value] : facts_()) sentences.push_back(key + ": " + value);
  return sentences;
}

Result<device::DeviceLimits> SessionDevice::limits() {
  if (!choice_.rig) {
    PALPATE_TRY(device_->open());
    return device_->limits();
  }
  PALPATE_ASSIGN(
      const device::HandScript nobody,
      device::HandScript::create("nobody", {0.0}, {Vec3::Zero()}, device::HandScript::Between::kStraight));
  return choice_.rig->make(nobody, *clock_, period_s_)->limits();
}

void SessionDevice::hold(device::HandScript script) {
  if (!choice_.rig) return;
  script_ = std::make_unique<device::HandScript>(std::move(script));
  inner_ = choice_.rig->make(*script_, *clock_, period_s_);
  device_ = std::make_unique<device::ReplugDevice>(*inner_);
}

}  // namespace palpate::experiments
