// One live session: device, hand, renderers, mixer, governor and servo, put together and run.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "device/live/triggers.h"
#include "device/servo/servo_thread.h"
#include "device/simulated/simulated_plant.h"
#include "experiments/live/changes.h"
#include "experiments/live/live.h"
#include "experiments/live/watch.h"

namespace palpate::experiments {

/// A simulated device with a hand on it; `script` is the hand's and must outlive it.
struct LiveDevice {
  std::string name;  ///< "omni", .., "admittance"
  device::Hand hand;
  double period_s = 1e-3;
  [[nodiscard]] std::unique_ptr<device::SimulatedPlant> make(const device::HandScript& script,
                                                             const Clock& clock) const;
};
/// "sim", "sim:omni", ..; a hand's grip by name. Errors list the names.
[[nodiscard]] Result<LiveDevice> live_device(const std::string& device, const std::string& grip,
                                             double period_s);

/// What a session needs, checked.
struct LivePlan {
  LiveDevice device;
  device::WorkspaceOptions workspace;
  device::SwitchRule rule = device::SwitchRule::kContactElseWait;
  std::vector<LiveSetting> settings;
  std::vector<LiveChange> changes;
};
/// Everything that can be wrong with the arguments but scene and folder.
[[nodiscard]] Result<LivePlan> plan_live(const LiveArguments& arguments,
                                         const std::vector<RendererRequest>& renderers,
                                         const render::Registry& registry);

/// Prepares, runs, and fills the document; head, scene and warnings of the stage are the caller's.
[[nodiscard]] Status run_session(const LiveArguments& arguments, const LivePlan& plan, Workshop& workshop,
                                 Progress& progress, LiveDocument& document);

}  // namespace palpate::experiments
