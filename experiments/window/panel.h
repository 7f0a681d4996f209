// The panel beside the cloud: what is felt, by whom, how quickly, and the buttons.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <string>

#include "experiments/window/history.h"
#include "experiments/window/link.h"
#include "experiments/window/scene_view.h"

namespace palpate::experiments {

/// What a person has chosen and typed.
struct PanelState {
  bool lit = true, workspace = true, export_frames = false;
  bool sound = false;  ///< the force as a tone
  NearChoice near;
  std::array<char, 128> change{}, mark{};
  std::deque<double> marks_s;  ///< when marks were set
  std::string message;         ///< of the window itself: where a screenshot went
  /// Middles of buttons and boxes in the last picture, by their words: who drives the window by program finds
  /// them here.
  std::map<std::string, std::array<double, 2>> place_of;
  std::string used;  ///< which of them was clicked last; who clicks by program learns whether it was hit
  std::size_t uses = 0;
  double bottom = 0.0, right = 0.0;  ///< where what was drawn of the panel last ended, window units
  std::string homing;                ///< what was asked of the person at the device in the last picture
};

/// What a frame shows.
struct PanelView {
  const SessionLink::View& link;
  const WatchedTick* now;  ///< null: nothing runs
  const History& history;
  SceneView& scene;
  Camera& camera;
  double frames_a_second = 0.0;
  std::uint64_t samples_lost = 0;
  double press_mm = 0.0;
};

/// What buttons asked for in this frame, beyond what went to the link at once.
struct PanelWishes {
  bool screenshot = false, record = false;
};

/// Between ImGui's NewFrame and Render; in window units.
[[nodiscard]] PanelWishes draw_panel(const PanelView& view, PanelState& state, SessionLink& link, float left,
                                     float width, float height);
/// Reason and remedy where a fault is latched, across the top of the cloud; a button re-arms.
void draw_fault(const WatchedTick& now, SessionLink& link, float width);
/// How far preparation is, in the middle of the cloud.
void draw_preparation(const SessionLink::View& link, float width, float height);
/// What a person has to do before there is any force, over everything else; `prompt` is a sentence without
/// its full stop.
void draw_homing(const std::string& prompt, float width, float height);
/// Its paper: tests find it by that.
inline constexpr std::array<std::uint8_t, 3> kHomingPaper = {24, 66, 140};
/// What a person can do about a fault.
[[nodiscard]] const char* fault_remedy(device::Fault fault) noexcept;

// plots.cpp: plots by draw lists, at ImGui's cursor, of the width that is there.
/// The governed force of the last seconds, with marks.
void plot_force(const History& history, double limit_n, const std::deque<double>& marks_s, float height);
/// The largest frame time in each column, on a logarithmic scale with a line at a millisecond.
void plot_frame_times(const History& history, float height);
/// How often which frame time came; the counts on a logarithmic scale.
void plot_histogram(const FrameTimeHistogram& histogram, float height);

}  // namespace palpate::experiments
