#include "experiments/window/panel.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using Kind = device::SwitchRequest::Kind;

const ImVec4 kGood = {0.47f, 0.86f, 0.55f, 1.0f}, kQuiet = {0.60f, 0.65f, 0.72f, 1.0f},
             kWarm = {1.0f, 0.78f, 0.25f, 1.0f}, kBad = {1.0f, 0.45f, 0.40f, 1.0f};
constexpr float kForcePlot = 92.0f, kTimePlot = 92.0f, kHistogramPlot = 64.0f;
/// Height of the panel besides plots (two renderers, a colour scale) and per further renderer. Lower windows
/// first shrink the plots, to half at most; then the panel scrolls.
constexpr float kBesidePlots = 470.0f, kRendererRow = 23.0f, kLeastPlotShare = 0.5f;
constexpr float kRuleGap = 8.0f;
constexpr float kScaleHeight = 10.0f;
constexpr int kScaleSteps = 64;
constexpr float kHomingWide = 760.0f, kHomingEdge = 24.0f;
constexpr double kUsPerNsShown = 1e-3;

/// The font added last by make_interface().
ImFont* large_font() {
  return ImGui::GetIO().Fonts->Fonts.back();
}

void words(const ImVec4& colour, const std::string& text) {
  ImGui::PushStyleColor(ImGuiCol_Text, colour);
  ImGui::TextWrapped("%s", text.c_str());
  ImGui::PopStyleColor();
}

/// Notes the last item's place and whether it was clicked.
bool at_place(PanelState& state, const char* label, bool answer) {
  const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
  state.place_of[label] = {0.5 * static_cast<double>(low.x + high.x),
                           0.5 * static_cast<double>(low.y + high.y)};
  state.right = std::max(state.right, static_cast<double>(high.x));
  if (answer) {
    state.used = label;
    ++state.uses;
  }
  return answer;
}

bool button(PanelState& state, const char* label, const ImVec2& size = {0.0f, 0.0f}) {
  return at_place(state, label, ImGui::Button(label, size));
}

void box(PanelState& state, const char* label, bool& on) {
  (void)at_place(state, label, ImGui::Checkbox(label, &on));
}

void heading(const char* text) {
  ImGui::Spacing();
  ImGui::TextColored(kQuiet, "%s", text);
  // The line continues beside the words.
  const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
  const float right = ImGui::GetWindowPos().x + ImGui::GetWindowContentRegionMax().x,
              middle = std::floor(0.5f * (low.y + high.y));
  if (high.x + kRuleGap < right)
    ImGui::GetWindowDrawList()->AddRectFilled({high.x + kRuleGap, middle}, {right, middle + 1.0f},
                                              ImGui::GetColorU32(ImGuiCol_Separator));
}

void draw_state(const PanelView& view) {
  const ShownScene* scene = view.scene.scene();
  if (scene != nullptr)
    words(kQuiet, fmt::format("{} · {} points", scene->name, format_count(view.scene.splats().points())));
  if (view.now == nullptr || view.now->ticks == 0) {
    words(kQuiet, view.link.session ? "the servo begins" : "not touchable yet");
    return;
  }
  const device::Tick& tick = view.now->tick;
  const bool faulted = tick.fault != device::Fault::kNone;
  ImGui::PushFont(large_font());
  words(faulted              ? kBad
        : tick.frame.contact ? kGood
                             : kQuiet,
        fmt::format("{:>6.3f} N  {}", tick.sent_n.norm(),
                    faulted              ? "fault"
                    : tick.frame.contact ? "touching"
                                         : "free"));
  ImGui::PopFont();
  const double depth_mm = tick.frame.contact ? (tick.frame.god_object_mm - tick.hip_mm).norm() : 0.0;
  words(kQuiet,
        fmt::format("HIP {:.2f} {:.2f} {:.2f} mm\n{} · {:.3f} mm deep", tick.hip_mm.x(), tick.hip_mm.y(),
                    tick.hip_mm.z(), view.link.session ? view.link.session->device : "", depth_mm));
}

/// A lane's present renderer. A lane being replaced has two; the felt one counts.
const device::TrackedFrame* in_lane(const device::MixedFrame& mixed, std::size_t lane, bool& felt) {
  const device::TrackedFrame* found = nullptr;
  felt = false;
  for (std::size_t i = 0; i < mixed.tracked.size(); ++i) {
    const device::TrackedFrame& one = mixed.tracked[i];
    if (!one.present || one.lane != lane || (felt && found != nullptr)) continue;
    found = &one;
    felt = i == mixed.felt;
  }
  return found;
}

void draw_renderer(const PanelView& view, PanelState& state, SessionLink& link, std::size_t lane) {
  const ShownSession& session = *view.link.session;
  bool felt = false;
  const device::TrackedFrame* one = view.now != nullptr ? in_lane(view.now->mixed, lane, felt) : nullptr;
  ImGui::PushID(static_cast<int>(lane));
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  if (felt) ImGui::PushStyleColor(ImGuiCol_Button, ImVec4{0.20f, 0.45f, 0.28f, 1.0f});
  const std::string label = fmt::format("{} {}", lane + 1, session.labels[lane]);
  if (button(state, label.c_str(), {-1.0f, 0.0f}))
    link.request({Kind::kSelect, device::SwitchSource::kProgram, static_cast<std::uint8_t>(lane)});
  if (felt) ImGui::PopStyleColor();
  if (one != nullptr) {
    const double size_n = one->frame.force_n.norm();
    ImGui::TableNextColumn();
    ImGui::Text("%7.3f", size_n);
    ImGui::TableNextColumn();
    ImGui::Text("%7.2f", static_cast<double>(one->step_ns) * kUsPerNsShown);
    ImGui::TableNextColumn();
    const bool out = one->disqualified != device::Disqualified::kNo;
    const bool coarse = !session.stand_in.empty() && one->generation == SessionLink::kFirstGeneration;
    ImGui::TextColored(out                  ? kBad
                       : coarse             ? kWarm
                       : one->frame.contact ? kGood
                                            : kQuiet,
                       "%s%s",
                       out                  ? "out"
                       : one->frame.contact ? "touches"
                                            : "free",
                       coarse ? ", coarse" : "");
    if (out && ImGui::IsItemHovered()) ImGui::SetTooltip("%s", device::disqualified_text(one->disqualified));
  }
  ImGui::PopID();
}

/// True while a lane still has a stand-in.
bool any_coarse(const PanelView& view) {
  if (view.now == nullptr || view.link.session->stand_in.empty()) return false;
  for (const device::TrackedFrame& one : view.now->mixed.tracked)
    if (one.present && one.generation == SessionLink::kFirstGeneration) return true;
  return false;
}

void draw_beside(const PanelView& view) {
  if (any_coarse(view))
    words(kWarm, "Coarse: " + view.link.session->stand_in + " until the whole is prepared.");
  if (view.link.phase.empty()) return;
  ImGui::ProgressBar(view.link.fraction >= 0.0 ? static_cast<float>(std::min(1.0, view.link.fraction)) : 0.0f,
                     {-1.0f, 0.0f}, view.link.phase.c_str());
}

void draw_renderers(const PanelView& view, PanelState& state, SessionLink& link) {
  if (!view.link.session) return;
  heading("Renderers: force now (N), last frame (µs)");
  if (!ImGui::BeginTable("renderers", 4, ImGuiTableFlags_SizingFixedFit)) return;
  ImGui::TableSetupColumn("who", ImGuiTableColumnFlags_WidthStretch);
  for (std::size_t lane = 0; lane < view.link.session->labels.size(); ++lane)
    draw_renderer(view, state, link, lane);
  ImGui::EndTable();
  draw_beside(view);
  const device::MixedFrame* mixed = view.now != nullptr ? &view.now->mixed : nullptr;
  if (mixed != nullptr && mixed->state == device::MixState::kWaiting)
    words(kWarm, mixed->lift_off ? "lift off: the switch waits for free space" : "the switch waits");
  if (mixed != nullptr && mixed->state == device::MixState::kFading) words(kWarm, "fading");
}

void draw_buttons(const PanelView& view, PanelState& state, SessionLink& link, PanelWishes& wishes) {
  if (!view.link.session) return;
  const bool recorded = view.link.session->recorded;
  if (button(state, "Next")) link.request({Kind::kNext, device::SwitchSource::kProgram, 0});
  ImGui::SameLine();
  if (button(state, "Cancel")) link.request({Kind::kCancel, device::SwitchSource::kProgram, 0});
  ImGui::SameLine();
  if (button(state, "Re-arm")) link.rearm();
  ImGui::SameLine();
  if (button(state, recorded ? "Stop recording" : "Record")) wishes.record = true;
  ImGui::SetNextItemWidth(-70.0f);
  const bool entered = ImGui::InputTextWithHint("##mark", "a remark", state.mark.data(), state.mark.size(),
                                                ImGuiInputTextFlags_EnterReturnsTrue);
  (void)at_place(state, "remark", ImGui::IsItemActivated());
  ImGui::SameLine();
  if (button(state, "Mark", {-1.0f, 0.0f}) || entered) {
    link.mark(state.mark[0] != '\0' ? state.mark.data() : "mark");
    if (view.now != nullptr) state.marks_s.push_back(view.now->tick.t_s);
  }
  ImGui::SetNextItemWidth(-70.0f);
  const bool changed =
      ImGui::InputTextWithHint("##change", view.link.session->felt_options.c_str(), state.change.data(),
                               state.change.size(), ImGuiInputTextFlags_EnterReturnsTrue);
  (void)at_place(state, "change to", ImGui::IsItemActivated());
  ImGui::SameLine();
  if ((button(state, "Change", {-1.0f, 0.0f}) || changed) && state.change[0] != '\0')
    link.change(state.change.data());
}

/// Share of a plot's full height in a window of this height.
float plot_share(float height, std::size_t renderers) {
  const float rows = renderers > 2 ? static_cast<float>(renderers - 2) : 0.0f;
  const float left = height - kBesidePlots - kRendererRow * rows;
  return std::clamp(left / (kForcePlot + kTimePlot + kHistogramPlot), kLeastPlotShare, 1.0f);
}

void draw_plots(const PanelView& view, const PanelState& state, float height) {
  if (!view.link.session) return;
  const double limit_n = view.link.session->force_limit_n;
  const float share = plot_share(height, view.link.session->labels.size());
  heading(fmt::format("Force, last {:g} s; limit {:.3g} N", History::kSeconds, limit_n).c_str());
  plot_force(view.history, limit_n, state.marks_s, std::floor(share * kForcePlot));
  heading(fmt::format("Frame time: mean {:.2f}, worst {:.1f} µs", view.history.mean_step_us(),
                      view.history.worst_step_us())
              .c_str());
  plot_frame_times(view.history, std::floor(share * kTimePlot));
  ImGui::Spacing();
  plot_histogram(view.history.frame_times(), std::floor(share * kHistogramPlot));
  if (view.samples_lost > 0)
    words(kQuiet, fmt::format("{} samples came while the window stood still", view.samples_lost));
}

/// Draws the colours from low to high with the end values.
void draw_scale(const ColourScale& scale, ColourBy by) {
  ImDrawList* const onto = ImGui::GetWindowDrawList();
  const ImVec2 low = ImGui::GetCursorScreenPos();
  const float wide = ImGui::GetContentRegionAvail().x, step = wide / static_cast<float>(kScaleSteps);
  for (int i = 0; i < kScaleSteps; ++i) {
    const double share = (i + 0.5) / kScaleSteps;
    const Rgba ink = by == ColourBy::kError ? two_sided(2.0 * share - 1.0) : ramp(share);
    const float x = low.x + static_cast<float>(i) * step;
    onto->AddRectFilled({x, low.y}, {x + step, low.y + kScaleHeight}, IM_COL32(ink[0], ink[1], ink[2], 255));
  }
  ImGui::Dummy({wide, kScaleHeight});
  const std::string from = fmt::format("{:.4g} {}", scale.low, scale.unit),
                    to = fmt::format("{:.4g} {}", scale.high, scale.unit);
  ImGui::TextColored(kQuiet, "%s", from.c_str());
  ImGui::SameLine(ImGui::GetCursorPosX() + wide - ImGui::CalcTextSize(to.c_str()).x);
  ImGui::TextColored(kQuiet, "%s", to.c_str());
}

/// Drawing speed and progress of the picture.
std::string progress_of_picture(const PanelView& view) {
  const SplatDrawer& splats = view.scene.splats();
  std::string text = fmt::format("{:.0f} pictures/s", view.frames_a_second);
  if (splats.whole_after() > 0)
    text += fmt::format(" · all points after {} picture{}", splats.whole_after(),
                        splats.whole_after() > 1 ? "s" : "");
  else if (splats.points() > 0)
    text += fmt::format(" · {:.0f} % of the points",
                        100.0 * static_cast<double>(splats.drawn()) / static_cast<double>(splats.points()));
  if (*view.scene.awaited() != '\0') text += std::string(" · ") + view.scene.awaited();
  return text;
}

void draw_choices(const PanelView& view, PanelState& state, PanelWishes& wishes) {
  heading("Picture");
  ImGui::SetNextItemWidth(130.0f);
  if (ImGui::BeginCombo("colour", colour_name(view.scene.coloured()))) {
    for (const ColourBy by : kColours)
      if (ImGui::Selectable(colour_name(by), by == view.scene.coloured())) view.scene.colour(by);
    ImGui::EndCombo();
  }
  ImGui::SameLine();
  box(state, "shaded", state.lit);
  ImGui::SameLine();
  box(state, "workspace", state.workspace);
  const ColourScale& scale = view.scene.scale();
  if (!scale.nothing.empty())
    words(kWarm, "no " + std::string(colour_name(view.scene.coloured())) + ": " + scale.nothing);
  else if (scale.low != scale.high)
    draw_scale(scale, view.scene.coloured());
  else if (view.scene.coloured() != ColourBy::kPlain && scale.high != 0.0)
    words(kQuiet, fmt::format("{:.4g} {} everywhere", scale.high, scale.unit));
  box(state, "neighbours", state.near.neighbours);
  ImGui::SameLine();
  box(state, "boxes", state.near.boxes);
  ImGui::SameLine();
  box(state, "facets", state.near.facets);
  ImGui::SameLine();
  box(state, "cells", state.near.cells);
  if (button(state, "Screenshot")) wishes.screenshot = true;
  ImGui::SameLine();
  box(state, "export frames", state.export_frames);
  ImGui::SameLine();
  box(state, "sound", state.sound);
  ImGui::SameLine();
  ImGui::SetNextItemWidth(52.0f);
  if (ImGui::BeginCombo("up", up_name(view.camera.up_axis()))) {
    for (const Up up : kUps)
      if (ImGui::Selectable(up_name(up), up == view.camera.up_axis())) view.camera.set_up(up);
    ImGui::EndCombo();
  }
  words(kQuiet, progress_of_picture(view));
}

}  // namespace

PanelWishes draw_panel(const PanelView& view, PanelState& state, SessionLink& link, float left, float width,
                       float height) {
  PanelWishes wishes;
  state.place_of.clear();
  state.right = 0.0;
  ImGui::SetNextWindowPos({left, 0.0f});
  ImGui::SetNextWindowSize({width, height});
  ImGui::Begin("panel", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus);
  draw_state(view);
  draw_renderers(view, state, link);
  draw_buttons(view, state, link, wishes);
  if (!view.link.answer.empty()) words(kWarm, view.link.answer);
  draw_plots(view, state, height);
  draw_choices(view, state, wishes);
  if (!state.message.empty()) words(kGood, state.message);
  if (view.link.session && view.link.session->hand)
    words(kQuiet,
          fmt::format("Move: hover. Left: press {:.1f} mm deep, wheel: deeper. Right: turn. Middle: shift. "
                      "Wheel: zoom. Drop a scan to open it.",
                      view.press_mm));
  state.bottom = static_cast<double>(ImGui::GetCursorScreenPos().y);
  ImGui::End();
  return wishes;
}

void draw_fault(const WatchedTick& now, SessionLink& link, float width) {
  if (now.tick.fault == device::Fault::kNone) return;
  ImGui::PushStyleColor(ImGuiCol_WindowBg, ImVec4{0.50f, 0.08f, 0.08f, 0.95f});
  ImGui::SetNextWindowPos({0.0f, 0.0f});
  ImGui::SetNextWindowSize({width, 0.0f});
  ImGui::Begin("fault", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings);
  ImGui::PushFont(large_font());
  ImGui::TextWrapped("No force: %s", device::fault_name(now.tick.fault));
  ImGui::PopFont();
  ImGui::TextWrapped("%s", fault_remedy(now.tick.fault));
  if (ImGui::Button("Re-arm: force comes back softly")) link.rearm();
  ImGui::End();
  ImGui::PopStyleColor();
}

void draw_preparation(const SessionLink::View& link, float width, float height) {
  if (link.session || link.phase.empty()) return;
  const float wide = std::min(420.0f, 0.9f * width);
  ImGui::SetNextWindowPos({0.5f * (width - wide), 0.45f * height});
  ImGui::SetNextWindowSize({wide, 0.0f});
  ImGui::Begin("preparation", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoInputs);
  ImGui::TextWrapped("%s", link.phase.c_str());
  if (link.fraction >= 0.0)
    ImGui::ProgressBar(static_cast<float>(std::min(1.0, link.fraction)), {-1.0f, 0.0f});
  ImGui::End();
}

void draw_homing(const std::string& prompt, float width, float height) {
  if (prompt.empty()) return;
  const std::string head = "No force yet: the device has to find its zero.", text = prompt + ".";
  ImFont* const font = large_font();
  const float letters = font->FontSize, wide = std::min(kHomingWide, width - 2.0f * kHomingEdge),
              inner = wide - 2.0f * kHomingEdge;
  const auto high_of = [&](const std::string& of) {
    return font->CalcTextSizeA(letters, std::numeric_limits<float>::max(), inner, of.c_str()).y;
  };
  const float head_high = high_of(head), high = head_high + high_of(text) + 3.0f * kHomingEdge;
  const ImVec2 low = {std::round(0.5f * (width - wide)), std::round(std::max(0.0f, 0.5f * (height - high)))};
  const ImU32 paper = IM_COL32(kHomingPaper[0], kHomingPaper[1], kHomingPaper[2], 255);
  // ImGui draws the foreground last: no banner or window covers it.
  ImDrawList* const onto = ImGui::GetForegroundDrawList();
  onto->AddRectFilled(low, {low.x + wide, low.y + high}, paper, 6.0f);
  onto->AddRect(low, {low.x + wide, low.y + high}, IM_COL32_WHITE, 6.0f, 0, 2.0f);
  const auto write = [&](float below, const std::string& what) {
    onto->AddText(font, letters, {low.x + kHomingEdge, low.y + below}, IM_COL32_WHITE, what.c_str(), nullptr,
                  inner);
  };
  write(kHomingEdge, head);
  write(2.0f * kHomingEdge + head_high, text);
}

const char* fault_remedy(device::Fault fault) noexcept {
  using device::Fault;
  switch (fault) {
    case Fault::kNone:
      return "";
    case Fault::kNonFiniteForce:
      return "The renderer answered what is no number. Switch to another one, then re-arm; `palpate test "
             "hunt` "
             "finds the case.";
    case Fault::kNonFinitePosition:
    case Fault::kGarbled:
      return "Look at the cable and the connector, and at `palpate list devices --doctor`; then re-arm.";
    case Fault::kJump:
      return "Hold the device still, look at its cable, then re-arm.";
    case Fault::kSilence:
    case Fault::kLost:
      return "Plug the device in again and wait until it is found, then re-arm.";
    case Fault::kHomingLost:
      return "Home the device as its page says, then re-arm.";
    case Fault::kLate:
    case Fault::kStalled:
      return "The machine was busy elsewhere: close what computes, allow real-time scheduling "
             "(docs/how-to/connect-a-device.md), then re-arm.";
    case Fault::kClock:
      return "The clock was set while the loop ran: re-arm.";
    case Fault::kOutOfRange:
      return "The governor's own check failed: end the session and keep the recording.";
  }
  return "Re-arm.";
}

}  // namespace palpate::experiments
