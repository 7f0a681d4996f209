#include "experiments/window/overlay.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "experiments/window/panel.h"

namespace palpate::experiments {
namespace {

constexpr float kLinePx = 2.0f, kArrowPx = 4.0f, kHeadPx = 15.0f;
constexpr float kHipPx = 8.0f, kGodObjectPx = 6.0f;
constexpr float kFacetSolid = 0.35f;
constexpr float kWholeByte = 255.0f;

ImU32 colour_of(const std::array<std::uint8_t, 3>& rgb, float solid) {
  return IM_COL32(rgb[0], rgb[1], rgb[2], static_cast<int>(solid * kWholeByte));
}

ImVec2 place_of(const Pixel& pixel) {
  return {static_cast<float>(pixel.x), static_cast<float>(pixel.y)};
}

}  // namespace

Overlay::Overlay(ImDrawList* onto, const Camera& camera, double width_px, double height_px)
    : onto_(onto),
      clip_from_world_(camera.clip_from_world(width_px, height_px)),
      width_px_(width_px),
      height_px_(height_px) {}

std::optional<Pixel> Overlay::seen(const Vec3& world_mm) const {
  if (!is_finite(world_mm)) return std::nullopt;
  return project(clip_from_world_, world_mm, width_px_, height_px_);
}

std::optional<SeenLine> Overlay::seen_line(const Vec3& a_mm, const Vec3& b_mm) const {
  if (!is_finite(a_mm) || !is_finite(b_mm)) return std::nullopt;
  return project_line(clip_from_world_, a_mm, b_mm, width_px_, height_px_);
}

void Overlay::line(const Vec3& a_mm, const Vec3& b_mm, const std::array<std::uint8_t, 3>& colour,
                   float thick_px, float solid) const {
  if (const std::optional<SeenLine> both = seen_line(a_mm, b_mm))
    onto_->AddLine(place_of(both->a), place_of(both->b), colour_of(colour, solid), thick_px);
}

void Overlay::box(const std::array<Vec3, 8>& corners_mm, const std::array<std::uint8_t, 3>& colour,
                  float thick_px, float solid) const {
  for (std::size_t k = 0; k < corners_mm.size(); ++k)
    for (const std::size_t bit : {std::size_t{1}, std::size_t{2}, std::size_t{4}})
      if ((k & bit) == 0) line(corners_mm[k], corners_mm[k | bit], colour, thick_px, solid);
}

void Overlay::ball(const Vec3& at_mm, const std::array<std::uint8_t, 3>& colour, float radius_px,
                   bool filled) const {
  const std::optional<Pixel> at = seen(at_mm);
  if (!at) return;
  if (filled) onto_->AddCircleFilled(place_of(*at), radius_px, colour_of(colour, 1.0f));
  onto_->AddCircle(place_of(*at), radius_px, filled ? IM_COL32(20, 20, 25, 255) : colour_of(colour, 1.0f), 0,
                   filled ? 1.0f : kLinePx);
}

void Overlay::arrow(const Vec3& from_mm, const Vec3& to_mm, const std::array<std::uint8_t, 3>& colour) const {
  const std::optional<SeenLine> both = seen_line(from_mm, to_mm);
  if (!both) return;
  const ImVec2 a = place_of(both->a), b = place_of(both->b);
  const float dx = b.x - a.x, dy = b.y - a.y, length = std::hypot(dx, dy);
  const ImU32 ink = colour_of(colour, 1.0f);
  if (length < 1.0f) {
    onto_->AddCircleFilled(b, kArrowPx, ink);
    return;
  }
  // The tip is beside or behind the eye: the shaft leaves the picture without a head.
  if (both->cut_b) {
    onto_->AddLine(a, b, ink, kArrowPx);
    return;
  }
  const float ux = dx / length, uy = dy / length, head = std::min(kHeadPx, 0.6f * length);
  const ImVec2 neck = {b.x - head * ux, b.y - head * uy};
  onto_->AddLine(a, neck, ink, kArrowPx);
  onto_->AddTriangleFilled(b, {neck.x - 0.45f * head * uy, neck.y + 0.45f * head * ux},
                           {neck.x + 0.45f * head * uy, neck.y - 0.45f * head * ux}, ink);
}

void Overlay::triangle(const std::array<Vec3, 3>& corners_mm,
                       const std::array<std::uint8_t, 3>& colour) const {
  const std::optional<Pixel> a = seen(corners_mm[0]), b = seen(corners_mm[1]), c = seen(corners_mm[2]);
  if (!a || !b || !c) return;
  onto_->AddTriangleFilled(place_of(*a), place_of(*b), place_of(*c), colour_of(colour, kFacetSolid));
  onto_->AddTriangle(place_of(*a), place_of(*b), place_of(*c), colour_of(colour, 1.0f), 1.5f);
}

void draw_contact(const Overlay& overlay, const WatchedTick& now, double force_limit_n, double radius_mm) {
  if (now.ticks == 0) return;
  const Vec3& hip_mm = now.tick.hip_mm;
  const render::Frame& frame = now.tick.frame;
  if (frame.contact) {
    overlay.line(hip_mm, frame.god_object_mm, kHipColour, kLinePx);
    // Shows the governor's force sent to the device, rotated into the world, not the renderer's.
    const Vec3 force_n = now.map.world_n(now.tick.sent_n);
    const double scale = force_limit_n > 0.0 ? kArrowAtLimit * radius_mm / force_limit_n : 0.0;
    overlay.arrow(frame.god_object_mm, frame.god_object_mm + scale * force_n, kForceColour);
    overlay.ball(frame.god_object_mm, kGodObjectColour, kGodObjectPx, true);
  }
  overlay.ball(hip_mm, kHipColour, kHipPx, false);
  overlay.ball(hip_mm, kHipColour, kHipPx / 2.5f, true);
}

// Plots of the panel by ImGui's draw lists.

namespace {

constexpr ImU32 kPlotPaper = IM_COL32(22, 26, 32, 255), kPlotEdge = IM_COL32(70, 78, 90, 255),
                kPlotText = IM_COL32(150, 160, 175, 255), kForceInk = IM_COL32(255, 200, 40, 255),
                kTimeInk = IM_COL32(110, 200, 255, 255), kLimitInk = IM_COL32(255, 90, 80, 255),
                kMarkInk = IM_COL32(200, 140, 255, 255), kLabelPaper = IM_COL32(22, 26, 32, 235);
constexpr float kLabelGap = 2.0f;
/// Range of frame times shown, and a 1 kHz period.
constexpr double kLeastUs = 0.1, kMostUs = 1e4, kPeriodUs = 1e3;
/// Smallest range of the force plot, as a share of the limit: keeps small forces from looking like noise.
constexpr double kLeastForceShare = 0.1;

struct PlotArea {
  ImDrawList* onto;
  ImVec2 low, high;  // upper left, lower right
  [[nodiscard]] float width() const { return high.x - low.x; }
  [[nodiscard]] float height() const { return high.y - low.y; }
  /// 0 at the bottom, 1 at the top.
  [[nodiscard]] float y(double share) const {
    return high.y - static_cast<float>(std::clamp(share, 0.0, 1.0)) * height();
  }
  /// Draws text with a background, readable over curves and bars.
  void text(float x, float at_y, const std::string& words) const {
    const ImVec2 size = ImGui::CalcTextSize(words.c_str());
    onto->AddRectFilled({x - 2.0f, at_y}, {x + size.x + 2.0f, at_y + size.y}, kLabelPaper);
    onto->AddText({x, at_y}, kPlotText, words.c_str());
  }
  /// Labels a level from just above, or from below if there is no room.
  void name_level(float x, double share, const std::string& words) const {
    const float line = y(share), above = line - kLabelGap - ImGui::GetFontSize();
    text(x, above >= low.y ? above : line + kLabelGap, words);
  }
};

PlotArea begin_plot(float height) {
  PlotArea area{};
  area.onto = ImGui::GetWindowDrawList();
  area.low = ImGui::GetCursorScreenPos();
  area.high = {area.low.x + ImGui::GetContentRegionAvail().x, area.low.y + height};
  area.onto->AddRectFilled(area.low, area.high, kPlotPaper);
  area.onto->AddRect(area.low, area.high, kPlotEdge);
  ImGui::Dummy({area.width(), height});
  return area;
}

void level_line(const PlotArea& area, double share, ImU32 ink) {
  // A filled rectangle on whole pixels; a line would blur over two rows.
  const float y = std::floor(area.y(share));
  area.onto->AddRectFilled({area.low.x, y}, {area.high.x, y + 1.0f}, ink);
}

/// Joins neighbouring columns that have values.
template <class Share>
void curve(const PlotArea& area, const std::vector<float>& columns, ImU32 ink, Share&& share) {
  float last_y = 0.0f;
  bool has_last = false;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const bool there = columns[i] >= 0.0f;
    const float x = area.low.x + static_cast<float>(i),
                y = there ? area.y(share(static_cast<double>(columns[i]))) : 0.0f;
    if (there && has_last) area.onto->AddLine({x - 1.0f, last_y}, {x, y}, ink, 1.5f);
    if (there && !has_last) area.onto->AddLine({x, y}, {x + 1.0f, y}, ink, 1.5f);
    last_y = y;
    has_last = there;
  }
}

double share_of_us(double us) {
  return std::log10(us / kLeastUs) / std::log10(kMostUs / kLeastUs);
}

}  // namespace

void plot_force(const History& history, double limit_n, const std::deque<double>& marks_s, float height) {
  const PlotArea area = begin_plot(height);
  const auto columns = history.columns(static_cast<std::size_t>(std::max(1.0f, area.width())),
                                       [](const TickSample& one) { return one.sent_n; });
  const double most = static_cast<double>(*std::max_element(columns.begin(), columns.end()));
  double top = std::max({1.15 * most, kLeastForceShare * limit_n, 1e-9});
  // The limit's line must stay below the top label.
  const double below_label =
      1.0 - static_cast<double>((ImGui::GetFontSize() + 3.0f * kLabelGap) / area.height());
  if (limit_n > 0.0 && limit_n <= top) top = std::max(top, limit_n / std::max(below_label, 0.1));
  if (limit_n > 0.0 && limit_n <= top) level_line(area, limit_n / top, kLimitInk);
  if (!history.samples().empty()) {
    const double end_s = history.samples().back().t_s;
    for (const double mark_s : marks_s) {
      const auto x = area.high.x - static_cast<float>((end_s - mark_s) / History::kSeconds) * area.width();
      if (x > area.low.x && x <= area.high.x)
        area.onto->AddLine({x, area.low.y}, {x, area.high.y}, kMarkInk, 1.0f);
    }
  }
  curve(area, columns, kForceInk, [&](double n) { return n / top; });
  area.text(area.low.x + 4.0f, area.low.y + kLabelGap, fmt::format("{:.3g} N", top));
}

void plot_frame_times(const History& history, float height) {
  const PlotArea area = begin_plot(height);
  for (double us = 1.0; us < kMostUs; us *= 10.0)
    level_line(area, share_of_us(us), us == kPeriodUs ? kLimitInk : kPlotEdge);
  const auto columns = history.columns(static_cast<std::size_t>(std::max(1.0f, area.width())),
                                       [](const TickSample& one) { return one.step_us; });
  curve(area, columns, kTimeInk, [](double us) { return share_of_us(std::max(us, kLeastUs)); });
  area.name_level(area.low.x + 4.0f, share_of_us(kPeriodUs), "1 ms");
  area.name_level(area.low.x + 4.0f, share_of_us(1.0), "1 µs");
}

void plot_histogram(const FrameTimeHistogram& histogram, float height) {
  const PlotArea area = begin_plot(height);
  const double most = std::log1p(static_cast<double>(histogram.most()));
  const float wide = area.width() / static_cast<float>(FrameTimeHistogram::kBins);
  for (std::size_t bin = 0; bin < FrameTimeHistogram::kBins; ++bin) {
    if (histogram.count[bin] == 0) continue;
    const float x = area.low.x + static_cast<float>(bin) * wide;
    const double share = std::log1p(static_cast<double>(histogram.count[bin])) / (1.1 * most);
    area.onto->AddRectFilled({x + 1.0f, area.y(share)}, {x + wide, area.high.y},
                             FrameTimeHistogram::low_us(bin) < kPeriodUs ? kTimeInk : kLimitInk);
  }
  const auto at = [&](double us) {
    return area.low.x + static_cast<float>(2.0 * std::log2(us / FrameTimeHistogram::kFirstUs)) * wide;
  };
  area.onto->AddLine({at(kPeriodUs), area.low.y}, {at(kPeriodUs), area.high.y}, kLimitInk, 1.0f);
  area.text(at(1.0), area.low.y + 2.0f, "1 µs");
  area.text(at(30.0), area.low.y + 2.0f, "30 µs");
  area.text(at(kPeriodUs) + 3.0f, area.low.y + 2.0f, "1 ms");
}

}  // namespace palpate::experiments
