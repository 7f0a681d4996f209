#include "experiments/window/panel.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>

namespace palpate::experiments {
namespace {

using Kind = device::SwitchRequest::Kind;

const ImVec4 kGood = {0.47f, 0.86f, 0.55f, 1.0f}, kQuiet = {0.60f, 0.65f, 0.72f, 1.0f},
             kWarm = {1.0f, 0.78f, 0.25f, 1.0f}, kBad = {1.0f, 0.45f, 0.40f, 1.0f};
constexpr float kForcePlot = 92.0f, kTimePlot = 92.0f, kHistogramPlot = 64.0f;
constexpr double kUsPerNsShown = 1e-3;

void words(const ImVec4& colour, const std::string& text) {
  ImGui::PushStyleColor(ImGuiCol_Text, colour);
  ImGui::TextWrapped("%s", text.c_str());
  ImGui::PopStyleColor();
}

void heading(const char* text) {
  ImGui::Spacing();
  ImGui::TextColored(kQuiet, "%s", text);
  ImGui::Separator();
}

void draw_state(const PanelView& view) {
  const ShownScene* scene = view.scene.scene();
  if (scene != nullptr)
    words(kQuiet, fmt::format("{} · {} points", scene->name, view.scene.splats().points()));
  if (view.now == nullptr || view.now->ticks == 0) {
    words(kQuiet, view.link.session ? "the servo begins" : "not touchable yet");
    return;
  }
  const device::Tick& tick = view.now->tick;
  const bool faulted = tick.fault != device::Fault::kNone;
  ImGui::SetWindowFontScale(1.7f);
  words(faulted              ? kBad
        : tick.frame.contact ? kGood
                             : kQuiet,
        fmt::format("{:>6.3f} N  {}", tick.sent_n.norm(),
                    faulted              ? "fault"
                    : tick.frame.contact ? "touching"
                                         : "free"));
  ImGui::SetWindowFontScale(1.0f);
  const double depth_mm = tick.frame.contact ? (tick.frame.god_object_mm - tick.hip_mm).norm() : 0.0;
  words(kQuiet,
        fmt::format("HIP {:.2f} {:.2f} {:.2f} mm\n{} · {:.3f} mm deep", tick.hip_mm.x(), tick.hip_mm.y(),
                    tick.hip_mm.z(), view.link.session ? view.link.session->device : "", depth_mm));
}

/// Who stands in a lane now: while one replaces another there are two, and the felt one speaks.
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

void draw_renderer(const PanelView& view, SessionLink& link, std::size_t lane) {
  const ShownSession& session = *view.link.session;
  bool felt = false;
  const device::TrackedFrame* one = view.now != nullptr ? in_lane(view.now->mixed, lane, felt) : nullptr;
  ImGui::PushID(static_cast<int>(lane));
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  if (felt) ImGui::PushStyleColor(ImGuiCol_Button, ImVec4{0.20f, 0.45f, 0.28f, 1.0f});
  const std::string label = fmt::format("{} {}", lane + 1, session.labels[lane]);
  if (ImGui::Button(label.c_str(), {-1.0f, 0.0f}))
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
    ImGui::TextColored(out                  ? kBad
                       : one->frame.contact ? kGood
                                            : kQuiet,
                       "%s",
                       out                  ? "out"
                       : one->frame.contact ? "touches"
                                            : "free");
    if (out && ImGui::IsItemHovered()) ImGui::SetTooltip("%s", device::disqualified_text(one->disqualified));
  }
  ImGui::PopID();
}

void draw_renderers(const PanelView& view, SessionLink& link) {
  if (!view.link.session) return;
  heading("Renderers: force now (N), last frame (us)");
  if (!ImGui::BeginTable("renderers", 4, ImGuiTableFlags_SizingFixedFit)) return;
  ImGui::TableSetupColumn("who", ImGuiTableColumnFlags_WidthStretch);
  for (std::size_t lane = 0; lane < view.link.session->labels.size(); ++lane) draw_renderer(view, link, lane);
  ImGui::EndTable();
  const device::MixedFrame* mixed = view.now != nullptr ? &view.now->mixed : nullptr;
  if (mixed != nullptr && mixed->state == device::MixState::kWaiting)
    words(kWarm, mixed->lift_off ? "lift off: the switch waits for free space" : "the switch waits");
  if (mixed != nullptr && mixed->state == device::MixState::kFading) words(kWarm, "fading");
}

void draw_buttons(const PanelView& view, PanelState& state, SessionLink& link, PanelWishes& wishes) {
  if (!view.link.session) return;
  const bool recorded = view.link.session->recorded;
  if (ImGui::Button("Next")) link.request({Kind::kNext, device::SwitchSource::kProgram, 0});
  ImGui::SameLine();
  if (ImGui::Button("Cancel")) link.request({Kind::kCancel, device::SwitchSource::kProgram, 0});
  ImGui::SameLine();
  if (ImGui::Button("Re-arm")) link.rearm();
  ImGui::SameLine();
  if (ImGui::Button(recorded ? "Stop recording" : "Record")) wishes.record = true;
  ImGui::SetNextItemWidth(-70.0f);
  const bool entered = ImGui::InputTextWithHint("##mark", "a remark", state.mark.data(), state.mark.size(),
                                                ImGuiInputTextFlags_EnterReturnsTrue);
  ImGui::SameLine();
  if (ImGui::Button("Mark", {-1.0f, 0.0f}) || entered) {
    link.mark(state.mark[0] != '\0' ? state.mark.data() : "mark");
    if (view.now != nullptr) state.marks_s.push_back(view.now->tick.t_s);
  }
  ImGui::SetNextItemWidth(-70.0f);
  const bool changed =
      ImGui::InputTextWithHint("##change", view.link.session->felt_options.c_str(), state.change.data(),
                               state.change.size(), ImGuiInputTextFlags_EnterReturnsTrue);
  ImGui::SameLine();
  if ((ImGui::Button("Change", {-1.0f, 0.0f}) || changed) && state.change[0] != '\0')
    link.change(state.change.data());
}

void draw_plots(const PanelView& view, const PanelState& state) {
  if (!view.link.session) return;
  const double limit_n = view.link.session->force_limit_n;
  heading(fmt::format("Force, last {:g} s; limit {:.3g} N", History::kSeconds, limit_n).c_str());
  plot_force(view.history, limit_n, state.marks_s, kForcePlot);
  heading(fmt::format("Frame time: mean {:.2f}, worst {:.1f} us", view.history.mean_step_us(),
                      view.history.worst_step_us())
              .c_str());
  plot_frame_times(view.history, kTimePlot);
  ImGui::Spacing();
  plot_histogram(view.history.frame_times(), kHistogramPlot);
  if (view.samples_lost > 0)
    words(kQuiet, fmt::format("{} samples came while the window stood still", view.samples_lost));
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
  ImGui::Checkbox("shaded", &state.lit);
  ImGui::SameLine();
  ImGui::Checkbox("workspace", &state.workspace);
  const ColourScale& scale = view.scene.scale();
  if (!scale.nothing.empty())
    words(kWarm, "no " + std::string(colour_name(view.scene.coloured())) + ": " + scale.nothing);
  else if (scale.low != scale.high)
    words(kQuiet, fmt::format("{:.4g} to {:.4g} {}", scale.low, scale.high, scale.unit));
  else if (view.scene.coloured() != ColourBy::kPlain && scale.high != 0.0)
    words(kQuiet, fmt::format("{:.4g} {} everywhere", scale.high, scale.unit));
  ImGui::Checkbox("neighbours", &state.near.neighbours);
  ImGui::SameLine();
  ImGui::Checkbox("boxes", &state.near.boxes);
  ImGui::SameLine();
  ImGui::Checkbox("facets", &state.near.facets);
  if (ImGui::Button("Screenshot")) wishes.screenshot = true;
  ImGui::SameLine();
  ImGui::Checkbox("export frames", &state.export_frames);
  const SplatDrawer& splats = view.scene.splats();
  words(kQuiet, fmt::format("{:.0f} pictures/s · {:.0f} % of the points{}{}", view.frames_a_second,
                            splats.points() > 0 ? 100.0 * static_cast<double>(splats.drawn()) /
                                                      static_cast<double>(splats.points())
                                                : 0.0,
                            *view.scene.awaited() != '\0' ? " · " : "", view.scene.awaited()));
}

}  // namespace

PanelWishes draw_panel(const PanelView& view, PanelState& state, SessionLink& link, float left, float width,
                       float height) {
  PanelWishes wishes;
  ImGui::SetNextWindowPos({left, 0.0f});
  ImGui::SetNextWindowSize({width, height});
  ImGui::Begin("panel", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus);
  draw_state(view);
  draw_renderers(view, link);
  draw_buttons(view, state, link, wishes);
  if (!view.link.answer.empty()) words(kWarm, view.link.answer);
  draw_plots(view, state);
  draw_choices(view, state, wishes);
  if (!state.message.empty()) words(kGood, state.message);
  if (view.link.session && view.link.session->hand)
    words(kQuiet,
          fmt::format("Move: hover. Left: press {:.1f} mm deep, wheel: deeper. Right: turn. Middle: shift. "
                      "Wheel: zoom. Drop a scan to open it.",
                      view.press_mm));
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
  ImGui::SetWindowFontScale(1.3f);
  ImGui::Text("No force: %s", device::fault_name(now.tick.fault));
  ImGui::SetWindowFontScale(1.0f);
  ImGui::TextWrapped("%s", fault_remedy(now.tick.fault));
  if (ImGui::Button("Re-arm: force comes back softly")) link.rearm();
  ImGui::End();
  ImGui::PopStyleColor();
}

void draw_preparation(const SessionLink::View& link, float width, float height) {
  if (link.session || link.phase.empty()) return;
  constexpr float kWide = 420.0f;
  ImGui::SetNextWindowPos({0.5f * (width - kWide), 0.45f * height});
  ImGui::SetNextWindowSize({kWide, 0.0f});
  ImGui::Begin("preparation", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoInputs);
  ImGui::TextWrapped("%s", link.phase.c_str());
  if (link.fraction >= 0.0)
    ImGui::ProgressBar(static_cast<float>(std::min(1.0, link.fraction)), {-1.0f, 0.0f});
  ImGui::End();
}

const char* fault_remedy(device::Fault fault) noexcept {
  using device::Fault;
  switch (fault) {
    case Fault::kNone:
      return "";
    case Fault::kNonFiniteForce:
      return "The renderer answered what is no number. Switch to another one, then re-arm; `palpate hunt` "
             "finds the case.";
    case Fault::kNonFinitePosition:
    case Fault::kGarbled:
      return "Look at the cable and the connector, and at `palpate devices --doctor`; then re-arm.";
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
             "(docs/servo.md), then re-arm.";
    case Fault::kClock:
      return "The clock was set while the loop ran: re-arm.";
    case Fault::kOutOfRange:
      return "The governor's own check failed: end the session and keep the recording.";
  }
  return "Re-arm.";
}

}  // namespace palpate::experiments
