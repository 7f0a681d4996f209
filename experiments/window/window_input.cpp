// Mouse, keys and dropped files of the window.
#include <imgui.h>

#include <cmath>
#include <utility>

#include "experiments/window/window_state.h"

namespace palpate::experiments {
namespace {

/// Rotation for a drag over the window's height.
constexpr double kTurnRad = 3.0;
constexpr double kZoomFactor = 1.12;  // per wheel step

std::size_t index_of(Window::Button button) {
  return static_cast<std::size_t>(button);
}

/// The device's nearest reachable position to `device_mm`.
Vec3 reachable(const Vec3& device_mm, const device::DeviceLimits& limits) {
  const geometry::Aabb& box = limits.workspace_mm;
  return box.empty() ? device_mm : Vec3(device_mm.cwiseMax(box.low_mm).cwiseMin(box.high_mm));
}

}  // namespace

void Window::State::steer() {
  const double moved_x = input.x - input.last_x, moved_y = input.y - input.last_y;
  input.last_x = input.x;
  input.last_y = input.y;
  const bool over_cloud = input.x >= 0.0 && input.x < view_width() && input.y >= 0.0 && input.y < height &&
                          !ImGui::GetIO().WantCaptureMouse;
  const bool left = input.down[index_of(Button::kLeft)];
  if (!left) input.pressing = false;
  if (left && over_cloud && session && session->hand) input.pressing = true;
  const double steps = std::exchange(input.wheel, 0.0);
  if (input.pressing)
    hand.wheel(steps);
  else if (over_cloud && steps != 0.0)
    camera.zoom(std::pow(kZoomFactor, steps));
  else if (steps != 0.0)
    ImGui::GetIO().MouseWheel += static_cast<float>(steps);
  const bool turns = input.down[index_of(Button::kRight)], pans = input.down[index_of(Button::kMiddle)];
  // The left button also turns without a hand.
  if (turns || (left && !input.pressing && over_cloud))
    camera.turn(-kTurnRad * moved_x / height, kTurnRad * moved_y / height);
  if (pans) camera.pan(moved_x, moved_y, height);
  if (!session || !session->hand || now.ticks == 0 || turns || pans || !(over_cloud || input.pressing))
    return;
  std::optional<Hit> hit = scene->splats().at(input.x * scale(), input.y * scale());
  if (hit) hit = scene->on_surface(*hit, camera.eye_mm());
  const Mat4 clip_from_world = camera.clip_from_world(view_width(), height);
  Vec3 ray_mm = camera.target_mm();
  if (hand.last())
    if (const auto last = project(clip_from_world, hand.last()->place_mm, view_width(), height))
      ray_mm = unproject(clip_from_world, {input.x, input.y, last->depth}, view_width(), height);
  const std::optional<Vec3> goal_mm = hand.goal_mm(hit, ray_mm, camera, now.map, input.pressing);
  if (goal_mm) session->hand->aim(reachable(now.map.device_mm(*goal_mm), session->limits));
}

void Window::mouse_at(double x, double y) {
  WindowInput& input = state_->input;
  if (input.last_x < 0.0) {
    input.last_x = x;
    input.last_y = y;
  }
  input.x = x;
  input.y = y;
}

void Window::mouse_button(Button button, bool down) {
  state_->input.down[index_of(button)] = down;
}

void Window::wheel(double steps) {
  state_->input.wheel += steps;
}

void Window::dropped(std::string path) {
  state_->dropped = std::move(path);
}

void Window::key(int key, bool down) {
  ImGuiIO& io = ImGui::GetIO();
  if (key >= 0 && static_cast<std::size_t>(key) < std::size(io.KeysDown)) io.KeysDown[key] = down;
  if (io.WantTextInput || !down) return;
  using Kind = device::SwitchRequest::Kind;
  constexpr int kTab = 258;  // GLFW_KEY_TAB; letters and digits are capital ASCII
  SessionLink& link = state_->link;
  if (key == kTab) link.request({Kind::kNext, device::SwitchSource::kKey, 0});
  if (key == 'C') link.request({Kind::kCancel, device::SwitchSource::kKey, 0});
  if (key == 'R') link.rearm();
  if (key == 'U') {
    const Up before = state_->camera.up_axis();
    state_->camera.set_up(kUps[(static_cast<std::size_t>(before) + 1) % kUps.size()]);
  }
  if (key >= '1' && key <= '9')
    link.request({Kind::kSelect, device::SwitchSource::kKey, static_cast<std::uint8_t>(key - '1')});
}

void Window::text(unsigned character) {
  ImGui::GetIO().AddInputCharacter(character);
}

std::string Window::take_dropped() {
  return std::exchange(state_->dropped, {});
}

bool Window::take_record() {
  return std::exchange(state_->record, false);
}

void Window::forget() {
  state_->session.reset();
  state_->now = {};
  state_->history.clear();
  state_->touched = false;
}

SceneView& Window::scene() {
  return *state_->scene;
}
const Camera& Window::camera() const {
  return state_->camera;
}
void Window::look_from(const Camera& camera) {
  state_->camera = camera;
}
PanelState& Window::panel() {
  return state_->panel;
}
std::optional<std::array<double, 2>> Window::place_of(const std::string& words) const {
  const auto found = state_->panel.place_of.find(words);
  if (found == state_->panel.place_of.end()) return std::nullopt;
  return found->second;
}
const History& Window::history() const {
  return state_->history;
}
const WatchedTick& Window::drawn_tick() const {
  return state_->now;
}
double Window::view_width() const {
  return state_->view_width();
}
double Window::view_height() const {
  return state_->height;
}

}  // namespace palpate::experiments
