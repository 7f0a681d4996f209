// What is drawn of a study. Series are thinned to what a page can show; the traces beside hold everything.
#include "experiments/report/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/report/tables.h"

namespace palpate::experiments {
namespace {

constexpr double kNsPerUs = 1e3;
constexpr std::size_t kTailPoints = 160;  // of a distribution
constexpr std::size_t kBins = 320;        // along a path: some two pixels each
constexpr std::size_t kExcerptFrames =
    1300;                                 // one entry and exit of the weave (900 frames) with what is around
constexpr std::size_t kMapPoints = 1200;  // of each kind on one map
constexpr double kErrorFloorN = 1e-6;     // below any force a device can show: keeps a logarithm finite

Chart begin(const std::string& prefix, const std::string& name, std::string title, std::string caption) {
  Chart chart;
  chart.name = prefix + "-" + name;
  chart.title = std::move(title);
  chart.caption = std::move(caption);
  return chart;
}

Series series_of(const Study& study, std::size_t i) {
  const std::string& label = study.runs[i].result.label;
  return {label, colour_of(label, i), {}, {}};
}

/// Share of contact frames that take longer than x, both axes logarithmic: the tail is what a hand feels.
Chart frame_times(const Study& study, const std::string& prefix) {
  Chart chart = begin(prefix, "frame-times", "Frame times",
                      "Share of contact frames that took longer than the time on the x axis, back to back, "
                      "the clock's own cost included. "
                      "Further left is faster; a steep fall is steadier.");
  chart.x_label = "frame time, µs";
  chart.y_label = "share of frames that took longer";
  chart.log_x = chart.log_y = true;
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series s = series_of(study, i);
    const trace::ForceTrace& trace = study.runs[i].trace;
    std::vector<std::int64_t> times;
    for (std::size_t k = 0; k < trace.frame_ns.size() && k < trace.frames.size(); ++k)
      if (trace.frames[k].contact) times.push_back(trace.frame_ns[k]);
    std::sort(times.begin(), times.end());
    const auto n = static_cast<double>(times.size());
    // Ranks from the longest down, evenly spaced in the logarithm.
    for (std::size_t k = 0; k < kTailPoints && !times.empty(); ++k) {
      const double above =
          std::pow(n, static_cast<double>(kTailPoints - 1 - k) / static_cast<double>(kTailPoints - 1));
      const auto rank = static_cast<std::size_t>(std::clamp(n - above, 0.0, n - 1.0));
      s.x.push_back(static_cast<double>(std::max<std::int64_t>(times[rank], 1)) / kNsPerUs);
      s.y.push_back(above / n);
    }
    chart.series.push_back(std::move(s));
  }
  return chart;
}

Chart preparation(const Study& study, const std::string& prefix) {
  Chart chart = begin(prefix, "preparation", "Preparation",
                      "Everything before the first frame, with the threads named below.");
  chart.y_label = "preparation, ms";
  chart.style = Chart::Style::kBoxes;
  chart.log_y = true;
  double lowest = 1e300, highest = 0.0;
  std::string tics, labels;
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series s = series_of(study, i);
    if (study.runs[i].result.prepare) {
      const double ms = std::max(study.runs[i].result.prepare->total_ms, kErrorFloorN);
      lowest = std::min(lowest, ms);
      highest = std::max(highest, ms);
      s.x.push_back(static_cast<double>(i));
      s.y.push_back(ms);
      labels += fmt::format("set label '{}' at {},{:.6g} center offset 0,0.6 textcolor rgb '#222222'\n",
                            duration_text(ms), i, ms);
    }
    tics += fmt::format("{}'{}' {}", tics.empty() ? "" : ", ", s.label, i);
    chart.series.push_back(std::move(s));
  }
  if (highest <= 0.0) lowest = highest = 1.0;
  constexpr double kRoomBelow = 0.2, kRoomAbove = 4.0;
  chart.extra = fmt::format(
      "unset key\nset xtics ({}) noenhanced{}\nset xrange [-0.6:{}]\nset yrange [{:.4g}:{:.4g}]\nset style "
      "fill solid 0.9\nset boxwidth 0.6\n{}",
      tics, study.runs.size() > 4 ? " rotate by -25" : "", static_cast<double>(study.runs.size()) - 0.4,
      lowest * kRoomBelow, highest * kRoomAbove, labels);
  return chart;
}

std::size_t first_contact(const Study& study) {
  for (std::size_t k = 0; k < study.stage.path.size(); ++k) {
    if (study.stage.reference && study.stage.reference->frames[k].frame.contact) return k;
    if (study.stage.reference) continue;
    for (const Run& run : study.runs)
      if (k < run.trace.frames.size() && run.trace.frames[k].contact) return k;
  }
  return 0;
}

Chart force_excerpt(const Study& study, const std::string& prefix) {
  Chart chart =
      begin(prefix, "force", "Force over time, first touch",
            study.stage.reference
                ? "Magnitude of the force around the first entry and exit; black is the ground truth (" +
                      study.stage.reference->name + ")."
                : "Magnitude of the force around the first entry and exit; there is no ground truth here.");
  chart.x_label = "time, s";
  chart.y_label = "force, N";
  chart.wide = true;
  const std::vector<double>& t = study.stage.path.t_s;
  constexpr std::size_t kLead = 60;
  const std::size_t contact = first_contact(study);
  const std::size_t begin_at = contact > kLead ? contact - kLead : 0;
  const std::size_t end_at = std::min(begin_at + kExcerptFrames, t.size());
  const auto take = [&](Series& s, std::size_t k, const render::Frame& frame) {
    s.x.push_back(t[k]);
    s.y.push_back(frame.force_n.norm());
  };
  if (study.stage.reference) {
    Series truth{"truth", "#000000", {}, {}};
    for (std::size_t k = begin_at; k < end_at; ++k) take(truth, k, study.stage.reference->frames[k].frame);
    chart.series.push_back(std::move(truth));
  }
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series s = series_of(study, i);
    for (std::size_t k = begin_at; k < end_at && k < study.runs[i].trace.frames.size(); ++k)
      take(s, k, study.runs[i].trace.frames[k]);
    chart.series.push_back(std::move(s));
  }
  return chart;
}

Chart error_along(const Study& study, const std::string& prefix) {
  Chart chart = begin(prefix, "error", "Force error along the path",
                      "Largest |rendered − true| force in each of some 300 pieces of the path; frames "
                      "without any error are left out.");
  chart.x_label = "time, s";
  chart.y_label = "force error, N";
  chart.log_y = true;
  chart.style = Chart::Style::kSteps;
  const std::vector<double>& t = study.stage.path.t_s;
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series s = series_of(study, i);
    const std::vector<float>& error = study.runs[i].per_frame.force_error_n;
    const std::size_t piece = std::max<std::size_t>(1, error.size() / kBins);
    for (std::size_t k = 0; k < error.size(); k += piece) {
      const auto last = error.begin() + static_cast<std::ptrdiff_t>(std::min(k + piece, error.size()));
      const double worst =
          static_cast<double>(*std::max_element(error.begin() + static_cast<std::ptrdiff_t>(k), last));
      s.x.push_back(t[k]);
      s.y.push_back(worst > kErrorFloorN ? worst : std::nan(""));
    }
    chart.series.push_back(std::move(s));
  }
  return chart;
}

/// The path from above: where true contact is, and where the renderer saw it wrongly.
Chart defect_map(const Study& study, std::size_t run, const std::string& prefix) {
  const Run& r = study.runs[run];
  Chart chart =
      begin(prefix, fmt::format("map-{}", r.result.label), "Where contact was wrong: " + r.result.label,
            r.result.accuracy ? fmt::format("The HIP's path seen along z. {} frames missed, {} false, of {} "
                                            "in contact (beyond one local resolution).",
                                            count_text(r.result.accuracy->missed_contact_frames),
                                            count_text(r.result.accuracy->false_contact_frames),
                                            count_text(r.result.accuracy->contact_frames))
                              : "");
  chart.x_label = "x, mm";
  chart.y_label = "y, mm";
  const auto& hip = study.stage.path.hip_mm;
  Series path{"path", "#bbbbbb", {}, {}};
  const std::size_t step = std::max<std::size_t>(1, hip.size() / kMapPoints);
  for (std::size_t k = 0; k < hip.size(); k += step) {
    path.x.push_back(hip[k].x());
    path.y.push_back(hip[k].y());
  }
  const auto marked = [&](const char* label, const char* colour, const std::vector<std::uint8_t>& flags) {
    Series s{label, colour, {}, {}};
    const auto total = static_cast<std::size_t>(
        std::count_if(flags.begin(), flags.end(), [](std::uint8_t f) { return f != 0; }));
    const std::size_t every = std::max<std::size_t>(1, total / kMapPoints);
    std::size_t seen = 0;
    for (std::size_t k = 0; k < flags.size() && k < hip.size(); ++k) {
      if (flags[k] == 0 || seen++ % every != 0) continue;
      s.x.push_back(hip[k].x());
      s.y.push_back(hip[k].y());
    }
    return s;
  };
  chart.series.push_back(std::move(path));
  chart.series.push_back(marked("false contact", "#e69f00", r.per_frame.false_contact));
  chart.series.push_back(marked("missed contact", "#d00000", r.per_frame.missed_contact));
  chart.style = Chart::Style::kMap;
  chart.extra = "set size ratio -1\nset key outside bottom center horizontal\n";
  return chart;
}

}  // namespace

std::vector<Figure> draw_study(const Study& study, const std::string& prefix, const OutputFolder& folder) {
  std::vector<Figure> figures;
  figures.push_back(draw(force_excerpt(study, prefix), folder));
  figures.push_back(draw(frame_times(study, prefix), folder));
  figures.push_back(draw(preparation(study, prefix), folder));
  if (!study.stage.reference) return figures;
  figures.push_back(draw(error_along(study, prefix), folder));
  for (std::size_t i = 0; i < study.runs.size(); ++i)
    if (!study.runs[i].trace.frames.empty()) figures.push_back(draw(defect_map(study, i, prefix), folder));
  return figures;
}

}  // namespace palpate::experiments
