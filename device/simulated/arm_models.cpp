#include "device/simulated/simulated_arm.h"

#include <algorithm>

#include "toolkit/core/messages.h"

namespace palpate::device {
namespace {

// Assumed damping where no maker gives one: the least that makes the stiffness advised by the device's
// software passive at 1 kHz, b = K T / 2 (Colgate and Schenkel). Assumed friction: the least that does so
// with the encoder, f = K step / 2 (Abbott and Okamura).
constexpr double damping_for(double advised_n_per_mm) {
  constexpr double kAdvisedAtS = 1e-3;
  return 0.5 * advised_n_per_mm * kAdvisedAtS;
}
constexpr double friction_for(double advised_n_per_mm, double encoder_mm) {
  return 0.5 * advised_n_per_mm * encoder_mm;
}
// Assumed for all: current loops of small motors reach about 1 kHz, 1 / (2 pi 1000 Hz).
constexpr double kLagS = 0.16e-3;

ArmOptions arm(const char* name, double mass_kg, double damping, double friction_n, double encoder_mm,
               double force_max_n, double workspace_mm) {
  ArmOptions options;
  options.name = name;
  options.mass_kg = mass_kg;
  options.damping_n_s_per_mm = damping;
  options.friction_n = friction_n;
  options.encoder_mm = encoder_mm;
  options.force_max_n = force_max_n;
  options.lag_s = kLagS;
  options.workspace_mm = workspace_mm;
  return options;
}

Hand hand(const char* name, double mass_kg, double damping, double stiffness) {
  Hand held;
  held.name = name;
  held.mass_kg = mass_kg;
  held.damping_n_s_per_mm = damping;
  held.stiffness_n_per_mm = stiffness;
  return held;
}

Error unknown_name(const char* what, const std::string& name, const std::vector<std::string>& known) {
  return {std::string("there is no simulated ") + what + " '" + name + "'",
          did_you_mean(name, known, "choose from " + joined(known)), "", 0};
}

/// `prefix` is put before each device's name.
Result<SimulatedRig> rig_of(const std::string& device, const std::string& hand, const std::string& prefix) {
  SimulatedRig rig;
  std::vector<std::string> devices, hands;
  for (const ArmOptions& one : arm_models()) {
    devices.push_back(prefix + one.name);
    if (devices.back() == device) rig.arm = one;
  }
  devices.push_back(prefix + admittance_model().name);
  if (std::find(devices.begin(), devices.end(), device) == devices.end())
    return unknown_name("device", device, devices);
  for (const Hand& one : hand_models()) {
    hands.push_back(one.name);
    if (one.name == hand) rig.hand = one;
  }
  if (std::find(hands.begin(), hands.end(), hand) == hands.end()) return unknown_name("hand", hand, hands);
  return rig;
}

std::string described(const ArmOptions& arm) {
  return "simulated arm of " + format_number(1e3 * arm.mass_kg) + " g, " + format_number(arm.force_max_n) +
         " N, encoder step " + format_number(arm.encoder_mm) + " mm, under a simulated hand";
}

}  // namespace

const std::vector<ArmOptions>& arm_models() {
  static const std::vector<ArmOptions> kModels = {
      // Phantom Omni, from the maker's data sheet: mass 45 g, friction up to 0.26 N (0.1 N is the smaller of
      // two published values and the harder case), 450 dpi, 3.3 N. Damping 0.3 N s/m assumed.
      arm("omni", 0.045, 0.0003, 0.1, 0.055, 3.3, 100.0),
      // Touch: the Omni's arm with another board; CHAI3D advises 0.4 N/mm, 0.055 mm, 3.3 N.
      arm("touch", 0.045, damping_for(0.4), 0.1, 0.055, 3.3, 75.0),
      // Novint Falcon: 0.0635 mm, 8 N and 3 N/mm advised by CHAI3D. Mass 0.3 kg assumed.
      arm("falcon", 0.3, damping_for(3.0), friction_for(3.0, 0.0635), 0.0635, 8.0, 40.0),
      // omega.3: below 0.01 mm, 12 N, 5 N/mm advised by CHAI3D. Mass 0.2 kg assumed.
      arm("omega3", 0.2, damping_for(5.0), friction_for(5.0, 0.01), 0.01, 12.0, 75.0)};
  return kModels;
}

const std::vector<Hand>& hand_models() {
  static const std::vector<Hand> kHands = {
      hand("released", 0.0, 0.0, 0.0),
      // A light stylus grip, chosen between the published finger and arm.
      hand("hand", 0.15, 0.0045, 0.4),
      // Finger, extension, about 6 N: Hajian and Howe 1997.
      hand("finger", 0.006, 0.0057, 0.7),
      // Whole arm: Yokokohji and Yoshikawa 1994.
      hand("arm", 2.0, 0.002, 0.01)};
  return kHands;
}

const AdmittanceOptions& admittance_model() {
  static const AdmittanceOptions kModel;
  return kModel;
}

std::string SimulatedRig::device_name() const {
  return arm ? arm->name : admittance_model().name;
}

std::unique_ptr<SimulatedPlant> SimulatedRig::make(const HandScript& script, const Clock& clock,
                                                   double period_s) const {
  if (arm) {
    ArmOptions options = *arm;
    options.period_s = period_s;
    return std::make_unique<SimulatedArm>(options, hand, script, clock);
  }
  AdmittanceOptions options = admittance_model();
  options.period_s = period_s;
  return std::make_unique<SimulatedAdmittance>(options, hand, script, clock);
}

Result<SimulatedRig> simulated_rig(const std::string& device, const std::string& hand) {
  return rig_of(device, hand, "");
}

Result<SimulatedRig> simulated_rig_of_driver(const std::string& device, const std::string& hand) {
  const std::string driver = "sim", prefix = driver + ":";
  return rig_of(device == driver ? prefix + arm_models().front().name : device, hand, prefix);
}

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
                 return std::vector<DeviceEntry>{
                     {"path",
                      "plays a recorded probe path; force goes nowhere",
                      DeviceStatus::kMissing,
                      {"a path: a file, or a generator of `palpate list paths`"}}};
               },
               {}});
}

}  // namespace palpate::device
