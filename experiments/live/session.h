// One live session: device, hand, renderers, mixer, governor and servo, put together and run.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "device/live/workspace.h"
#include "device/record/recording_header.h"
#include "experiments/live/changes.h"
#include "experiments/live/live.h"
#include "experiments/live/remote.h"
#include "experiments/live/session_device.h"

namespace palpate::experiments {

/// What a session needs, checked.
struct LivePlan {
  DeviceChoice device;
  device::WorkspaceOptions workspace;
  device::SwitchRule rule = device::SwitchRule::kContactElseWait;
  std::vector<LiveSetting> settings;
  std::vector<LiveChange> changes;
  std::optional<ListenAddress> listen;
  device::RecordingHeader header;  ///< what a recording says of program and scene, where one is asked for
};
/// Everything that can be wrong with the arguments but scene and folder.
[[nodiscard]] Result<LivePlan> plan_live(const LiveArguments& arguments,
                                         const std::vector<RendererRequest>& renderers,
                                         const render::Registry& registry, const device::Drivers& drivers);

/// Prepares, on a part of the points first where a window waits for a large scene, opens the device, runs,
/// and fills the document; head, scene and warnings of the stage are the caller's.
[[nodiscard]] Status run_session(const LiveArguments& arguments, const LivePlan& plan, Workshop& workshop,
                                 SessionClock& clock, SessionDevice& device, ProgressBar& progress,
                                 LiveDocument& document);

}  // namespace palpate::experiments
