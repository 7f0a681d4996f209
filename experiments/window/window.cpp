#include "experiments/window/window.h"

#include <epoxy/gl.h>
// After epoxy, which replaces the system's OpenGL header.
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_opengl3.h>
#include <fmt/format.h>
#include <imgui.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include <palpate/result.h>
#include "experiments/window/window_state.h"
#include "toolkit/core/files.h"

namespace palpate::experiments {
namespace {

constexpr int kPanelWidth = 384;
/// Smallest window that shows the panel with its buttons and as much of the cloud.
constexpr int kLeastWidth = 2 * kPanelWidth, kLeastHeight = 480;
/// Text readable from the device: twice the usual size, so pixels stay square.
constexpr float kLargeLetters = 26.0f;
/// Limits the picture rate to a screen's and leaves time for the servo.
constexpr double kShortestPictureMs = 16.0;
constexpr std::size_t kPicturesCounted = 30;
/// Niceness of drawing relative to the servo, software rendering threads included.
constexpr int kDrawingNiceness = 10;
constexpr double kPictureNsPerMs = 1e6, kPictureNsPerS = 1e9;

Window* window_of(GLFWwindow* window) {
  return static_cast<Window*>(glfwGetWindowUserPointer(window));
}

std::optional<Window::Button> button_of(int button) {
  if (button == GLFW_MOUSE_BUTTON_LEFT) return Window::Button::kLeft;
  if (button == GLFW_MOUSE_BUTTON_RIGHT) return Window::Button::kRight;
  if (button == GLFW_MOUSE_BUTTON_MIDDLE) return Window::Button::kMiddle;
  return std::nullopt;
}

void listen_to(GLFWwindow* window) {
  glfwSetCursorPosCallback(window, [](GLFWwindow* w, double x, double y) { window_of(w)->mouse_at(x, y); });
  glfwSetMouseButtonCallback(window, [](GLFWwindow* w, int button, int action, int) {
    if (const auto known = button_of(button)) window_of(w)->mouse_button(*known, action == GLFW_PRESS);
  });
  glfwSetScrollCallback(window, [](GLFWwindow* w, double, double steps) { window_of(w)->wheel(steps); });
  glfwSetKeyCallback(window, [](GLFWwindow* w, int key, int, int action, int) {
    if (key >= 0) window_of(w)->key(key, action != GLFW_RELEASE);
  });
  glfwSetCharCallback(window, [](GLFWwindow* w, unsigned character) { window_of(w)->text(character); });
  glfwSetDropCallback(window, [](GLFWwindow* w, int count, const char** paths) {
    if (count > 0) window_of(w)->dropped(paths[0]);
  });
}

void make_interface() {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;  // no file is written
  io.LogFilename = nullptr;
  io.KeyMap[ImGuiKey_Tab] = GLFW_KEY_TAB;
  io.KeyMap[ImGuiKey_LeftArrow] = GLFW_KEY_LEFT;
  io.KeyMap[ImGuiKey_RightArrow] = GLFW_KEY_RIGHT;
  io.KeyMap[ImGuiKey_Home] = GLFW_KEY_HOME;
  io.KeyMap[ImGuiKey_End] = GLFW_KEY_END;
  io.KeyMap[ImGuiKey_Delete] = GLFW_KEY_DELETE;
  io.KeyMap[ImGuiKey_Backspace] = GLFW_KEY_BACKSPACE;
  io.KeyMap[ImGuiKey_Enter] = GLFW_KEY_ENTER;
  io.KeyMap[ImGuiKey_Escape] = GLFW_KEY_ESCAPE;
  io.Fonts->AddFontDefault();
  ImFontConfig large;
  large.SizePixels = kLargeLetters;
  io.Fonts->AddFontDefault(&large);
  ImGui::StyleColorsDark();
  ImGuiStyle& style = ImGui::GetStyle();
  style.WindowRounding = 0.0f;
  style.FrameRounding = 3.0f;
  style.WindowBorderSize = 0.0f;
  style.Colors[ImGuiCol_WindowBg] = ImVec4{0.105f, 0.12f, 0.145f, 0.98f};
  ImGui_ImplOpenGL3_Init("#version 330 core");
}

Error no_window(const std::string& why) {
  return Error{"no window can be opened: " + why,
               "leave --window out, or give the program a display (ssh -X, xvfb-run) with OpenGL 3.3"};
}

void report_interface(const WindowInput& input, int width, int height, double scale) {
  ImGuiIO& io = ImGui::GetIO();
  io.DisplaySize = {static_cast<float>(width), static_cast<float>(height)};
  io.DisplayFramebufferScale = {static_cast<float>(scale), static_cast<float>(scale)};
  io.DeltaTime = 1.0f / 60.0f;
  io.MousePos = {static_cast<float>(input.x), static_cast<float>(input.y)};
  io.MouseDown[ImGuiMouseButton_Left] = input.down[0];
  io.MouseDown[ImGuiMouseButton_Right] = input.down[1];
  io.MouseDown[ImGuiMouseButton_Middle] = input.down[2];
}

}  // namespace

double Window::State::view_width() const {
  return std::max(1, width - kPanelWidth);
}

Window::Window(std::unique_ptr<State> state) : state_(std::move(state)) {}

Result<std::unique_ptr<Window>> Window::open(SessionLink& link, const WindowOptions& options) {
  // Drawing threads inherit this thread's niceness.
  (void)::setpriority(PRIO_PROCESS, 0, kDrawingNiceness);
  std::string why = "there is no display";
  if (glfwInit() != GLFW_TRUE) return no_window(why);
  auto state = std::make_unique<State>(link, options);
  if (options.up) state->camera.set_up(*options.up);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
  state->window = glfwCreateWindow(options.width, options.height, "Palpate", nullptr, nullptr);
  if (state->window == nullptr) {
    const char* words = nullptr;
    (void)glfwGetError(&words);
    const Error error = no_window(words != nullptr ? words : "no OpenGL 3.3");
    glfwTerminate();
    return error;
  }
  std::unique_ptr<Window> window(new Window(std::move(state)));
  GLFWwindow* raw = window->state_->window;
  glfwSetWindowSizeLimits(raw, kLeastWidth, kLeastHeight, GLFW_DONT_CARE, GLFW_DONT_CARE);
  glfwMakeContextCurrent(raw);
  // No vertical sync: the window paces itself.
  glfwSwapInterval(0);
  make_interface();
  window->state_->has_interface = true;
  PALPATE_ASSIGN(std::unique_ptr<SplatDrawer> splats, SplatDrawer::create());
  window->state_->scene = std::make_unique<SceneView>(std::move(splats));
  glfwSetWindowUserPointer(raw, window.get());
  listen_to(raw);
  return window;
}

Window::~Window() {
  state_->scene.reset();
  state_->sound.reset();
  if (state_->has_interface) {
    ImGui_ImplOpenGL3_Shutdown();
    ImGui::DestroyContext();
  }
  if (state_->window != nullptr) {
    glfwDestroyWindow(state_->window);
    glfwTerminate();
  }
}

void Window::State::measure() {
  glfwGetWindowSize(window, &width, &height);
  glfwGetFramebufferSize(window, &width_px, &height_px);
}

void Window::State::take_news() {
  view = link.view();
  if (view.scene.get() != scene->scene() && view.scene) {
    const std::string before = scene->scene() != nullptr ? scene->scene()->name : "";
    scene->show(view.scene);
    // Keeps the camera when a session restarts over the same scene.
    const std::optional<Up> said = options.up ? std::nullopt : up_named(view.scene->up);
    if (view.scene->name != before) camera = Camera::of(scene->box_mm(), said.value_or(camera.up_axis()));
    hand.forget();
    glfwSetWindowTitle(window, ("Palpate: " + view.scene->name).c_str());
  }
  if (view.session != session) {
    session = view.session;
    now = {};
    if (session) history.clear();
    panel.marks_s.clear();
    hand.forget();
  }
  if (!session) return;
  if (session->feed->acquire()) now = session->feed->newest();
  history.take(session->feed->samples());
  if (now.ticks > 0 && view.touchable_s < 0.0) link.touchable();
  if (now.tick.frame.contact && !touched) {
    touched = true;
    link.felt();
  }
}

void Window::State::draw_over() {
  const Overlay overlay(ImGui::GetBackgroundDrawList(), camera, view_width(), height);
  if (session && panel.workspace && now.ticks > 0) {
    const geometry::Aabb& reach = session->limits.workspace_mm;
    overlay.box(corners_of(reach.low_mm, reach.high_mm, [&](const Vec3& p) { return now.map.world_mm(p); }),
                kWorkspaceColour, 1.0f, 0.8f);
  }
  if (now.ticks > 0) {
    scene->draw_near(overlay, now, panel.near);
    draw_contact(overlay, now, session ? session->force_limit_n : 0.0, scene->radius_mm());
  }
}

void Window::State::draw() {
  scene->splats().light(panel.lit);
  const int view_px = static_cast<int>(view_width() * scale());
  const Stopwatch drawing;
  scene->splats().draw(camera, view_px, height_px);
  glFinish();
  scene->splats().took(drawing.ms());
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  glViewport(0, 0, width_px, height_px);
  glClearColor(0.105f, 0.12f, 0.145f, 1.0f);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
  if (view_px > 0 && height_px > 0) scene->splats().show();
  report_interface(input, width, height, scale());
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::NewFrame();
  draw_over();
  const auto left = static_cast<float>(view_width());
  const double rate = ends_ns.size() < 2 ? 0.0
                                         : static_cast<double>(ends_ns.size() - 1) * kPictureNsPerS /
                                               static_cast<double>(ends_ns.back() - ends_ns.front());
  const PanelView shown{view,
                        now.ticks > 0 ? &now : nullptr,
                        history,
                        *scene,
                        camera,
                        rate,
                        session ? session->feed->samples().lost() : 0,
                        hand.press_mm()};
  wishes = draw_panel(shown, panel, link, left, static_cast<float>(width) - left, static_cast<float>(height));
  if (session && now.ticks > 0) draw_fault(now, link, left);
  draw_preparation(view, left, static_cast<float>(height));
  panel.homing = link.homing_prompt();
  draw_homing(panel.homing, left, static_cast<float>(height));
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

void Window::State::keep_sounding() {
  if (!panel.sound || sounded != session) {
    sound.reset();
    sounded.reset();
  }
  if (!panel.sound || sound || !session || !(session->force_limit_n > 0.0)) return;
  Result<std::unique_ptr<Sound>> opened = Sound::open(session->feed->force_n(), session->force_limit_n);
  if (opened) {
    sound = *std::move(opened);
    sounded = session;
    return;
  }
  panel.sound = false;
  panel.message = opened.error().message();
}

void Window::State::keep_pictures() {
  if (wishes.record) record = true;
  if (!wishes.screenshot && !panel.export_frames) return;
  const ColourImage image = read_window(width_px, height_px);
  const std::string path = wishes.screenshot
                               ? fmt::format("{}/palpate-{:03}.png", options.pictures, ++shots)
                               : fmt::format("{}/palpate-frame-{:06}.png", options.pictures, ++exported);
  const Status written = write_png(image, path);
  panel.message = written ? "written: " + path : written.error().message();
  if (!written) panel.export_frames = false;
}

bool Window::frame() {
  State& s = *state_;
  s.began_ns = monotonic_ns();
  glfwPollEvents();
  if (glfwWindowShouldClose(s.window) == GLFW_TRUE) return false;
  s.measure();
  s.take_news();
  s.scene->update(s.now.ticks > 0 ? &s.now : nullptr);
  if (s.session && s.now.ticks > 0) s.scene->follow_dents(*s.session->feed, s.now);
  if (s.session && s.session->images && s.session->images->acquire())
    s.scene->show_image(s.session->images->front());
  s.steer();
  s.draw();
  s.keep_pictures();
  s.keep_sounding();
  glFinish();
  const double took_ms = static_cast<double>(monotonic_ns() - s.began_ns) / kPictureNsPerMs;
  glfwSwapBuffers(s.window);
  if (s.options.paced && took_ms < kShortestPictureMs)
    std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(kShortestPictureMs - took_ms));
  s.ends_ns.push_back(monotonic_ns());
  if (s.ends_ns.size() > kPicturesCounted) s.ends_ns.pop_front();
  return true;
}

ColourImage Window::picture() {
  state_->draw();
  return read_window(state_->width_px, state_->height_px);
}

Status Window::screenshot(const std::string& path) {
  return write_png(picture(), path);
}

ColourImage read_window(int width_px, int height_px) {
  ColourImage image;
  if (width_px <= 0 || height_px <= 0) return image;
  image.width = width_px;
  image.height = height_px;
  const std::size_t row = 3 * static_cast<std::size_t>(width_px);
  std::vector<std::uint8_t> from_below(row * static_cast<std::size_t>(height_px));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
  glReadBuffer(GL_BACK);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width_px, height_px, GL_RGB, GL_UNSIGNED_BYTE, from_below.data());
  image.rgb.reserve(from_below.size());
  for (std::size_t y = static_cast<std::size_t>(height_px); y-- > 0;) {
    const auto begin = from_below.begin() + static_cast<std::ptrdiff_t>(y * row);
    image.rgb.insert(image.rgb.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
  }
  return image;
}

Status write_png(const ColourImage& image, const std::string& path) {
  const std::string bytes = colour_png(image);
  if (bytes.empty()) return Error{"there is no picture to write", "open the window first", path};
  return write_file(path, bytes);
}

}  // namespace palpate::experiments
