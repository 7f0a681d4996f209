#include <fmt/format.h>

#include "experiments/tables/reproduction.h"

namespace palpate::experiments {
namespace {

// Without --full the largest model starts only where the ten minutes of the default run leave room for it.
constexpr double kRoomForLargestMs = 330'000.0;
constexpr double kGrowthLimitS = 900.0;
constexpr double kMsPerSecond = 1000.0;

struct Row {
  std::uint64_t points;
  std::vector<metrics::RendererResult> results;
};

Result<Row> measure(const Manifest& manifest, const ManifestModel& model, Reproduction& r,
                    metrics::ResultDocument& document) {
  Result<scene::SceneFile> scene = scene_of(model, r);
  if (!scene) return std::move(scene).error();
  StageRequest request;
  request.scene_name = scene->path;
  request.scene = *std::move(scene);
  request.path = r.arguments.quick ? manifest.quick_path : manifest.path;
  request.reference = ReferenceChoice::kNone;
  request.threads = r.arguments.threads;
  const Result<Stage> stage = set_up(request, r.readers, r.context.progress);
  if (!stage) return stage.error();
  document.path = stage->path.name;
  Row row{stage->scene.input.models.front().cloud->size(), {}};
  RunOptions options;
  options.threads = r.arguments.threads;
  options.prepare_limit_s = kGrowthLimitS;
  set_passes(options, r);
  std::vector<RendererRequest> requests;
  for (const ManifestRun& wanted : manifest.runs) {
    Result<std::vector<RendererRequest>> one = parse_renderers(wanted.renderer, r.registry);
    if (!one) return one.error();
    requests.push_back(std::move(one->front()));
    limit_reconstruction(requests.back(), r);
  }
  metrics::Conditions conditions;
  Result<std::vector<Run>> runs =
      run_renderers(*stage, requests, r.registry, options, r.context.progress, conditions, {});
  if (!runs) return std::move(runs).error();
  add_program(conditions);
  document.conditions = std::move(conditions);
  for (Run& run : *runs) {
    metrics::RendererResult named = run.result;
    named.label = fmt::format("{}-{}", named.label, row.points);
    document.renderers.push_back(std::move(named));
    row.results.push_back(std::move(run.result));
  }
  return row;
}

/// The renderers, one line of each figure.
std::vector<std::string> labels_of(const std::vector<Row>& rows) {
  std::vector<std::string> labels;
  if (!rows.empty())
    for (const metrics::RendererResult& result : rows.front().results) labels.push_back(result.label);
  return labels;
}

/// `value` of one renderer, over all rows.
std::vector<std::optional<double>> column(const std::vector<Row>& rows, std::size_t renderer,
                                          std::optional<double> (*value)(const metrics::RendererResult&)) {
  std::vector<std::optional<double>> values;
  for (const Row& row : rows)
    values.push_back(renderer < row.results.size() ? value(row.results[renderer]) : std::nullopt);
  return values;
}
std::optional<double> mean_us(const metrics::RendererResult& r) {
  return r.frame ? r.frame->mean_us : std::nullopt;
}
std::optional<double> clocked_us(const metrics::RendererResult& r) {
  return r.frame ? r.frame->mean_clocked_us : std::nullopt;
}
std::optional<double> contact_frames(const metrics::RendererResult& r) {
  return r.frame ? std::optional<double>(static_cast<double>(r.frame->timed_frames)) : std::nullopt;
}
std::optional<double> all_mean_us(const metrics::RendererResult& r) {
  return r.frame_all ? r.frame_all->mean_us : std::nullopt;
}
std::optional<double> all_p999_us(const metrics::RendererResult& r) {
  return r.frame_all ? r.frame_all->p999_us : std::nullopt;
}
std::optional<double> p999_us(const metrics::RendererResult& r) {
  return r.frame ? r.frame->p999_us : std::nullopt;
}
std::optional<double> prepare_s(const metrics::RendererResult& r) {
  return r.prepare ? std::optional<double>(r.prepare->total_ms / kMsPerSecond) : std::nullopt;
}

/// A column a size, a group of rows a renderer.
Table growth_table(const Manifest& manifest, const std::vector<Row>& rows,
                   const metrics::ResultDocument& document) {
  Table table;
  table.title = manifest.title;
  table.columns = {"points"};
  for (const Row& row : rows) table.columns.push_back(count_text(row.points));
  const std::string frames = frames_text(document);
  const std::vector<std::string> labels = labels_of(rows);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    table.rows.push_back({{labels[i], false, false}});
    for (const auto& [name, value] :
         {std::pair{"frames in contact" + (frames.empty() ? "" : ", " + frames), &contact_frames},
          {"mean frame without the clock, µs", &mean_us},
          {"mean of all frames without the clock, µs", &all_mean_us},
          {"mean frame with the clock, µs", &clocked_us},
          {"99.9 % with the clock, µs", &p999_us},
          {"99.9 % of all frames with the clock, µs", &all_p999_us},
          {"preparation, s", &prepare_s}}) {
      table.rows.push_back({{name, false, false}});
      const std::vector<std::string> texts = aligned_numbers(column(rows, i, value));
      for (std::size_t k = 0; k < rows.size(); ++k) {
        const bool ok = i < rows[k].results.size() && rows[k].results[i].status == metrics::RunStatus::kOk;
        table.rows.back().push_back({ok ? texts[k] : "did not finish", false, !ok});
      }
    }
  }
  table.bad_means = "did not run to its end";
  for (const std::string& note : manifest.notes) table.notes.push_back(note);
  return table;
}

Chart growth_chart(const std::vector<Row>& rows, const char* name, const char* title, const char* y_label,
                   std::optional<double> (*value)(const metrics::RendererResult&)) {
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
  const std::vector<std::string> labels = labels_of(rows);
  const std::vector<Look> looks = looks_of(labels);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    Series series{labels[i], looks[i].colour, {}, {}, looks[i].dash};
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

/// "cloud's mean frame grows 2.33 times, from 0.148 to 0.344 µs", for each renderer.
std::vector<Headline> growth_headlines(const std::vector<Row>& rows) {
  std::vector<Headline> lines;
  if (rows.size() < 2) return lines;
  const std::vector<std::string> labels = labels_of(rows);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const auto mean = column(rows, i, &mean_us), prepare = column(rows, i, &prepare_s);
    if (!mean.front() || !mean.back() || !prepare.front() || !prepare.back()) continue;
    lines.push_back(
        {labels[i], fmt::format("mean frame {} times, from {} to {} µs; preparation {} times, from {} to {}",
                                short_number(*mean.back() / *mean.front()), short_number(mean.front()),
                                short_number(mean.back()), short_number(*prepare.back() / *prepare.front()),
                                duration_text(*prepare.front() * kMsPerSecond),
                                duration_text(*prepare.back() * kMsPerSecond))});
  }
  return lines;
}

}  // namespace

void reproduce_growth(const Manifest& manifest, Reproduction& r) {
  metrics::ResultDocument document = new_document(r.context.command_line);
  document.title = manifest.title;
  document.scene = "sinusoid over 100 x 100 mm, by number of points";
  std::vector<Row> rows;
  for (const ManifestModel& model : manifest.models) {
    if (model.if_room && !r.arguments.full && r.watch.ms() > kRoomForLargestMs) {
      r.missing.push_back(
          fmt::format("growth at {} points: no room within ten minutes; run with --full", model.name));
      break;
    }
    Result<Row> row = measure(manifest, model, r, document);
    if (!row) {
      r.missing.push_back(fmt::format("growth at {} points: {}", model.name, row.error().message()));
      break;
    }
    rows.push_back(*std::move(row));
  }
  if (const Result<OutputFolder> folder = r.folder.inside(manifest.id()))
    if (const Status written = folder->write("result.json", metrics::to_json(document)); !written)
      r.missing.push_back("growth/result.json: " + written.error().message());
  add_known(r.page, known_of("Growth", document));
  Table table = growth_table(manifest, rows, document);
  Section section{manifest.id(), "Growth with the number of points", {}, {manifest.text}, {table}, {}, {}};
  if (const Result<OutputFolder> figures = r.folder.inside("figures")) {
    section.figures.push_back(
        draw(growth_chart(rows, "growth", "Mean frame by number of points", "mean frame, µs", &mean_us),
             *figures));
    section.figures.push_back(draw(growth_chart(rows, "growth-preparation", "Preparation by number of points",
                                                "preparation, s", &prepare_s),
                                   *figures));
  }
  r.page.sections.push_back(std::move(section));
  if (rows.size() > 1)
    r.page.headlines.push_back({fmt::format("Growth from {} to {} points", count_text(rows.front().points),
                                            count_text(rows.back().points)),
                                growth_headlines(rows)});
  r.tables.push_back(std::move(table));
}

}  // namespace palpate::experiments
