// One live session: device, hand, renderers, mixer, governor, servo.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "device/live/hand_controls.h"
#include "device/record/recording_header.h"
#include "experiments/live/changes.h"
#include "experiments/live/live.h"
#include "experiments/live/remote.h"
#include "experiments/live/session_device.h"

namespace palpate::experiments {

/// A session's checked requirements.
struct LivePlan {
  DeviceChoice device;
  device::WorkspaceOptions workspace;
  device::SwitchRule rule = device::SwitchRule::kContactElseWait;
  std::vector<LiveSetting> settings;
  std::vector<LiveChange> changes;
  std::optional<ListenAddress> listen;
  device::RecordingHeader header;  ///< program and scene of a recording, if one is wanted
};
/// Checks all arguments but scene and folder.
[[nodiscard]] Result<LivePlan> plan_live(const LiveArguments& arguments,
                                         const std::vector<RendererRequest>& renderers,
                                         const render::Registry& registry, const device::Drivers& drivers);

/// Prepares, opens the device, runs and fills the document. Starts on a subset of the points if a window
/// waits for a large scene. The caller adds head, scene and the stage's warnings.
[[nodiscard]] Status run_session(const LiveArguments& arguments, const LivePlan& plan, Workshop& workshop,
                                 SessionClock& clock, SessionDevice& device, ProgressBar& progress,
                                 LiveDocument& document);

}  // namespace palpate::experiments
