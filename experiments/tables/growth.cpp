// Growth with the number of points, measured: "largely insensitive" in the thesis (section 3.6.2).
#include <fmt/format.h>

#include "experiments/tables/reproduction.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr double kGrowthLimitS = 900.0;
/// A mean frame that grows no more over a hundred times the points is insensitive to them, by our own goal.
constexpr double kInsensitive = 2.0;

using R = metrics::RendererResult;

struct GrowthRow {
  std::uint64_t points;
  std::vector<R> results;
};

Result<GrowthRow> measure(const Manifest& manifest, const ManifestModel& model, Reproduction& r,
                          metrics::ResultDocument& document) {
  PALPATE_ASSIGN(ModelScene scene, scene_of(model, r));
  StageRequest request;
  request.scene_name = scene.file.path;
  request.scene = std::move(scene.file);
  request.path = r.arguments.quick ? manifest.quick_path : manifest.path;
  request.reference = ReferenceChoice::kNone;
  request.threads = r.arguments.threads;
  PALPATE_ASSIGN(const Stage stage, set_up(request, r.readers, r.context.progress));
  document.path = stage.path.name;
  GrowthRow row{stage.scene.input.models.front().cloud->size(), {}};
  PALPATE_ASSIGN(const std::vector<RendererRequest> requests, requests_of(manifest, r));
  PALPATE_ASSIGN(std::vector<Run> runs, run_on(stage, requests, run_options(r, kGrowthLimitS), r, document));
  for (Run& run : runs) {
    document.renderers.push_back(run.result);
    document.renderers.back().label += fmt::format("-{}", row.points);
    row.results.push_back(std::move(run.result));
  }
  return row;
}

/// One renderer's `value` over all rows.
std::vector<std::optional<double>> column(const std::vector<GrowthRow>& rows, std::size_t renderer,
                                          const ScoreGet& value) {
  std::vector<std::optional<double>> values;
  for (const GrowthRow& row : rows)
    values.push_back(renderer < row.results.size() ? value(row.results[renderer]) : std::nullopt);
  return values;
}

/// Columns are sizes; each renderer has a group of rows.
Table growth_table(const Manifest& manifest, const std::vector<GrowthRow>& rows) {
  Table table;
  table.title = manifest.title;
  table.columns = {"points"};
  for (const GrowthRow& row : rows) table.columns.push_back(format_count(row.points));
  const std::pair<const char*, ScoreGet> scores[] = {
      {"mean frame in contact without the clock, µs",
       frame_score(&R::frame, &trace::FrameStatistics::mean_us)},
      {"mean of all frames without the clock, µs",
       frame_score(&R::frame_all, &trace::FrameStatistics::mean_us)},
      {"mean frame in contact with the clock, µs",
       frame_score(&R::frame, &trace::FrameStatistics::mean_clocked_us)},
      {"99.9 % in contact with the clock, µs", frame_score(&R::frame, &trace::FrameStatistics::p999_us)},
      {"99.9 % of all frames with the clock, µs",
       frame_score(&R::frame_all, &trace::FrameStatistics::p999_us)}};
  for (std::size_t i = 0; !rows.empty() && i < rows.front().results.size(); ++i) {
    table.rows.push_back({plain(rows.front().results[i].label)});
    for (const auto& [name, value] : scores)
      table.rows.push_back(score_row(name, column(rows, i, value), Show::kNumbers));
    table.rows.push_back(score_row("preparation", column(rows, i, prepare_ms), Show::kTimes));
    for (std::size_t k = 0; k < rows.size(); ++k)
      if (i >= rows[k].results.size() || rows[k].results[i].status != metrics::RunStatus::kOk)
        for (std::size_t back = 1; back <= std::size(scores) + 1; ++back)
          table.rows[table.rows.size() - back][k + 1] = {"did not finish", false, true};
  }
  table.bad_means = "did not run to its end";
  table.notes = manifest.notes;
  return table;
}

Chart growth_chart(const std::vector<GrowthRow>& rows, const char* name, const char* title,
                   const char* y_label, const ScoreGet& value) {
  Chart chart;
  chart.name = name;
  chart.title = title;
  chart.caption = "The same surface and path throughout; both axes logarithmic.";
  chart.x_label = "points";
  chart.y_label = y_label;
  chart.log_x = chart.log_y = true;
  chart.style = Chart::Style::kMarkedLines;
  chart.extra =
      "set xtics ('10^4' 1e4, '10^5' 1e5, '10^6' 1e6, '10^7' 1e7)\nset yrange [*:*]\n"
      "set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05\n";
  std::vector<std::string> labels;
  if (!rows.empty())
    for (const R& result : rows.front().results) labels.push_back(result.label);
  const std::vector<LineStyle> styles = line_styles_of(labels);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    Series series{labels[i], styles[i].colour, {}, {}, styles[i].dash};
    const std::vector<std::optional<double>> values = column(rows, i, value);
    for (std::size_t k = 0; k < rows.size(); ++k) {
      if (!values[k]) continue;
      series.x.push_back(static_cast<double>(rows[k].points));
      series.y.push_back(*values[k]);
    }
    chart.series.push_back(std::move(series));
  }
  return chart;
}

/// Growth from the first size to the last, in words, and as a line of the first page.
void conclude_growth(const Manifest& manifest, const std::vector<GrowthRow>& rows, bool quick,
                     Section& section, std::vector<Answer>& answers) {
  if (rows.size() < 2) return;
  const ScoreGet frame = frame_score(&R::frame, &trace::FrameStatistics::mean_us);
  std::vector<std::string> grown;
  Answer answer;
  for (std::size_t i = 0; i < rows.front().results.size(); ++i) {
    const auto mean = column(rows, i, frame), prepare = column(rows, i, prepare_ms);
    if (!mean.front() || !mean.back() || !prepare.front() || !prepare.back()) continue;
    const std::string& label = rows.front().results[i].label;
    const double times = *mean.back() / *mean.front();
    section.found.push_back(
        {label, fmt::format("mean frame {} times, from {} to {} µs; preparation {} times, from {} to {}",
                            format_number(times), format_number(mean.front()), format_number(mean.back()),
                            format_number(*prepare.back() / *prepare.front()),
                            format_duration(*prepare.front()), format_duration(*prepare.back()))});
    grown.push_back(fmt::format("{} {} times", label, format_number(times)));
    if (grown.size() == 1) answer.reproduced = times <= kInsensitive ? Judged::kYes : Judged::kNo;
  }
  answer.table = "3.6.2";
  answer.page = manifest.id() + ".html";
  answer.says = fmt::format("growth of the mean frame from {} to {} points",
                            format_count(rows.front().points), format_count(rows.back().points));
  answer.printed = "\"largely insensitive\"";
  answer.ours = joined(grown);
  answer.status = quick                               ? "tried on small models only"
                  : answer.reproduced == Judged::kYes ? "reproduced"
                                                      : "in part: it grows, if less than the points";
  if (quick) answer.reproduced = Judged::kNot;
  answers.push_back(std::move(answer));
}

}  // namespace

void reproduce_growth(const Manifest& manifest, Reproduction& r) {
  metrics::ResultDocument document = new_document(r.context.command_line);
  document.title = manifest.title;
  document.scene = "sinusoid over 100 x 100 mm, by number of points";
  std::vector<GrowthRow> rows;
  for (const ManifestModel& model : manifest.models) {
    if (model.long_run && waits_for_full(r)) {
      leave_out(r, fmt::format("growth at {} points: it needs minutes; run with --full", model.name));
      break;
    }
    Result<GrowthRow> row = measure(manifest, model, r, document);
    if (!row) {
      leave_out(r, fmt::format("growth at {} points: {}", model.name, row.error().message()));
      break;
    }
    rows.push_back(*std::move(row));
  }
  write_beside(r, manifest, "result.json", metrics::to_json(document));
  add_known(r.part, known_of("Growth", document));
  Section section{manifest.id(),
                  "Growth with the number of points",
                  {},
                  {manifest.text},
                  {growth_table(manifest, rows)},
                  {},
                  {}};
  if (const Result<OutputFolder> figures = r.folder.inside("figures"))
    section.figures = {draw(growth_chart(rows, "growth", "Mean frame by number of points", "mean frame, µs",
                                         frame_score(&R::frame, &trace::FrameStatistics::mean_us)),
                            *figures),
                       draw(growth_chart(rows, "growth-preparation", "Preparation by number of points",
                                         "preparation, ms", prepare_ms),
                            *figures)};
  conclude_growth(manifest, rows, r.arguments.quick, section, r.part.answers);
  r.part.sections.push_back(std::move(section));
}

}  // namespace palpate::experiments
