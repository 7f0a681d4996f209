#include "experiments/live/session_device.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include <palpate/device/drivers.h>
#include <palpate/result.h>
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr const char* kRigDriver = "sim";
constexpr double kGuardMsPerS = 1e3;

// A roaming simulated hand's range, within every arm's workspace; time per step; and steps, enough for any
// trial of a device.
constexpr double kRoamMm = 15.0, kRoamStepS = 1.0;
constexpr int kRoamSteps = 3600;

device::HandScript roaming() {
  std::vector<double> t_s;
  std::vector<Vec3> goal_mm;
  // Visits a tetrahedron's corners about the centre, so every axis moves in both directions.
  const Vec3 corners[] = {Vec3{1, 1, 1}, Vec3{-1, -1, 1}, Vec3{-1, 1, -1}, Vec3{1, -1, -1}};
  for (int i = 0; i <= kRoamSteps; ++i) {
    t_s.push_back(kRoamStepS * i);
    goal_mm.push_back(i == 0 ? Vec3(Vec3::Zero()) : Vec3(kRoamMm * corners[i % 4]));
  }
  // Cannot fail: times rise and match the places in number.
  return device::HandScript::create("roam", std::move(t_s), std::move(goal_mm),
                                    device::HandScript::Between::kMinimumJerk)
      .value();
}

/// Only drivers accept a description or options.
Status only_plain(const DeviceArguments& arguments) {
  const auto none = [&](const char* what) {
    return Error{fmt::format("{} is for devices that a driver makes, and {} is not one", what,
                             shown(arguments.device)),
                 "leave it out"};
  };
  if (!arguments.file.empty()) return none("--device-file");
  if (!arguments.options.empty()) return none("--device-option");
  return Done{};
}

}  // namespace

Result<std::vector<std::pair<std::string, std::string>>> option_pairs(const std::vector<std::string>& texts) {
  std::vector<std::pair<std::string, std::string>> pairs;
  for (const std::string& one : texts) {
    const std::size_t equals = one.find('=');
    if (equals == std::string::npos || equals == 0)
      return Error{"--device-option " + shown(one) + " is no KEY=VALUE",
                   "write it as com=14; `palpate list devices` names the drivers, "
                   "docs/how-to/connect-a-device.md their options"};
    pairs.emplace_back(one.substr(0, equals), one.substr(equals + 1));
  }
  return pairs;
}

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
    return Error{fmt::format("no driver has a device {}", shown(arguments.device)),
                 did_you_mean(asked, known,
                              "choose from " + joined(known) + ", as `palpate list devices` lists them")};
  }
  if (driver->name == kRigDriver && !driver->make) {
    PALPATE_ASSIGN(choice.rig, device::simulated_rig_of_driver(arguments.device, arguments.grip));
    // The device accepts neither description nor options; KEY=VALUE is checked first for a better error.
    PALPATE_TRY(option_pairs(arguments.options));
    PALPATE_TRY(only_plain(arguments));
    return choice;
  }
  if (!driver->make)
    return Error{fmt::format("{} is no device that a hand can hold", shown(arguments.device)),
                 "give --device sim, or another that `palpate list devices` lists"};
  std::error_code code;
  if (!arguments.file.empty() && !std::filesystem::is_regular_file(arguments.file, code))
    return Error{"there is no such device description", "give --device-file an existing file",
                 arguments.file};
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
  made.device_ = std::make_unique<device::ReconnectingDevice>(*made.inner_);
  made.unproven_ = std::move(device.unproven);
  made.facts_ = std::move(device.facts);
  made.homing_prompt_ = std::move(device.homing_prompt);
  made.has_motors_ = device.has_motors;
  return made;
}

SessionDevice::~SessionDevice() {
  if (device_) device_->close();
}

void SessionDevice::report_unproven() const {
  for (const std::string& what : unproven_) tell("palpate: not confirmed by hardware: {}\n", what);
}

std::vector<std::pair<std::string, std::string>> SessionDevice::facts() const {
  return facts_ ? facts_() : std::vector<std::pair<std::string, std::string>>{};
}

std::string SessionDevice::homing_prompt() const {
  const std::optional<std::uint8_t> step = device_ ? device_->homing() : std::nullopt;
  if (!step) return {};
  std::string words = homing_prompt_ ? homing_prompt_(*step) : std::string();
  if (words.empty()) words = "Bring it to its home position, or move it slowly to all its ends";
  return words;
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
  device_ = std::make_unique<device::ReconnectingDevice>(*inner_);
}

void SessionDevice::roam() {
  hold(roaming());
}

std::optional<std::string> HomingTeller::news() {
  std::string now = device_.homing_prompt();
  if (now == reported_) return std::nullopt;
  reported_ = std::move(now);
  if (reported_.empty()) return "the device knows its zero" + then_;
  return "the device does not know its zero yet, and shows no force. " + reported_ + ".";
}

}  // namespace palpate::experiments
