// Connects a session to the window over it.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "experiments/live/assembly.h"
#include "experiments/live/live.h"
#include "experiments/window/link.h"

namespace palpate::experiments {

class Window;  // experiments/window/window.h

/// Shows a running session in a window while it lives; does nothing without a link. Create before the session
/// runs. Refers to session and mixer.
class WindowHooks {
 public:
  /// The device supplies homing instructions.
  WindowHooks(const LiveArguments& arguments, Assembly& session, device::Mixer& mixer,
              const SessionDevice& device, const render::SceneInput& scene, ShownSession shown);
  ~WindowHooks();
  WindowHooks(const WindowHooks&) = delete;
  WindowHooks& operator=(const WindowHooks&) = delete;

 private:
  SessionLink* link_;
  std::shared_ptr<WindowFeed> feed_;
};

/// `palpate live --window`: runs the window on this thread and sessions on another, one for each scan dropped
/// on the window. Returns the last session's exit status. `each_picture` runs on this thread after each
/// picture, for automation.
int run_live_in_window(const LiveArguments& arguments, const device::Drivers& drivers, Context& context,
                       const std::function<void(Window&)>& each_picture = {});

}  // namespace palpate::experiments
