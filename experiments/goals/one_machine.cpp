#include <fmt/format.h>

#include <algorithm>

#include <palpate/device/scheduling.h>
#include <palpate/result.h>
#include "experiments/goals/goals.h"
#include "experiments/goals/pinned_loop.h"
#include "experiments/report/figures.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/statistics.h"

namespace palpate::experiments {
namespace {

constexpr double kPinnedUs = 1e3;        // ns of it
constexpr double kMostLateUs = kTickUs;  // a tick late by a period is another tick
constexpr double kLeastImages = 10.0;    // per second; fewer cannot follow a hand
constexpr double kInTime = 0.999;

struct PinnedRow {
  std::string label;
  bool draws = false;
  PinnedRun run;
};

double quantile_us(std::vector<std::int64_t> values, double share) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return static_cast<double>(nearest_rank(values, 100.0 * share)) / kPinnedUs;
}

/// Share of ticks that ran, not skipped, in percent.
double ticks_percent(const PinnedRun& run) {
  const auto ran = static_cast<double>(run.late_ns.size());
  return 100.0 * ran / (ran + static_cast<double>(run.skipped_ticks));
}

double images_per_s(const PinnedRun& run) {
  return run.drawn_s > 0.0 ? static_cast<double>(run.images) / run.drawn_s : 0.0;
}

/// Exceeds the caches.
std::uint64_t pinned_points(const GoalBench& bench) {
  return bench.quick ? 4000 : 400'000;
}

Result<std::vector<PinnedRow>> pinned_rows(const GoalBench& bench) {
  const std::string scene =
      std::string("torus:sampling=random:seed=11:points=") + std::to_string(pinned_points(bench));
  const std::string path =
      fmt::format("weave:frames={}:depth_mm=1:period_frames=300", bench.quick ? 900 : 9000);
  PALPATE_ASSIGN(const Stage stage, goal_stage(bench, scene, path, ReferenceChoice::kNone));
  // Uses the same ring in scanner rows for the mesh, since reconstructing so many points takes long.
  const std::string rows_scene =
      std::string("torus:order=turntable:points=") + std::to_string(pinned_points(bench));
  PALPATE_ASSIGN(const Stage mesh_stage, goal_stage(bench, rows_scene, path, ReferenceChoice::kNone));
  std::vector<PinnedRow> rows;
  for (const char* const name : {"cloud", "cloud-smooth", "mesh-godobject"}) {
    const bool is_mesh = std::string(name) == "mesh-godobject";
    const Stage& on = is_mesh ? mesh_stage : stage;
    bench.suite.progress().report(std::string("one core: ") + name, -1.0);
    Options options;
    if (is_mesh) options.set("mesh", "original");
    PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> made, bench.registry.make(name, options));
    PALPATE_TRY(made->prepare(on.scene.input, {bench.threads, nullptr}));
    for (const bool draws : {false, true}) {
      PALPATE_ASSIGN(PinnedRun run, run_pinned(*made, on.path, *on.scene.input.models.front().cloud,
                                               {bench.quick ? 0.5 : 10.0, draws}));
      rows.push_back({is_mesh ? kMeshLabel : name, draws, std::move(run)});
    }
  }
  return rows;
}

const PinnedRun* drawing_run(const std::vector<PinnedRow>& rows, const std::string& label) {
  for (const PinnedRow& row : rows)
    if (row.label == label && row.draws) return &row.run;
  return nullptr;
}

Table pinned_table(const std::vector<PinnedRow>& rows) {
  Table table;
  table.title = "Servo loop at 1 kHz on one core, alone and beside the drawing thread; µs";
  table.columns = {"renderer",      "late, median",      "late, 99.9 % under",
                   "late, most",    "step, median",      "step, 99.9 % under",
                   "ticks skipped", "pictures a second", "points a picture"};
  for (const PinnedRow& row : rows) {
    const PinnedRun& run = row.run;
    table.rows.push_back({{row.label + (row.draws ? ", drawing" : ", alone")},
                          {format_number(quantile_us(run.late_ns, 0.5))},
                          {format_number(quantile_us(run.late_ns, kInTime))},
                          {format_number(quantile_us(run.late_ns, 1.0))},
                          {format_number(quantile_us(run.step_ns, 0.5))},
                          {format_number(quantile_us(run.step_ns, kInTime))},
                          {format_count(run.skipped_ticks)},
                          {row.draws ? format_number(images_per_s(run)) : std::string(kMissingNumber)},
                          {row.draws && run.images > 0 ? format_count(run.points_drawn / run.images)
                                                       : std::string(kMissingNumber)}});
  }
  table.notes = {
      "Late: from when a tick was due to when it began. A step holds whatever interrupted it. A picture has "
      "1280 x 720 pixels with depth and ends after 33 ms at the latest: what is drawn by then is an even "
      "sample of the points."};
  return table;
}

/// Lateness by share of the ticks, with and without drawing.
Chart late_chart(const std::vector<PinnedRow>& rows) {
  Chart chart;
  chart.name = "goal-one-machine";
  chart.title = "How late ticks begin, beside the drawing thread";
  chart.caption =
      "Each line: so many percent of the ticks began no later. Both threads are pinned to one core.";
  chart.x_label = "late by at most, µs";
  chart.y_label = "% of the ticks";
  chart.log_x = true;
  chart.style = Chart::Style::kLines;
  std::vector<std::string> labels;
  for (const PinnedRow& row : rows) labels.push_back(row.label + (row.draws ? ", drawing" : ", alone"));
  chart.series = lines_of(labels);
  constexpr int kDrawn = 200;
  constexpr double kLeastUs = 0.1;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    Series& line = chart.series[i];
    std::vector<std::int64_t> sorted = rows[i].run.late_ns;
    std::sort(sorted.begin(), sorted.end());
    for (int k = 0; k <= kDrawn && !sorted.empty(); ++k) {
      const auto at = static_cast<std::size_t>(k) * (sorted.size() - 1) / kDrawn;
      line.x.push_back(std::max(kLeastUs, static_cast<double>(sorted[at]) / kPinnedUs));
      line.y.push_back(100.0 * k / kDrawn);
    }
  }
  return chart;
}

std::string picture_html(const std::vector<PinnedRow>& rows) {
  const PinnedRun* run = drawing_run(rows, "cloud");
  if (run == nullptr || run->last.grey.empty()) return {};
  const std::string png = png_of({kImageWidth, kImageHeight, run->last.grey});
  return fmt::format(
      "<figure class=\"wide\"><h3>The last picture that was drawn beside the servo loop</h3><div "
      "class=\"picture\"><img alt=\"the points of the ring, the probe as a cross\" style=\"width:100%\" "
      "src=\"data:image/png;base64,{}\"></div><figcaption>Near points are dark; the cross is the "
      "probe.</figcaption></figure>\n",
      base64(png));
}

void describe_scheduling(const std::vector<PinnedRow>& rows, Goal& goal) {
  if (rows.empty()) return;
  const PinnedRun& run = rows.front().run;
  goal.notes.push_back(run.cpu >= 0 ? fmt::format("Both threads ran on core {}.", run.cpu)
                                    : std::string("The threads could not be pinned: the system refused."));
  goal.notes.push_back(
      run.real_time ? fmt::format("The servo had real-time priority (SCHED_FIFO {}).", device::kServoPriority)
                    : std::string("The servo had no real-time priority: its ticks wait for the drawing "
                                  "thread's turn to end."));
  goal.notes.insert(goal.notes.end(), run.not_obtained.begin(), run.not_obtained.end());
  if (run.cpu < 0) goal.short_of.emplace_back("The threads were not pinned: two cores may have been used.");
  if (!run.real_time) goal.short_of.emplace_back("The servo had no real-time priority.");
}

}  // namespace

Goal one_machine_goal(const GoalBench& bench) {
  Goal goal{"one-machine", "No assumption of a multi-machine architecture",
            "haptics, graphics and the rest run on one machine; here on one core of it."};
  goal.method = {fmt::format(
      "One thread steps the renderer at 1 kHz along a path over {} points; another one projects the same "
      "points into pictures, as fast as it can. Both are pinned to one core, so that each microsecond of the "
      "one is missing to the other. The same without drawing stands beside it. No device takes part: its "
      "reading and sending would be added to each tick.",
      format_count(pinned_points(bench)))};
  const Result<std::vector<PinnedRow>> rows = pinned_rows(bench);
  if (!rows) goal.notes.push_back("Not measured: " + rows.error().message());
  const std::vector<PinnedRow> none, &all = rows ? *rows : none;
  const auto drawing = [&](const std::string& label, auto number) -> std::optional<double> {
    const PinnedRun* run = drawing_run(all, label);
    return run != nullptr ? std::optional(number(*run)) : std::nullopt;
  };
  const auto late = [](const PinnedRun& run) { return quantile_us(run.late_ns, kInTime); };
  for (const char* const judged : kJudged) {
    goal.findings.push_back({fmt::format("{} while drawing, 99.9 % of the ticks late by less than", judged),
                             drawing(judged, late), "µs", kMostLateUs, true, "a tick at 1 kHz",
                             drawing(kMeshLabel, late)});
    goal.findings.push_back({fmt::format("{} while drawing, ticks that took place", judged),
                             drawing(judged, ticks_percent), "%", 100.0 * kInTime, false,
                             "one in a thousand may be lost", drawing(kMeshLabel, ticks_percent)});
    goal.findings.push_back({fmt::format("pictures beside {}", judged), drawing(judged, images_per_s),
                             "a second", kLeastImages, false, "a picture that follows the hand",
                             drawing(kMeshLabel, images_per_s)});
  }
  describe_scheduling(all, goal);
  goal.tables.push_back(pinned_table(all));
  goal.figures.push_back(draw(late_chart(all), bench.figures));
  goal.picture = picture_html(all);
  return goal;
}

}  // namespace palpate::experiments
