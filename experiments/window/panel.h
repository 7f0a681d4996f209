// The panel beside the cloud: forces, renderers, times and buttons.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <string>

#include "experiments/window/link.h"
#include "experiments/window/scene_view.h"

namespace palpate::experiments {

/// A person's choices and input.
struct PanelState {
  bool lit = true, workspace = true, export_frames = false;
  bool sound = false;  ///< plays the force as a tone
  NearChoice near;
  std::array<char, 128> change{}, mark{};
  std::deque<double> marks_s;  ///< when marks were set
  std::string message;         ///< the window's own: a screenshot's path
  /// Centres of buttons and boxes in the last picture, by label, for automation.
  std::map<std::string, std::array<double, 2>> place_of;
  std::string used;  ///< the item clicked last, for automation
  std::size_t uses = 0;
  double bottom = 0.0, right = 0.0;  ///< lower right end of the last drawn panel, window units
  std::string homing;                ///< the last picture's homing instruction
};

struct PanelView {
  const SessionLink::View& link;
  const WatchedTick* now;  ///< null: not running
  const History& history;
  SceneView& scene;
  Camera& camera;
  double frames_a_second = 0.0;
  std::uint64_t samples_lost = 0;
  double press_mm = 0.0;
};

/// A frame's button requests, besides those sent directly to the link.
struct PanelWishes {
  bool screenshot = false, record = false;
};

/// Call between ImGui's NewFrame and Render; window units.
[[nodiscard]] PanelWishes draw_panel(const PanelView& view, PanelState& state, SessionLink& link, float left,
                                     float width, float height);
/// Draws a latched fault with reason, remedy and re-arm button across the cloud's top.
void draw_fault(const WatchedTick& now, SessionLink& link, float width);
/// Draws preparation progress in the cloud's centre.
void draw_preparation(const SessionLink::View& link, float width, float height);
/// Draws homing instructions over everything else; `prompt` has no full stop.
void draw_homing(const std::string& prompt, float width, float height);
/// Background of draw_homing(); tests find it by this colour.
inline constexpr std::array<std::uint8_t, 3> kHomingPaper = {24, 66, 140};
/// The person's remedy for a fault.
[[nodiscard]] const char* fault_remedy(device::Fault fault) noexcept;

// In overlay.cpp: plots by draw lists at ImGui's cursor, in the available width.
/// Governed force of the last seconds, with marks.
void plot_force(const History& history, double limit_n, const std::deque<double>& marks_s, float height);
/// Largest frame time per column, on a logarithmic scale with a line at 1 ms.
void plot_frame_times(const History& history, float height);
/// Histogram of frame times, with counts on a logarithmic scale.
void plot_histogram(const FrameTimeHistogram& histogram, float height);

}  // namespace palpate::experiments
