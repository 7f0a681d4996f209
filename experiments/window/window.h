// The window over a live session: cloud, contact, panel, and mouse as a hand.
//
// It reads the servo's data (link.h) without blocking either side, and runs on the program's first thread, as
// window systems require.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include <palpate/result.h>
#include "experiments/report/figures.h"
#include "experiments/window/camera.h"
#include "experiments/window/link.h"
#include "experiments/window/panel.h"

namespace palpate::experiments {

struct WindowOptions {
  int width = 1280, height = 800;
  std::string pictures = ".";  ///< folder of screenshots and exported frames
  bool paced = true;           ///< false: unlimited picture rate, for measurements
  std::optional<Up> up;        ///< empty: the scene's, else z
};

/// One thread. Input comes from the window system, or from automation through the same members.
class Window {
 public:
  /// Errors: no display, no OpenGL 3.3; built without a window. The link must outlive it.
  [[nodiscard]] static Result<std::unique_ptr<Window>> open(SessionLink& link, const WindowOptions& options);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  /// Handles input and draws one picture. False: the window was closed.
  bool frame();
  /// A file dropped since the last call; empty: none.
  [[nodiscard]] std::string take_dropped();
  /// True if Record was pressed since the last call.
  [[nodiscard]] bool take_record();
  void forget();

  // Input, in window units from the upper left corner.
  enum class Button { kLeft, kRight, kMiddle };
  void mouse_at(double x, double y);
  void mouse_button(Button button, bool down);
  void wheel(double steps);
  void dropped(std::string path);
  /// GLFW's key numbers.
  void key(int key, bool down);
  void text(unsigned character);

  /// The last complete picture, redrawn.
  [[nodiscard]] ColourImage picture();
  [[nodiscard]] Status screenshot(const std::string& path);
  [[nodiscard]] SceneView& scene();
  [[nodiscard]] const Camera& camera() const;
  void look_from(const Camera& camera);
  [[nodiscard]] PanelState& panel();
  /// Centre of a panel item in the last picture, by label; empty if none.
  [[nodiscard]] std::optional<std::array<double, 2>> place_of(const std::string& words) const;
  [[nodiscard]] const History& history() const;
  /// The newest drawn tick; ticks 0: none.
  [[nodiscard]] const WatchedTick& drawn_tick() const;
  /// Size of the cloud's view, window units.
  [[nodiscard]] double view_width() const;
  [[nodiscard]] double view_height() const;

 private:
  struct State;
  explicit Window(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

// Saves pictures of the window as files.

/// Reads the default framebuffer's back buffer. Needs a current OpenGL context.
[[nodiscard]] ColourImage read_window(int width_px, int height_px);
/// Writes a complete PNG file or none. An Error names it.
[[nodiscard]] Status write_png(const ColourImage& image, const std::string& path);

}  // namespace palpate::experiments
