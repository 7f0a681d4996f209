// Internal: the window's state. Keeps OpenGL and GLFW out of headers.
#pragma once

#include <array>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "experiments/window/scene_view.h"
#include "experiments/window/sound.h"
#include "experiments/window/window.h"

struct GLFWwindow;

namespace palpate::experiments {

/// Mouse and key input since the last picture.
struct WindowInput {
  double x = -1.0, y = -1.0;
  std::array<bool, 3> down{};  ///< by Window::Button
  double wheel = 0.0;
  double last_x = -1.0, last_y = -1.0;  ///< in the previous picture
  bool pressing = false;                ///< the left button was pressed over the cloud
};

struct Window::State {
  State(SessionLink& with, const WindowOptions& wanted) : link(with), options(wanted) {}

  SessionLink& link;
  WindowOptions options;
  GLFWwindow* window = nullptr;
  bool has_interface = false;
  std::unique_ptr<SceneView> scene;
  Camera camera;
  PanelState panel;
  History history;
  MouseHand hand;
  WindowInput input;

  SessionLink::View view;
  std::shared_ptr<const ShownSession> session;  // whose feed is read
  WatchedTick now;                              // ticks 0: none
  bool touched = false;                         // contact occurred in this session
  std::shared_ptr<const ShownSession> sounded;  // whose force `sound` plays
  std::unique_ptr<Sound> sound;                 // destroyed before what it plays
  std::string dropped;
  bool record = false;
  PanelWishes wishes;
  std::uint64_t exported = 0, shots = 0;

  int width = 0, height = 0;         // window units
  int width_px = 0, height_px = 0;   // the framebuffer's
  std::int64_t began_ns = 0;         // this picture's start
  std::deque<std::int64_t> ends_ns;  // of recent pictures

  [[nodiscard]] double view_width() const;
  [[nodiscard]] double scale() const { return width > 0 ? static_cast<double>(width_px) / width : 1.0; }

  void measure();
  void take_news();
  void steer();
  void draw_over();
  void draw();
  void keep_pictures();
  void keep_sounding();
};

}  // namespace palpate::experiments
