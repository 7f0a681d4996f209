// The first screen: one picture and four numbers a renderer, before any prose.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "experiments/report/page.h"

namespace palpate::experiments {
namespace {

using R = metrics::RendererResult;
using Maybe = std::optional<double>;

constexpr double kOpeningWidth = 540.0, kOpeningHeight = 330.0;
constexpr double kLeft = 62.0, kRight = 16.0, kTop = 26.0, kBottom = 46.0;
constexpr double kDot = 9.0;           // radius: two digits fit
constexpr double kZeroBand = 30.0;     // below the axis, for what is exact
constexpr double kRoomDecades = 0.15;  // beyond the outermost values

struct Number {
  std::string main, more;
  bool bad = false;
};

bool finite(const Maybe& v) {
  return v && std::isfinite(*v);
}

/// What a hand feels as plainly wrong.
std::uint64_t moments(const metrics::Accuracy& a) {
  return a.caught.value_or(0) + a.lost.value_or(0) + a.kicks.value_or(0);
}

/// The same, frames of wrong contact, and surfaces passed through.
std::uint64_t contact_faults(const metrics::Accuracy& a) {
  return a.missed_contact_frames + a.false_contact_frames + a.pop_throughs.value_or(0) +
         a.fall_throughs.value_or(0) + moments(a);
}

/// Too little of the contact is felt at all, whatever the tolerances of the faults.
bool feels_too_little(const metrics::Accuracy& a) {
  return a.felt_percent.value_or(metrics::kRightSharePercent) < metrics::kRightSharePercent;
}

std::string faults_text(const metrics::Accuracy& a) {
  const std::uint64_t wrong = a.missed_contact_frames + a.false_contact_frames,
                      pops = a.pop_throughs.value_or(0) + a.fall_throughs.value_or(0);
  std::string text;
  const auto add = [&](std::uint64_t count, const char* what) {
    if (count > 0) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count_text(count), what);
  };
  add(a.caught.value_or(0), "× caught");
  add(a.lost.value_or(0), "× lost");
  add(a.kicks.value_or(0), a.kicks == 1 ? "kick" : "kicks");
  add(wrong, wrong == 1 ? "frame of wrong contact" : "frames of wrong contact");
  if (pops > 0)
    text += fmt::format("{}through the surface {} time{}", text.empty() ? "" : ", ", count_text(pops),
                        pops == 1 ? "" : "s");
  if (feels_too_little(a))
    text += fmt::format("{}{} % of it felt", text.empty() ? "contact wrong: " : ", ",
                        short_number(a.felt_percent));
  return text;
}

Maybe error_percent(const R& r) {
  return settled_score(r, &metrics::Accuracy::force_rms_percent);
}
/// All frames count, where they are known: free ones are where boxes are searched.
const std::optional<trace::FrameStatistics>& frames_of(const R& r) {
  return r.frame_all ? r.frame_all : r.frame;
}
Maybe opening_mean_us(const R& r) {
  return frames_of(r) ? frames_of(r)->mean_us : std::nullopt;
}

Number right_of(const R& r) {
  if (!r.accuracy) return {kNoNumber, "no ground truth"};
  const bool wrong = contact_faults(*r.accuracy) > 0 || feels_too_little(*r.accuracy);
  const std::string contact = wrong ? faults_text(*r.accuracy) : "contact right";
  const Maybe percent = error_percent(r);
  if (!percent) return {wrong ? "no" : "contact right", wrong ? contact : "forces are not compared", wrong};
  return {*percent == 0.0 ? "exact" : short_number(*percent) + " % off", contact, wrong};
}

Number fast_of(const R& r) {
  if (!finite(opening_mean_us(r))) return {kNoNumber, "no frames"};
  std::string more;
  if (r.frame && finite(r.frame->mean_us)) more = "in contact " + short_number(*r.frame->mean_us) + " µs";
  if (finite(frames_of(r)->p999_us))
    more += fmt::format("{}99.9 %: {} µs", more.empty() ? "" : ", ", short_number(*frames_of(r)->p999_us));
  return {short_number(*opening_mean_us(r)) + " µs", more};
}

Number ready_of(const R& r) {
  if (!r.prepare) return {kNoNumber, ""};
  return {duration_text(r.prepare->total_ms), prepared_from_cache(r) ? "from the cache: of another day" : ""};
}

Number large_of(const R& r) {
  if (!r.prepare) return {kNoNumber, ""};
  const auto bytes = static_cast<double>(r.prepare->bytes);
  return {bytes_text(bytes),
          r.model && r.model->points > 0
              ? short_number(bytes / static_cast<double>(r.model->points)) + " bytes a point"
              : ""};
}

/// What a renderer is, in a word or two.
std::string role_text(const R& r) {
  switch (r.role) {
    case render::Role::kOurs:
      return "ours";
    case render::Role::kLiteral:
      return "as printed";
    case render::Role::kRival:
      return r.works_on == render::Geometry::kMesh ? "rival, on a mesh" : "rival";
    case render::Role::kReference:
      return "ground truth";
    case render::Role::kOracle:
      return "oracle of tests";
  }
  return {};
}

std::string missing_text(const R& r) {
  std::string text;
  for (const std::string& what : r.missing) text += (text.empty() ? "; without " : ", ") + what;
  return text;
}

// ---- the picture

/// What stands upward in the picture.
struct Upward {
  std::string label, nothing;  ///< the axis; what 0 is called
  Maybe (*value)(const R&);
};

Upward upward_of(const metrics::ResultDocument& document) {
  const auto any = [&](Maybe (*value)(const R&)) {
    return std::any_of(document.renderers.begin(), document.renderers.end(),
                       [&](const R& r) { return finite(value(r)); });
  };
  if (any(&error_percent)) return {"force error, %", "exact", &error_percent};
  const auto faults = +[](const R& r) {
    return r.accuracy ? Maybe(static_cast<double>(contact_faults(*r.accuracy))) : std::nullopt;
  };
  if (any(faults)) return {"frames of wrong contact", "none", faults};
  return {"preparation, ms", "none",
          +[](const R& r) { return r.prepare ? Maybe(r.prepare->total_ms) : std::nullopt; }};
}

/// A logarithmic axis from `at_low` to `at_high`, in units of the picture.
struct Axis {
  double low = -1.0, high = 1.0;  ///< powers of ten
  double at_low = 0.0, at_high = 1.0;

  [[nodiscard]] double at(double value) const {
    return at_low + (at_high - at_low) * (std::log10(value) - low) / (high - low);
  }
};

Axis axis_over(const std::vector<double>& values, double at_low, double at_high) {
  Axis axis{0.0, 0.0, at_low, at_high};
  bool any = false;
  for (const double v : values) {
    if (!(v > 0.0)) continue;
    const double power = std::log10(v);
    axis.low = any ? std::min(axis.low, power) : power;
    axis.high = any ? std::max(axis.high, power) : power;
    any = true;
  }
  axis.low -= kRoomDecades;
  axis.high += kRoomDecades;
  // At least one power of ten is in it, and written: the nearer one.
  if (std::ceil(axis.low) <= axis.high) return axis;
  const double below = std::floor(axis.low), above = std::ceil(axis.high);
  if (axis.low - below < above - axis.high)
    axis.low = below;
  else
    axis.high = above;
  return axis;
}

struct Dot {
  std::size_t renderer;
  double x, y;                ///< where it belongs
  double at_x = 0, at_y = 0;  ///< where it is drawn, beside others
};

/// Dots that would cover others move to the right, and keep a line to their place.
void spread(std::vector<Dot>& dots) {
  constexpr double kApart = 2.0 * kDot;
  for (std::size_t i = 0; i < dots.size(); ++i) {
    Dot& dot = dots[i];
    dot.at_x = dot.x;
    dot.at_y = dot.y;
    const auto covered = [&] {
      return std::any_of(dots.begin(), dots.begin() + static_cast<std::ptrdiff_t>(i), [&](const Dot& other) {
        return std::hypot(other.at_x - dot.at_x, other.at_y - dot.at_y) < kApart;
      });
    };
    while (covered() && dot.at_x + kApart < kOpeningWidth - kRight) dot.at_x += kApart;
    if (!covered()) continue;
    dot.at_x = dot.x;
    while (covered() && dot.at_x - kApart > kLeft) dot.at_x -= kApart;
  }
}

std::string line(double x1, double y1, double x2, double y2, const char* kind) {
  return fmt::format("<line class=\"{}\" x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\"/>", kind, x1,
                     y1, x2, y2);
}

std::string word(double x, double y, const char* anchor, const std::string& text) {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text>", x, y, anchor,
                     html_escaped(text));
}

std::string axes_svg(const Axis& across, const Axis& upward, const Upward& what, bool zero_band) {
  std::string svg;
  const double floor = kOpeningHeight - kBottom;
  constexpr double kTen = 10.0;
  for (int power = static_cast<int>(std::ceil(across.low)); power <= across.high; ++power) {
    const double x = across.at(std::pow(kTen, power));
    svg += line(x, kTop, x, floor, "grid") +
           word(x, floor + 16, "middle", fmt::format("{:g}", std::pow(kTen, power)));
  }
  for (int power = static_cast<int>(std::ceil(upward.low)); power <= upward.high; ++power) {
    const double y = upward.at(std::pow(kTen, power));
    svg += line(kLeft, y, kOpeningWidth - kRight, y, "grid") +
           word(kLeft - 7, y + 4, "end", fmt::format("{:g}", std::pow(kTen, power)));
  }
  if (zero_band) svg += word(kLeft - 7, floor - kZeroBand / 2 + 4, "end", what.nothing);
  svg += line(kLeft, kTop, kLeft, floor, "axis") + line(kLeft, floor, kOpeningWidth - kRight, floor, "axis");
  svg += word((kLeft + kOpeningWidth - kRight) / 2, kOpeningHeight - 8, "middle",
              "mean of all frames, µs; from free to contact ○, 99.9 % | (left is faster)");
  return svg + word(4, 14, "start", what.label + " (low is better)");
}

/// Free, contact and the slowest thousandth of all frames: what the dot's place is a mean of.
std::array<Maybe, 3> times_beside(const R& r) {
  const auto mean = [](const std::optional<trace::FrameStatistics>& s) {
    return s ? s->mean_us : std::nullopt;
  };
  return {mean(r.frame_free), mean(r.frame), r.frame_all ? r.frame_all->p999_us : std::nullopt};
}

/// A line from the fastest to the slowest of them, a ring where contact is, a stroke where 99.9 % is.
std::string span_svg(const R& r, const Axis& across, double y, const std::string& colour) {
  constexpr double kRing = 4.0, kStroke = 6.0;
  const std::array<Maybe, 3> beside = times_beside(r);
  double low = *opening_mean_us(r), high = low;
  for (const Maybe& v : beside) {
    if (!finite(v) || !(*v > 0.0)) continue;
    low = std::min(low, *v);
    high = std::max(high, *v);
  }
  if (!(low < high)) return {};
  std::string svg =
      fmt::format("<g stroke=\"{}\" fill=\"none\" stroke-opacity=\"0.6\"><path d=\"M{:.1f} {:.1f}H{:.1f}",
                  colour, across.at(low), y, across.at(high));
  if (const Maybe& tail = beside[2]; finite(tail) && *tail > 0.0)
    svg += fmt::format("M{:.1f} {:.1f}v{:.1f}", across.at(*tail), y - kStroke, 2.0 * kStroke);
  svg += "\"/>";
  if (const Maybe& contact = beside[1]; finite(contact) && *contact > 0.0)
    svg += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{:g}\"/>", across.at(*contact), y, kRing);
  return svg + "</g>";
}

std::string picture(const metrics::ResultDocument& document, const std::vector<Look>& looks) {
  const Upward what = upward_of(document);
  std::vector<Dot> dots;
  std::vector<double> times, values;
  bool zero = false;
  for (std::size_t i = 0; i < document.renderers.size(); ++i) {
    const R& r = document.renderers[i];
    const Maybe time = opening_mean_us(r), value = what.value(r);
    if (!finite(time) || !(*time > 0.0) || !finite(value)) continue;
    dots.push_back({i, *time, *value});
    times.push_back(*time);
    for (const Maybe& other : times_beside(r))
      if (finite(other) && *other > 0.0) times.push_back(*other);
    values.push_back(*value);
    zero = zero || !(*value > 0.0);
  }
  if (dots.empty()) return {};
  const double floor = kOpeningHeight - kBottom;
  const Axis across = axis_over(times, kLeft + kDot, kOpeningWidth - kRight - kDot),
             upward = axis_over(values, floor - (zero ? kZeroBand : kDot), kTop + kDot);
  std::string spans;
  for (Dot& dot : dots) {
    const double y = dot.y > 0.0 ? upward.at(dot.y) : floor - kZeroBand / 2;
    spans += span_svg(document.renderers[dot.renderer], across, y, looks[dot.renderer].colour);
    dot.x = across.at(dot.x);
    dot.y = dot.y > 0.0 ? upward.at(dot.y) : floor - kZeroBand / 2;
  }
  spread(dots);
  std::string svg = fmt::format("<svg class=\"trade\" viewBox=\"0 0 {:g} {:g}\" role=\"img\">{}",
                                kOpeningWidth, kOpeningHeight, axes_svg(across, upward, what, zero) + spans);
  for (const Dot& dot : dots) {
    const R& r = document.renderers[dot.renderer];
    if (dot.at_x != dot.x) svg += line(dot.x, dot.y, dot.at_x, dot.at_y, "axis");
    svg += fmt::format(
        "<g><title>{}</title><circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{:g}\" fill=\"{}\"{}/><text "
        "class=\"in\" "
        "x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\">{}</text></g>",
        html_escaped(r.label), dot.at_x, dot.at_y, kDot, looks[dot.renderer].colour,
        competes(r) ? "" : " fill-opacity=\"0.45\"", dot.at_x, dot.at_y + 4, dot.renderer + 1);
  }
  return svg + "</svg>\n";
}

// ---- the numbers

/// Which of those that compete is the lowest; nothing where fewer than two have a value.
template <class Of>
std::optional<double> best_of(const metrics::ResultDocument& document, const Of& value) {
  std::optional<double> best;
  std::size_t count = 0;
  for (const R& r : document.renderers) {
    const Maybe own = value(r);
    if (!competes(r) || !finite(own)) continue;
    ++count;
    best = best ? std::min(*best, *own) : own;
  }
  return count > 1 ? best : std::nullopt;
}

std::string cell(const Number& number, bool best) {
  std::string kind = number.bad ? "bad" : best ? "best" : "";
  return fmt::format("<td{}><b>{}</b>{}</td>", kind.empty() ? "" : " class=\"" + kind + "\"",
                     html_escaped(number.main),
                     number.more.empty() ? "" : "<small>" + html_escaped(number.more) + "</small>");
}

std::string row(const metrics::ResultDocument& document, std::size_t i, const Look& look) {
  const R& r = document.renderers[i];
  std::string html = fmt::format(
      "<tr><th scope=\"row\"><span class=\"dot\" style=\"background:{}\">{}</span>{}<small>{}</small></th>",
      look.colour, i + 1, html_escaped(r.label), html_escaped(role_text(r) + missing_text(r)));
  if (r.status != metrics::RunStatus::kOk)
    return html + fmt::format("<td class=\"bad\" colspan=\"4\"><b>{}</b><small>{}</small></td></tr>\n",
                              r.status == metrics::RunStatus::kFailed ? "failed" : "did not finish",
                              html_escaped(r.reason));
  const auto is_best = [&](const auto& value) {
    const std::optional<double> best = best_of(document, value);
    return best && competes(r) && finite(value(r)) && *value(r) <= *best;
  };
  const auto prepare = [](const R& x) {
    return x.prepare && !prepared_from_cache(x) ? Maybe(x.prepare->total_ms) : std::nullopt;
  };
  const auto bytes = [](const R& x) {
    return x.prepare ? Maybe(static_cast<double>(x.prepare->bytes)) : std::nullopt;
  };
  return html + cell(right_of(r), is_best(&error_percent)) + cell(fast_of(r), is_best(&opening_mean_us)) +
         cell(ready_of(r), is_best(prepare)) + cell(large_of(r), is_best(bytes)) + "</tr>\n";
}

}  // namespace

std::string opening_html(const metrics::ResultDocument& document) {
  if (document.renderers.empty()) return {};
  std::vector<std::string> labels;
  for (const R& r : document.renderers) labels.push_back(r.label);
  const std::vector<Look> looks = looks_of(labels);
  const std::string drawn = picture(document, looks);
  std::string html = fmt::format("<div class=\"opening{}\">\n{}", drawn.empty() ? " alone" : "",
                                 drawn.empty() ? "" : "<div class=\"picture\">" + drawn + "</div>\n");
  html +=
      "<table class=\"four\"><thead><tr><th></th><th>Right?<small>force error, contact</small></th>"
      "<th>Fast?<small>mean of all frames, 99.9 %</small></th><th>Ready when?<small>preparation</small></th>"
      "<th>How large?<small>memory</small></th></tr></thead>\n<tbody>\n";
  for (std::size_t i = 0; i < document.renderers.size(); ++i) html += row(document, i, looks[i]);
  return html + "</tbody></table>\n</div>\n";
}

}  // namespace palpate::experiments
