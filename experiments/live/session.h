// One live session: device, hand, renderers, mixer, governor and servo, put together and run.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "device/live/triggers.h"
#include "device/record/recording_header.h"
#include "device/servo/servo_thread.h"
#include "device/simulated/arm_models.h"
#include "experiments/live/changes.h"
#include "experiments/live/live.h"
#include "experiments/live/watch.h"

namespace palpate::experiments {

/// What a session needs, checked.
struct LivePlan {
  device::SimulatedRig rig;
  device::WorkspaceOptions workspace;
  device::SwitchRule rule = device::SwitchRule::kContactElseWait;
  std::vector<LiveSetting> settings;
  std::vector<LiveChange> changes;
  device::RecordingHeader header;  ///< what a recording says of program and scene, where one is asked for
};
/// Everything that can be wrong with the arguments but scene and folder.
[[nodiscard]] Result<LivePlan> plan_live(const LiveArguments& arguments,
                                         const std::vector<RendererRequest>& renderers,
                                         const render::Registry& registry);

/// Prepares, runs, and fills the document; head, scene and warnings of the stage are the caller's.
[[nodiscard]] Status run_session(const LiveArguments& arguments, const LivePlan& plan, Workshop& workshop,
                                 Progress& progress, LiveDocument& document);

}  // namespace palpate::experiments
