#include "device/simulated/simulated_drivers.h"

#include "device/simulated/arm_models.h"
#include "toolkit/core/numbers.h"

namespace palpate::device {
namespace {

std::string described(const ArmOptions& arm) {
  return "simulated arm of " + short_number(1e3 * arm.mass_kg) + " g, " + short_number(arm.force_max_n) +
         " N, encoder step " + short_number(arm.encoder_mm) + " mm, under a simulated hand";
}

}  // namespace

void register_simulated_drivers(Drivers& drivers) {
  drivers.add({"sim",
               "simulation",
               [] {
                 std::vector<DeviceEntry> found;
                 for (const ArmOptions& arm : arm_models())
                   found.push_back({"sim:" + arm.name, described(arm), DeviceStatus::kReady, {}});
                 found.push_back(
                     {"sim:" + admittance_model().name,
                      "simulated admittance device: the force is measured, the position commanded",
                      DeviceStatus::kReady,
                      {}});
                 return found;
               },
               {}});
  drivers.add({"path",
               "simulation",
               [] {
                 return std::vector<DeviceEntry>{{"path",
                                                  "plays a recorded probe path; force goes nowhere",
                                                  DeviceStatus::kMissing,
                                                  {"a path: a file, or a generator of `palpate paths`"}}};
               },
               {}});
}

}  // namespace palpate::device
