// What the simulated hand of a live session means to do, over any scene.
#pragma once

#include <string>
#include <vector>

#include "device/servo/device_map.h"
#include "device/simulated/hand_script.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

/// Of a window: the hand goes where the mouse says. Not among live_hands(): it needs somebody there.
inline constexpr const char* kMouseHand = "mouse";

/// "explore", "press", "slide", "tap".
[[nodiscard]] const std::vector<std::string>& live_hands();

/// A script of `seconds`, device frame. "explore" goes along the path and back for as long as that takes; the
/// others do their task again and again at a place that `renderer` touches along the path. Errors: there is
/// none.
[[nodiscard]] Result<device::HandScript> live_hand(const std::string& hand, const trace::ProbePath& path,
                                                   render::HapticRenderer& renderer,
                                                   const device::DeviceMap& map, double seconds);

/// The deepest contact along the path, as the renderer feels it; device frame. Errors: there is none.
[[nodiscard]] Result<device::TaskPlace> touched_place(const trace::ProbePath& path,
                                                      render::HapticRenderer& renderer,
                                                      const device::DeviceMap& map);

}  // namespace palpate::experiments
