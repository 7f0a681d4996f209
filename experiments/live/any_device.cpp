#include "experiments/live/any_device.h"

#include <optional>

#include "device/simulated/arm_models.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::experiments {
namespace {

// Where a simulated hand roams: well inside every arm's workspace, a second from place to place, and for as
// long as anybody tries a device.
constexpr double kRoamMm = 15.0, kRoamStepS = 1.0;
constexpr int kRoamSteps = 3600;

Result<device::HandScript> roaming() {
  std::vector<double> t_s;
  std::vector<Vec3> goal_mm;
  // About the middle, through the corners of a tetrahedron: every axis is seen in both directions.
  const Vec3 corners[] = {Vec3{1, 1, 1}, Vec3{-1, -1, 1}, Vec3{-1, 1, -1}, Vec3{1, -1, -1}};
  for (int i = 0; i <= kRoamSteps; ++i) {
    t_s.push_back(kRoamStepS * i);
    goal_mm.push_back(i == 0 ? Vec3(Vec3::Zero()) : Vec3(kRoamMm * corners[i % 4]));
  }
  return device::HandScript::create("roam", std::move(t_s), std::move(goal_mm),
                                    device::HandScript::Between::kMinimumJerk);
}

/// A simulated device with all that it refers to.
class RoamingDevice final : public device::Device {
 public:
  RoamingDevice(device::HandScript script, const device::SimulatedRig& rig, const Clock& clock,
                double period_s)
      : script_(std::move(script)), plant_(rig.make(script_, clock, period_s)) {}

  [[nodiscard]] std::string name() const override { return plant_->name(); }
  [[nodiscard]] Status open() override { return plant_->open(); }
  void close() noexcept override { plant_->close(); }
  [[nodiscard]] device::DeviceLimits limits() const noexcept override { return plant_->limits(); }
  [[nodiscard]] device::DeviceState read() noexcept override { return plant_->read(); }
  void send(device::GovernedForce force) noexcept override { plant_->send(std::move(force)); }
  bool cut_force() noexcept override { return plant_->cut_force(); }

 private:
  device::HandScript script_;
  std::unique_ptr<device::SimulatedPlant> plant_;
};

Error no_driver(const std::string& name, const device::Drivers& drivers) {
  std::vector<std::string> known;
  for (const device::Driver& driver : drivers.all()) known.push_back(driver.name);
  return {"there is no device '" + name + "'",
          did_you_mean(name, known, "`palpate devices` lists them: " + joined(known)), "", 0};
}

}  // namespace

Result<std::vector<std::pair<std::string, std::string>>> option_pairs(const std::vector<std::string>& texts) {
  std::vector<std::pair<std::string, std::string>> pairs;
  for (const std::string& one : texts) {
    const std::size_t equals = one.find('=');
    if (equals == std::string::npos || equals == 0)
      return Error{"--device-option " + shown(one) + " is no KEY=VALUE",
                   "write it as com=14; `palpate devices` names the drivers, docs/devices.md their options",
                   "", 0};
    pairs.emplace_back(one.substr(0, equals), one.substr(equals + 1));
  }
  return pairs;
}

Result<device::MadeDevice> any_device(const OneDevice& arguments, const device::Drivers& drivers,
                                      const Clock& clock, double rate_hz) {
  const device::Driver* driver = drivers.of(arguments.name);
  if (driver == nullptr) return no_driver(arguments.name, drivers);
  PALPATE_ASSIGN(auto options, option_pairs(arguments.options));
  if (driver->make) return driver->make({arguments.name, arguments.file, std::move(options)}, clock);
  if (driver->name != "sim")
    return Error{"'" + arguments.name + "' is no device that can be used here",
                 "`palpate devices` lists those that can", "", 0};
  if (!arguments.file.empty() || !options.empty())
    return Error{"a simulated device has neither description file nor options", "leave them out", "", 0};
  PALPATE_ASSIGN(const device::SimulatedRig rig,
                 device::simulated_rig_of_driver(arguments.name, arguments.hand));
  PALPATE_ASSIGN(device::HandScript script, roaming());
  device::MadeDevice made;
  made.device = std::make_unique<RoamingDevice>(std::move(script), rig, clock, 1.0 / rate_hz);
  return made;
}

}  // namespace palpate::experiments
