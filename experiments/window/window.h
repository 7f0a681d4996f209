// The window over a live session: the cloud, the contact, the panel, and the mouse as a hand.
//
// It reads what the servo left for it (feed.h) and waits for nobody; nobody waits for it. It runs on the
// program's first thread, as window systems ask for.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "experiments/report/png.h"
#include "experiments/window/camera.h"
#include "experiments/window/link.h"
#include "experiments/window/panel.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

struct WindowOptions {
  int width = 1280, height = 800;
  std::string pictures = ".";  ///< the folder of screenshots and exported frames
  bool paced = true;           ///< false: as many pictures as go, for measurements
  std::optional<Up> up;        ///< empty: as the scene says, else z
};

/// One thread. Input comes from the window system, or from a program through the same members.
class Window {
 public:
  /// Errors: no display, no OpenGL 3.3; built without a window. The link outlives it.
  [[nodiscard]] static Result<std::unique_ptr<Window>> open(SessionLink& link, const WindowOptions& options);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  /// Handles input and draws one picture. False: the window was closed.
  bool frame();
  /// A file that was dropped on it since the last call; empty: none.
  [[nodiscard]] std::string take_dropped();
  /// Whether Record was pressed since the last call.
  [[nodiscard]] bool take_record();
  /// A new session is on the way: what was shown of the one before goes.
  void forget();

  // Input, in window units from the upper left corner.
  enum class Button { kLeft, kRight, kMiddle };
  void mouse_at(double x, double y);
  void mouse_button(Button button, bool down);
  void wheel(double steps);
  void dropped(std::string path);
  /// Keys of the keyboard as GLFW numbers them.
  void key(int key, bool down);
  void text(unsigned character);

  /// The last picture, whole, as it went to the screen; drawn anew.
  [[nodiscard]] ColourImage picture();
  [[nodiscard]] Status screenshot(const std::string& path);
  [[nodiscard]] SceneView& scene();
  [[nodiscard]] const Camera& camera() const;
  void look_from(const Camera& camera);
  [[nodiscard]] PanelState& panel();
  /// The middle of a button or box of the panel in the last picture, by its words; nothing where there is
  /// none.
  [[nodiscard]] std::optional<std::array<double, 2>> place_of(const std::string& words) const;
  [[nodiscard]] const History& history() const;
  /// The newest tick that was drawn; ticks 0: none.
  [[nodiscard]] const WatchedTick& drawn_tick() const;
  /// Of the part that shows the cloud, window units.
  [[nodiscard]] double view_width() const;
  [[nodiscard]] double view_height() const;
  /// Pictures a second, over the last ones.
  [[nodiscard]] double frames_a_second() const;
  /// "llvmpipe ..": who draws.
  [[nodiscard]] std::string graphics() const;

 private:
  struct State;
  explicit Window(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace palpate::experiments
