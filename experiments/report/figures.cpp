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
constexpr std::size_t kMapPoints = 2000;  // of each kind on one map
constexpr double kMapTics = 6.0;
constexpr std::size_t kMapPathPoints = 4000;  // a weave keeps its curves
constexpr double kErrorFloorN = 1e-6;         // below any force a device can show: keeps a logarithm finite

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
  constexpr double kPercent = 100.0;
  Chart chart = begin(prefix, "frame-times", "Frame times",
                      "Share of contact frames that took longer than the time on the x axis, back to back, "
                      "the clock's own cost included. "
                      "Further left is faster; a steep fall is steadier.");
  chart.x_label = "frame time, µs";
  chart.y_label = "frames that took longer, %";
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
      s.y.push_back(kPercent * above / n);
    }
    chart.series.push_back(std::move(s));
  }
  return chart;
}

/// Lying bars, so that long names stay readable; on a logarithmic axis, as meshes take a hundred times as
/// long.
Chart preparation(const Study& study, const std::string& prefix) {
  constexpr double kRoomBelow = 0.4,
                   kRoomAbove = 6.0;  // the shortest bar is seen, the longest one's label fits
  constexpr double kLeastMs = 1e-6;   // keeps a logarithm finite
  constexpr double kMargin = 0.6;     // rows above the first and below the last bar
  Chart chart = begin(prefix, "preparation", "Preparation",
                      "Everything before the first frame; the phases and the number of threads stand below.");
  chart.style = Chart::Style::kBars;
  chart.log_x = true;
  double lowest = 1e300, highest = 0.0;
  std::string tics, labels;
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series s = series_of(study, i);
    tics += fmt::format("{}'{}' {}", tics.empty() ? "" : ", ", s.label, -static_cast<double>(i));
    if (study.runs[i].result.prepare) {
      const double ms = std::max(study.runs[i].result.prepare->total_ms, kLeastMs);
      lowest = std::min(lowest, ms);
      highest = std::max(highest, ms);
      s.x.push_back(ms);
      s.y.push_back(-static_cast<double>(i));
      labels += fmt::format("set label '{}' at {:.6g},{} left offset 0.6,0 textcolor rgb '#222222'\n",
                            duration_text(ms), ms, -static_cast<double>(i));
    }
    chart.series.push_back(std::move(s));
  }
  if (highest <= 0.0) lowest = highest = 1.0;
  chart.bars_from = lowest * kRoomBelow;
  chart.extra = fmt::format(
      "unset key\nset ytics ({}) noenhanced\nset yrange [{}:{}]\nset xrange [{:.4g}:{:.4g}]\n"
      "set xtics ('1 µs' 1e-3, '10 µs' 1e-2, '100 µs' 1e-1, '1 ms' 1, '10 ms' 10, '100 ms' 100, '1 s' 1e3, "
      "'10 s' 1e4, '100 s' 1e5, '1000 s' 1e6)\nunset mxtics\nset grid noy\n{}",
      tics, kMargin - static_cast<double>(study.runs.size()), kMargin, chart.bars_from, highest * kRoomAbove,
      labels);
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
                ? "Magnitude of the force around the first entry and exit; the wide grey line is the ground "
                  "truth (" +
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
  if (begin_at + 1 < end_at)
    chart.extra = fmt::format("set xrange [{:.6g}:{:.6g}]\n", t[begin_at], t[end_at - 1]);
  const auto take = [&](Series& s, std::size_t k, const render::Frame& frame) {
    s.x.push_back(t[k]);
    s.y.push_back(frame.force_n.norm());
  };
  if (study.stage.reference) {
    Series truth{"truth", "#c4c4c4", {}, {}};
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
  chart.wide = true;
  if (study.stage.path.size() > 1)
    chart.extra = fmt::format("set xrange [{:.6g}:{:.6g}]\n", study.stage.path.t_s.front(),
                              study.stage.path.t_s.back());
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

/// The flagged stretches of a path as lines of their own, thinned to what a map can show. A stretch of one
/// frame becomes a dot: `dot_mm` long.
Series stretches(const char* label, const char* colour, const std::vector<Vec3>& hip,
                 const std::vector<std::uint8_t>& flags, double dot_mm) {
  Series s{label, colour, {}, {}};
  const auto total = static_cast<std::size_t>(
      std::count_if(flags.begin(), flags.end(), [](std::uint8_t f) { return f != 0; }));
  const std::size_t every = std::max<std::size_t>(1, total / kMapPoints);
  const auto put = [&](double x, double y) {
    s.x.push_back(x);
    s.y.push_back(y);
  };
  const std::size_t n = std::min(flags.size(), hip.size());
  for (std::size_t k = 0; k < n;) {
    if (flags[k] == 0) {
      ++k;
      continue;
    }
    std::size_t end = k;
    while (end < n && flags[end] != 0) ++end;
    for (std::size_t j = k; j + 1 < end; j += every) put(hip[j].x(), hip[j].y());
    put(hip[end - 1].x(), hip[end - 1].y());
    put(hip[end - 1].x() + dot_mm, hip[end - 1].y());
    put(hip[end - 1].x(), std::nan(""));
    k = end;
  }
  return s;
}

bool any(const std::vector<std::uint8_t>& flags) {
  return std::any_of(flags.begin(), flags.end(), [](std::uint8_t f) { return f != 0; });
}

/// The path from above, and where the renderers called `who` saw contact wrongly, all in the same way.
Chart defect_map(const Study& study, const Run& r, const std::string& who, const std::string& prefix) {
  constexpr double kDotShare = 0.002;  // of the map's width: a pixel
  Chart chart =
      begin(prefix, fmt::format("map-{}", r.result.label), "Where contact was wrong: " + who,
            fmt::format("The path of the HIP seen along z; thick where contact is wrong by more than "
                        "one local resolution. {} frames missed, {} false.",
                        count_text(r.result.accuracy ? r.result.accuracy->missed_contact_frames : 0),
                        count_text(r.result.accuracy ? r.result.accuracy->false_contact_frames : 0)));
  chart.x_label = "x, mm";
  chart.y_label = "y, mm";
  constexpr int kMapHeight = 500;
  chart.height = kMapHeight;
  const auto& hip = study.stage.path.hip_mm;
  Series path{"path", "#aaaaaa", {}, {}};
  const std::size_t step = std::max<std::size_t>(1, hip.size() / kMapPathPoints);
  for (std::size_t k = 0; k < hip.size(); k += step) {
    path.x.push_back(hip[k].x());
    path.y.push_back(hip[k].y());
  }
  const auto [low, high] = std::minmax_element(path.x.begin(), path.x.end());
  const auto [bottom, top] = std::minmax_element(path.y.begin(), path.y.end());
  const double extent = path.x.empty() ? 1.0 : std::max(*high - *low, *top - *bottom);
  chart.series.push_back(std::move(path));
  chart.series.push_back(
      stretches("false contact", "#e69f00", hip, r.per_frame.false_contact, kDotShare * extent));
  chart.series.push_back(
      stretches("missed contact", "#c00000", hip, r.per_frame.missed_contact, kDotShare * extent));
  chart.style = Chart::Style::kMap;
  chart.extra = fmt::format(
      "set size ratio -1\nset offsets graph 0.04, graph 0.04, graph 0.04, graph 0.04\n"
      "set xtics {0:.6g}\nset ytics {0:.6g}\n",
      tic_step(extent, kMapTics));
  return chart;
}

/// A map for every different way of being wrong; none for renderers that are right.
std::vector<Figure> draw_maps(const Study& study, const std::string& prefix, const OutputFolder& folder) {
  std::vector<std::pair<const Run*, std::string>> maps;
  for (const Run& run : study.runs) {
    const metrics::AccuracyFrames& f = run.per_frame;
    if (!any(f.missed_contact) && !any(f.false_contact)) continue;
    const auto same = std::find_if(maps.begin(), maps.end(), [&](const auto& map) {
      return map.first->per_frame.missed_contact == f.missed_contact &&
             map.first->per_frame.false_contact == f.false_contact;
    });
    if (same != maps.end())
      same->second += ", " + run.result.label;
    else
      maps.push_back({&run, run.result.label});
  }
  std::vector<Figure> figures;
  for (const auto& [run, who] : maps) figures.push_back(draw(defect_map(study, *run, who, prefix), folder));
  return figures;
}

}  // namespace

std::vector<Figure> draw_study(const Study& study, const std::string& prefix, const OutputFolder& folder) {
  std::vector<Figure> figures;
  figures.push_back(draw(force_excerpt(study, prefix), folder));
  figures.push_back(draw(frame_times(study, prefix), folder));
  figures.push_back(draw(preparation(study, prefix), folder));
  if (!study.stage.reference) return figures;
  figures.push_back(draw(error_along(study, prefix), folder));
  for (Figure& map : draw_maps(study, prefix, folder)) figures.push_back(std::move(map));
  return figures;
}

}  // namespace palpate::experiments
