// Figures of a study. Series are thinned to what a page can show; the traces beside hold everything.
#include "experiments/report/figures.h"

#include <fmt/format.h>
#include <nettle/base64.h>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr double kFigureNsPerUs = 1e3;
constexpr std::size_t kTailPoints = 160;  // of a distribution
constexpr std::size_t kBins = 320;        // along a path: some two pixels each; in a panel half of them
constexpr std::size_t kExcerptFrames =
    1300;  // one entry and exit of the weave (900 frames) with what is around

/// Frames of the excerpt on a pixel where each renderer has a panel, a quarter of the page's width.
constexpr std::size_t kFramesPerPanelPixel = 4;

Chart begin(const std::string& prefix, const std::string& name, std::string title, std::string caption) {
  Chart chart;
  chart.name = prefix + "-" + name;
  chart.title = std::move(title);
  chart.caption = std::move(caption);
  return chart;
}

/// An empty line for every renderer.
std::vector<Series> series_of(const Study& study) {
  std::vector<std::string> labels;
  for (const metrics::RendererResult& r : study.document.renderers) labels.push_back(r.label);
  const std::vector<LineStyle> styles = line_styles_of(labels);
  std::vector<Series> all;
  for (std::size_t i = 0; i < labels.size(); ++i)
    all.push_back({labels[i], styles[i].colour, {}, {}, styles[i].dash});
  return all;
}

/// More lines than this on one plot are a tangle.
constexpr std::size_t kManyLines = 7;

/// Share of contact frames that take longer than x, both axes logarithmic: the tail is what a hand feels.
Chart frame_times(const Study& study, const std::string& prefix) {
  constexpr double kPercent = 100.0;
  Chart chart = begin(prefix, "frame-times", "Frame times",
                      "Share of all frames that took longer than the time on the x axis, back to back, every "
                      "frame's median over the passes, the clock's own cost included. Further left is "
                      "faster; a steep fall is steadier.");
  chart.nothing = "No frame was timed.";
  chart.x_label = "frame time, µs";
  chart.y_label = "frames that took longer, %";
  chart.log_x = chart.log_y = true;
  chart.wide = study.runs.size() > kManyLines;
  std::vector<Series> series = series_of(study);
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series& s = series[i];
    const trace::ForceTrace& trace = study.runs[i].trace;
    std::vector<std::int64_t> times;
    for (std::size_t k = 0; k < trace.frame_ns.size() && k < trace.frames.size(); ++k)
      times.push_back(trace.frame_ns[k]);
    std::sort(times.begin(), times.end());
    const auto n = static_cast<double>(times.size());
    // Ranks from the longest down, evenly spaced in the logarithm.
    for (std::size_t k = 0; k < kTailPoints && !times.empty(); ++k) {
      const double above =
          std::pow(n, static_cast<double>(kTailPoints - 1 - k) / static_cast<double>(kTailPoints - 1));
      const auto rank = static_cast<std::size_t>(std::clamp(n - above, 0.0, n - 1.0));
      s.x.push_back(static_cast<double>(std::max<std::int64_t>(times[rank], 1)) / kFigureNsPerUs);
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
  constexpr int kBarHeight = 22, kAxisHeight = 60;
  chart.style = Chart::Style::kBars;
  chart.wide = study.runs.size() > kManyLines;
  if (chart.wide) chart.height = kAxisHeight + kBarHeight * static_cast<int>(study.runs.size());
  chart.log_x = true;
  double lowest = 1e300, highest = 0.0;
  std::string tics, labels;
  std::vector<Series> series = series_of(study);
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series& s = series[i];
    tics += fmt::format("{}'{}' {}", tics.empty() ? "" : ", ", s.label, -static_cast<double>(i));
    if (study.document.renderers[i].prepare) {
      const double ms = std::max(study.document.renderers[i].prepare->total_ms, kLeastMs);
      lowest = std::min(lowest, ms);
      highest = std::max(highest, ms);
      s.x.push_back(ms);
      s.y.push_back(-static_cast<double>(i));
      labels += fmt::format("set label '{}' at {:.6g},{} left offset 0.6,0 textcolor rgb '#222222'\n",
                            format_duration(ms), ms, -static_cast<double>(i));
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
  for (std::size_t k = 0; k < study.path.size(); ++k) {
    if (study.reference && study.reference->frames[k].frame.contact) return k;
    if (study.reference) continue;
    for (const StudyRun& run : study.runs)
      if (k < run.trace.frames.size() && run.trace.frames[k].contact) return k;
  }
  return 0;
}

/// Where the truth lacks what the scene asks of a surface, its force is none to compare with.
bool forces_comparable(const Study& study) {
  return study.document.scoring && study.document.scoring->forces_comparable;
}

std::string describe_truth(const Study& study) {
  if (!study.reference) return "there is no ground truth here.";
  return forces_comparable(study)
             ? "the wide grey line is the ground truth (" + study.reference->name + ")."
             : "the wide grey line is the surface without friction, deformation and texture: it shows when "
               "there is contact, and is no truth of the force.";
}

Chart force_excerpt(const Study& study, const std::string& prefix) {
  Chart chart = begin(prefix, "force", "Force over time, first touch",
                      "Magnitude of the force around the first entry and exit; " + describe_truth(study));
  chart.x_label = "time, s";
  chart.y_label = "force, N";
  chart.wide = true;
  const std::vector<double>& t = study.path.t_s;
  constexpr std::size_t kLead = 60;
  const std::size_t contact = first_contact(study);
  const std::size_t begin_at = contact > kLead ? contact - kLead : 0;
  const std::size_t end_at = std::min(begin_at + kExcerptFrames, t.size());
  if (begin_at + 1 < end_at)
    chart.extra = fmt::format("set xrange [{:.6g}:{:.6g}]\n", t[begin_at], t[end_at - 1]);
  const auto streamed = std::find_if(study.document.renderers.begin(), study.document.renderers.end(),
                                     [](const metrics::RendererResult& r) { return r.stream.has_value(); });
  if (streamed != study.document.renderers.end()) {
    chart.caption += " Ticks on the axis: new surfaces from a depth image.";
    for (const double swap_s : streamed->stream->swaps_s)
      if (begin_at < end_at && swap_s >= t[begin_at] && swap_s <= t[end_at - 1])
        chart.extra +=
            fmt::format("set arrow from first {0:.6g},graph 0 to first {0:.6g},graph 0.03 nohead\n", swap_s);
  }
  // Of each piece the largest force.
  const bool panels = study.runs.size() > kManyLines && study.reference;
  const std::size_t piece = panels ? kFramesPerPanelPixel : 1;
  const auto take = [&](Series& s, std::size_t k, const render::Frame& frame) {
    const double force = frame.force_n.norm();
    if ((k - begin_at) % piece == 0) {
      s.x.push_back(t[k]);
      s.y.push_back(force);
    } else if (!(s.y.back() > force)) {
      s.y.back() = force;
    }
  };
  if (study.reference) {
    Series truth{"truth", "#c4c4c4", {}, {}, {}, true};
    for (std::size_t k = begin_at; k < end_at; ++k) take(truth, k, study.reference->frames[k].frame);
    chart.series.push_back(std::move(truth));
  }
  if (panels) {
    chart.style = Chart::Style::kPanels;
    chart.caption += " In N, over seconds.";
  }
  std::vector<Series> series = series_of(study);
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series& s = series[i];
    for (std::size_t k = begin_at; k < end_at && k < study.runs[i].trace.frames.size(); ++k)
      take(s, k, study.runs[i].trace.frames[k]);
    chart.series.push_back(std::move(s));
  }
  return chart;
}

/// A panel for each series instead, with the least of all in each place behind it.
void in_panels(Chart& chart) {
  Series least{"least", "#c4c4c4", chart.series.front().x, {}};
  for (const Series& s : chart.series)
    if (s.x.size() > least.x.size()) least.x = s.x;
  for (std::size_t k = 0; k < least.x.size(); ++k) {
    double y = std::nan("");
    for (const Series& s : chart.series)
      if (k < s.y.size()) y = std::fmin(y, s.y[k]);
    least.y.push_back(y);
  }
  chart.series.insert(chart.series.begin(), std::move(least));
  chart.style = Chart::Style::kPanels;
  chart.caption += " In N, over seconds; grey: the least error of all.";
}

Chart error_along(const Study& study, const std::string& prefix) {
  Chart chart =
      begin(prefix, "error", "Force error along the path",
            "Largest |rendered − true| force in each of some 300 pieces of the path (160 in panels); frames "
            "without any error are left out.");
  chart.x_label = "time, s";
  chart.y_label = "force error, N";
  chart.nothing = "No force is wrong by more than rounding.";
  chart.log_y = true;
  chart.wide = true;
  if (study.path.size() > 1)
    chart.extra = fmt::format("set xrange [{:.6g}:{:.6g}]\n", study.path.t_s.front(), study.path.t_s.back());
  const std::size_t bins = study.runs.size() > kManyLines ? kBins / 2 : kBins;
  chart.style = Chart::Style::kSteps;
  const std::vector<double>& t = study.path.t_s;
  std::vector<Series> series = series_of(study);
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    Series& s = series[i];
    const std::vector<float>& error = study.runs[i].per_frame.force_error_n;
    const std::size_t piece = std::max<std::size_t>(1, error.size() / bins);
    const double rounding = study.document.renderers[i].accuracy
                                ? study.document.renderers[i].accuracy->rounding_n
                                : 0.0;  // no error
    for (std::size_t k = 0; k < error.size(); k += piece) {
      const auto last = error.begin() + static_cast<std::ptrdiff_t>(std::min(k + piece, error.size()));
      const double worst =
          static_cast<double>(*std::max_element(error.begin() + static_cast<std::ptrdiff_t>(k), last));
      s.x.push_back(t[k]);
      s.y.push_back(worst > rounding ? worst : std::nan(""));
    }
    chart.series.push_back(std::move(s));
  }
  if (chart.series.size() > kManyLines) in_panels(chart);
  return chart;
}

}  // namespace

std::vector<Figure> draw_study(const Study& study, const std::string& prefix, const OutputFolder& folder) {
  std::vector<Figure> figures;
  figures.push_back(draw(force_excerpt(study, prefix), folder));
  figures.push_back(draw(frame_times(study, prefix), folder));
  figures.push_back(draw(preparation(study, prefix), folder));
  if (!study.reference) return figures;
  if (forces_comparable(study)) figures.push_back(draw(error_along(study, prefix), folder));
  return figures;
}

namespace {

std::string written(int width, int height, const std::vector<std::uint8_t>& pixels, unsigned format,
                    unsigned flags) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(std::max(width, 0));
  image.height = static_cast<png_uint_32>(std::max(height, 0));
  image.format = format;
  image.flags = flags;
  if (image.width == 0 || image.height == 0 || PNG_IMAGE_SIZE(image) > pixels.size()) return {};
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string bytes(size, '\0');
  const bool whole =
      png_image_write_to_memory(&image, bytes.data(), &size, 0, pixels.data(), 0, nullptr) != 0;
  png_image_free(&image);
  bytes.resize(whole ? size : 0);
  return bytes;
}

}  // namespace

std::string png_of(const GreyImage& image) {
  return written(image.width, image.height, image.pixels, PNG_FORMAT_GRAY, 0);
}

std::string colour_png(const ColourImage& image) {
  return written(image.width, image.height, image.rgb, PNG_FORMAT_RGB, PNG_IMAGE_FLAG_FAST);
}

std::string base64(const std::string& bytes) {
  std::string text(BASE64_ENCODE_RAW_LENGTH(bytes.size()), '\0');
  base64_encode_raw(text.data(), bytes.size(),
                    reinterpret_cast<const std::uint8_t*>(bytes.data()));  // NOLINT
  return text;
}

}  // namespace palpate::experiments
