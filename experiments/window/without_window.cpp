// Replaces the window in builds without one, with an error message.
#include "experiments/window/window.h"

namespace palpate::experiments {

struct Window::State {};

Result<std::unique_ptr<Window>> Window::open(SessionLink&, const WindowOptions&) {
  return Error{"this program was built without a window",
               "leave --window out, or configure with -DPALPATE_WITH_WINDOW=ON (GLFW, Dear ImGui and epoxy)"};
}
Window::~Window() = default;
// Unreachable: no window can be created.
bool Window::frame() {
  return false;
}
std::string Window::take_dropped() {
  return {};
}
bool Window::take_record() {
  return false;
}
void Window::forget() {}

}  // namespace palpate::experiments
