// What a session gives to a window over it, and what it takes from there.
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

/// Shows a running session in a window for as long as this lives; does nothing without a link. Made before
/// the session runs, refers to it and to the mixer.
class WindowHooks {
 public:
  /// The device is asked what a person has to do until it knows its zero.
  WindowHooks(const LiveArguments& arguments, Assembly& session, device::Mixer& mixer,
              const SessionDevice& device, const render::SceneInput& scene, ShownSession shown);
  ~WindowHooks();
  WindowHooks(const WindowHooks&) = delete;
  WindowHooks& operator=(const WindowHooks&) = delete;

 private:
  SessionLink* link_;
  std::shared_ptr<WindowFeed> feed_;
};

/// The whole of `palpate live --window`: sessions on a thread of their own, one after the other where a scan
/// is dropped on the window, and the window on this one. The exit status of the last session.
/// `each_picture` is called after each, on this thread: what drives the window by program.
int run_live_in_window(const LiveArguments& arguments, const device::Drivers& drivers, Context& context,
                       const std::function<void(Window&)>& each_picture = {});

}  // namespace palpate::experiments
