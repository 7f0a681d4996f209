#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/live/live.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

PALPATE_JSON_MEMBERS(SessionMark, t_s, text)
PALPATE_JSON_MEMBERS(RemoteCounts, packets, bad, refused, commands)
PALPATE_JSON_MEMBERS(LiveStreamFacts, source, about, frames, taken, repeated, late, truncated, failed,
                     skipped, unreadable, unrecorded, silences, ended, window_p50_ms, window_p99_ms,
                     whole_p50_ms, whole_p99_ms, light_to_touch_p50_ms, light_to_touch_p99_ms)
PALPATE_JSON_MEMBERS(LiveRecorded, file, ticks, written, lost, bytes)
PALPATE_JSON_MEMBERS(LiveRenderer, label, name, prepare_ms, bytes, shared_bytes, frames, contact_frames,
                     felt_frames, late_frames, coarse_frames, swaps, stalled_frames, largest_step_n, made,
                     disqualified)
PALPATE_JSON_MEMBERS(LiveDocument, scene, path, device, hand, grip, rule, accelerated, rate_hz, seconds,
                     fade_ms, scheduling, steal_percent, force_limit_n, ticks, switches, fades, refused,
                     waited, largest_step_n, largest_excess_n, faults, fault_names, rearmed, half_rate_ticks,
                     decisions_lost, watchdog_trips, replugged, guarded, unproven, marks, warnings, notes)

namespace {

constexpr double kUsPerNs = 1e-3;

DocumentJson durations_json(const device::DurationStatistics& d) {
  const auto us = [](std::int64_t ns) { return static_cast<double>(ns) * kUsPerNs; };
  return {{"count", d.count},    {"mean", d.mean_ns * kUsPerNs}, {"p50", us(d.p50_ns)},
          {"p99", us(d.p99_ns)}, {"p999", us(d.p999_ns)},        {"max", us(d.max_ns)}};
}

DocumentJson decision_json(const LiveDecision& d) {
  return {{"t_s", d.t_s},
          {"source", device::source_text(d.source)},
          {"decision", device::decision_text(d.decision)},
          {"reason", device::reason_text(d.reason)},
          {"from", d.from},
          {"to", d.to},
          {"force_n", d.before_n},
          {"difference_n", d.difference_n}};
}

DocumentJson steps_json(const metrics::ForceSteps& steps) {
  const auto largest = [](const metrics::ForceSteps::Largest& one) {
    return DocumentJson{
        {"n", one.n}, {"t_s", one.t_s}, {"hip_mm", {one.hip_mm.x(), one.hip_mm.y(), one.hip_mm.z()}}};
  };
  return {{"largest", largest(steps.step())},
          {"largest_excess", largest(steps.excess())},
          {"over_0_1_n", steps.over_clean()},
          {"over_0_2_n", steps.over_noisy()}};
}

DocumentJson renderer_json(const LiveRenderer& r) {
  DocumentJson json = r;
  json["options"] = DocumentJson::object();
  for (const auto& [key, value] : r.options) json["options"][key] = value;
  json["step_us"] = durations_json(r.step);
  json["felt_steps"] = steps_json(r.felt_steps);
  return json;
}

DocumentJson remote_json(const LiveRemote& remote) {
  if (remote.where.empty()) return nullptr;
  DocumentJson json = {{"listened", remote.where}};
  to_json(json, remote.counts);
  return json;
}

/// "3.1, 4.2"; a dash where nothing was taken.
std::string two_text(const std::optional<double>& p50, const std::optional<double>& p99) {
  return p50 && p99 ? fmt::format("{}, {}", format_number(*p50), format_number(*p99)) : std::string("-");
}

std::string us_text(std::int64_t ns) {
  return format_number(static_cast<double>(ns) * kUsPerNs);
}

Table session_table(const LiveDocument& document) {
  Table table;
  table.title = "The session";
  table.columns = {"what", "value"};
  const auto row = [&](const char* what, std::string value) {
    table.rows.push_back({{what}, {std::move(value)}});
  };
  row("ticks", format_count(document.ticks));
  row("periods missed", format_count(document.loop.missed));
  row("switches; fades begun", fmt::format("{}, {}", document.switches, document.fades));
  row("refused, waited", fmt::format("{}, {}", document.refused, document.waited));
  row("faults", format_count(document.faults));
  if (document.replugged > 0) row("the device was gone and came back", format_count(document.replugged));
  if (!document.remote.where.empty())
    row("over the network: commands, refused, no command",
        fmt::format("{}, {}, {}", document.remote.counts.commands, document.remote.counts.refused,
                    document.remote.counts.bad));
  if (const LiveStreamFacts& s = document.stream; !s.source.empty()) {
    row("depth images taken; skipped, late, repeated, truncated, failed",
        fmt::format("{}; {}, {}, {}, {}, {}", s.taken, s.skipped, s.late, s.repeated, s.truncated, s.failed));
    row("until the window, the whole can be felt, ms: p50, p99",
        two_text(s.window_p50_ms, s.window_p99_ms) + "; " + two_text(s.whole_p50_ms, s.whole_p99_ms));
    row("from light to touch, ms: p50, p99", two_text(s.light_to_touch_p50_ms, s.light_to_touch_p99_ms));
    if (s.silences > 0) row("the camera fell silent", format_count(s.silences));
  }
  if (!document.recording.file.empty())
    row("recorded: ticks, of them lost", fmt::format("{}, {} ({})", document.recording.ticks,
                                                     document.recording.lost, document.recording.file));
  row("page faults of the loop's thread: minor, major",
      fmt::format("{}, {}", document.loop.page_faults.minor, document.loop.page_faults.major));
  row("largest step of the force, N", format_number(document.largest_step_n));
  row("of it more than renderers and fade explain, N", format_number(document.largest_excess_n));
  row("late, µs: p50, p99, p99.9, most",
      fmt::format("{}, {}, {}, {}", us_text(document.loop.lateness.p50_ns),
                  us_text(document.loop.lateness.p99_ns), us_text(document.loop.lateness.p999_ns),
                  us_text(document.loop.lateness.max_ns)));
  row("felt stiffness, N/mm",
      fmt::format("{} ({} N/mm, {} mm of the scene for a mm of the device)",
                  format_number(document.felt_stiffness_n_per_mm), format_number(document.stiffness_n_per_mm),
                  format_number(document.world_per_device)));
  table.notes.push_back(document.scheduling + ".");
  return table;
}

Table renderers_table(const LiveDocument& document) {
  Table table;
  table.title = "Renderers";
  table.columns = {"renderer",        "felt, %", "contact frames", "frame, µs: p50", "p99.9",
                   "largest step, N", "made",    "bytes",          "of them shared"};
  for (const LiveRenderer& r : document.renderers) {
    const double all = document.ticks > 0 ? static_cast<double>(document.ticks) : 1.0;
    table.rows.push_back({{r.label},
                          {format_number(100.0 * static_cast<double>(r.felt_frames) / all)},
                          {format_count(r.contact_frames)},
                          {us_text(r.step.p50_ns)},
                          {us_text(r.step.p999_ns)},
                          {format_number(r.largest_step_n)},
                          {format_count(r.made)},
                          {format_bytes(static_cast<double>(r.bytes))},
                          {format_bytes(static_cast<double>(r.shared_bytes))}});
    if (!r.disqualified.empty())
      table.notes.push_back(fmt::format("{} was disqualified: {}.", r.label, r.disqualified));
  }
  if (document.accelerated)
    table.notes.emplace_back(
        "Frames are timed by the machine's clock and follow one another at once, with warm caches: in real "
        "time they take longer. By the session's own clock they take nothing, so nobody is judged by them.");
  return table;
}

Table steps_table(const LiveDocument& document) {
  Table table;
  table.title = "Steps of the force that is felt";
  table.columns = {"renderer",
                   "largest, N",
                   "at, s",
                   "largest excess, N",
                   "at, s",
                   "HIP, mm",
                   fmt::format("over {} N", metrics::kCleanExcessN),
                   fmt::format("over {} N", metrics::kNoisyExcessN)};
  for (const LiveRenderer& r : document.renderers) {
    const metrics::ForceSteps::Largest &step = r.felt_steps.step(), &excess = r.felt_steps.excess();
    const Vec3& at = excess.hip_mm;
    table.rows.push_back({{r.label},
                          {format_number(step.n)},
                          {fmt::format("{:.3f}", step.t_s)},
                          {format_number(excess.n)},
                          {fmt::format("{:.3f}", excess.t_s)},
                          {fmt::format("{:.2f} {:.2f} {:.2f}", at.x(), at.y(), at.z())},
                          {format_count(r.felt_steps.over_clean())},
                          {format_count(r.felt_steps.over_noisy())}});
  }
  table.notes.emplace_back(
      "The excess of a step is what it is above stiffness times the HIP's move in that tick: no hand made "
      "it.");
  return table;
}

/// Means over stretches, with marks for switches.
Chart force_chart(const LiveDocument& document) {
  Chart chart;
  chart.name = "force";
  chart.title = "Force over the session";
  chart.caption =
      "Means over short stretches. Black: what went out to the governor; marks on the axis: switches. Every "
      "renderer follows the same hand all the time, and one is felt.";
  chart.x_label = "s";
  chart.y_label = "N";
  chart.wide = true;
  std::vector<std::string> labels;
  for (const LiveRenderer& r : document.renderers) labels.push_back(r.label);
  const std::vector<LineStyle> styles = line_styles_of(labels);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    Series line{labels[i], styles[i].colour, {}, {}, styles[i].dash};
    for (const LiveSample& sample : document.samples) {
      line.x.push_back(sample.t_s);
      line.y.push_back(sample.each_n[i]);
    }
    chart.series.push_back(std::move(line));
  }
  Series out{"felt", "#000000", {}, {}, {}};
  for (const LiveSample& sample : document.samples) {
    out.x.push_back(sample.t_s);
    out.y.push_back(sample.out_n);
  }
  chart.series.push_back(std::move(out));
  std::string marks;
  for (const LiveDecision& d : document.decisions)
    if (d.decision == device::MixDecision::kSwapped || d.decision == device::MixDecision::kFadeDone)
      marks +=
          fmt::format("set arrow from first {0:.4g},graph 0 to first {0:.4g},graph 0.03 nohead\n", d.t_s);
  chart.extra = marks;
  return chart;
}

/// Histogram of ticks' lateness in quarter octaves.
Chart lateness_chart(const LiveDocument& document) {
  Chart chart;
  chart.name = "lateness";
  chart.title = "How late ticks began";
  chart.caption = fmt::format(
      "Ticks of each lateness, in stretches of a quarter of an octave; both axes logarithmic. {} periods of "
      "{} were missed whole.",
      format_count(document.loop.missed), format_count(document.ticks + document.loop.missed));
  chart.x_label = "µs";
  chart.y_label = "ticks";
  chart.log_x = chart.log_y = true;
  chart.style = Chart::Style::kSteps;
  Series line{"ticks", "#0072B2", {}, {}, {}};
  // A logarithmic axis has no zero: half a tick stands for none.
  constexpr double kNoTick = 0.5, kLeastUs = 1e-3;
  for (const device::DurationBin& bin : document.lateness) {
    line.x.push_back(std::max(kLeastUs, static_cast<double>(bin.from_ns) * kUsPerNs));
    line.y.push_back(bin.count > 0 ? static_cast<double>(bin.count) : kNoTick);
  }
  if (!document.lateness.empty()) {
    line.x.push_back(static_cast<double>(document.lateness.back().to_ns + 1) * kUsPerNs);
    line.y.push_back(kNoTick);
  }
  chart.series.push_back(std::move(line));
  return chart;
}

}  // namespace

std::string to_json(const LiveDocument& document) {
  DocumentJson json = begin_json(kLiveSchema, document.head);
  to_json(json, document);
  json["mapping"] = {{"world_per_device", document.world_per_device},
                     {"stiffness_n_per_mm", document.stiffness_n_per_mm},
                     {"felt_stiffness_n_per_mm", document.felt_stiffness_n_per_mm}};
  json["late"] = document.loop.missed;
  json["page_faults"] = {{"minor", document.loop.page_faults.minor},
                         {"major", document.loop.page_faults.major}};
  json["jitter_us"] = durations_json(document.loop.lateness);
  json["lateness_histogram"] = DocumentJson::array();
  for (const device::DurationBin& bin : document.lateness)
    json["lateness_histogram"].push_back({{"from_us", static_cast<double>(bin.from_ns) * kUsPerNs},
                                          {"to_us", static_cast<double>(bin.to_ns) * kUsPerNs},
                                          {"count", bin.count}});
  json["exchange_us"] = durations_json(document.loop.exchange);
  json["resident_bytes"] = {{"before", document.resident_before_bytes},
                            {"after", document.resident_after_bytes}};
  json["renderers"] = DocumentJson::array();
  for (const LiveRenderer& r : document.renderers) json["renderers"].push_back(renderer_json(r));
  json["decisions"] = DocumentJson::array();
  for (const LiveDecision& d : document.decisions) json["decisions"].push_back(decision_json(d));
  json["remote"] = remote_json(document.remote);
  json["stream"] = document.stream.source.empty() ? DocumentJson(nullptr) : DocumentJson(document.stream);
  json["recording"] =
      document.recording.file.empty() ? DocumentJson(nullptr) : DocumentJson(document.recording);
  return document_text(json);
}

std::vector<Table> live_tables(const LiveDocument& document) {
  return {session_table(document), renderers_table(document), steps_table(document)};
}

Page live_page(const LiveDocument& document, const OutputFolder& folder) {
  Page page = begin_page("Renderers under one hand", document.head);
  add_known(page, {{}, document.warnings, document.notes});
  Section section;
  section.id = "live";
  section.title = fmt::format("{} on {}", document.scene, document.device);
  section.paragraphs.emplace_back(
      document.grip.empty()
          ? "A person holds the device. All renderers follow it in every tick; one is felt at a time."
          : "A simulated hand holds a simulated device. All renderers follow it in every tick; one is felt "
            "at a time. No device and no person was measured.");
  if (const Result<OutputFolder> figures = folder.inside("figures")) {
    const Chart chart = force_chart(document);
    if (has_points(chart)) section.figures.push_back(draw(chart, *figures));
    // Ticks on a virtual clock are never late.
    if (!document.accelerated) section.figures.push_back(draw(lateness_chart(document), *figures));
  }
  section.tables = live_tables(document);
  section.facts.push_back({"path of the hand", {document.path}});
  page.sections.push_back(std::move(section));
  return page;
}

}  // namespace palpate::experiments
