#include <fmt/format.h>

#include "experiments/command/reproduction.h"

namespace palpate::experiments {
namespace {

// One surface of 100 x 100 mm and one path; 101, 319, 1001 and 3163 points squared.
constexpr std::uint64_t kSizes[] = {10201, 101761, 1002001, 10004569};
constexpr std::uint64_t kLargestInTime = 1002001;  // the next one needs minutes of its own
constexpr const char* kPath = "weave:frames=20000:rate_hz=1000:speed_mm_s=50:depth_mm=2:seed=1";
// Without --full the ten-million row starts only where the ten minutes of the default run leave room for it.
constexpr double kRoomForLargestMs = 330'000.0;
constexpr double kPrepareLimitS = 900.0;
constexpr const char* kRenderers[] = {"cloud", "mesh-godobject:mesh=original"};

struct Row {
  std::uint64_t points;
  std::vector<metrics::RendererResult> results;
};

Result<Row> measure(std::uint64_t points, Reproduction& r, metrics::ResultDocument& document) {
  const std::string spec = fmt::format("sinusoid:points={}", points);
  Result<scene::SceneFile> scene = scene::open_scene(spec);
  if (!scene) return std::move(scene).error();
  StageRequest request;
  request.scene_name = spec;
  request.scene = *std::move(scene);
  request.path = kPath;
  request.reference = ReferenceChoice::kNone;
  request.threads = r.arguments.threads;
  const Result<Stage> stage = set_up(request, r.readers, r.context.progress);
  if (!stage) return stage.error();
  document.path = stage->path.name;
  Row row{stage->scene.input.models.front().cloud->size(), {}};
  RunOptions options;
  options.threads = r.arguments.threads;
  options.prepare_limit_s = kPrepareLimitS;
  for (const char* name : kRenderers) {
    const Result<std::vector<RendererRequest>> requests = parse_renderers(name, r.registry);
    if (!requests) return requests.error();
    Result<Run> run = run_renderer(*stage, requests->front(), r.registry, options, r.context.progress);
    if (!run) return std::move(run).error();
    run->result.label = fmt::format("{}-{}", run->result.label, row.points);
    document.renderers.push_back(run->result);
    row.results.push_back(std::move(run->result));
  }
  return row;
}

Table growth_table(const std::vector<Row>& rows) {
  Table table;
  table.title = "Growth with the number of points, one surface and one path";
  table.columns = {"points",     "cloud: mean, µs", "99.9 %, µs", "preparation", "mesh-godobject: mean, µs",
                   "99.9 %, µs", "preparation"};
  for (const Row& row : rows) {
    std::vector<Cell> cells = {{count_text(row.points), false, false}};
    for (const metrics::RendererResult& result : row.results) {
      const bool ok = result.status == metrics::RunStatus::kOk && result.frame;
      cells.push_back({ok ? short_number(result.frame->mean_us) : "did not finish", false, !ok});
      cells.push_back({ok ? short_number(result.frame->p999_us) : "–", false, false});
      cells.push_back({result.prepare ? duration_text(result.prepare->total_ms) : "–", false, false});
    }
    table.rows.push_back(std::move(cells));
  }
  table.caption =
      "The mesh is the regular triangulation that the surface was generated with, so its preparation has no "
      "reconstruction in it.";
  return table;
}

Chart growth_chart(const std::vector<Row>& rows) {
  Chart chart;
  chart.name = "growth";
  chart.title = "Mean frame by number of points";
  chart.caption = "Contact frames, back to back, the same surface and path throughout.";
  chart.x_label = "points";
  chart.y_label = "mean frame, µs";
  chart.log_x = chart.log_y = true;
  chart.style = Chart::Style::kMarkedLines;
  const char* labels[] = {"cloud", "mesh-godobject"};
  for (std::size_t i = 0; i < std::size(labels); ++i) {
    Series series{labels[i], colour_of(labels[i], i), {}, {}};
    for (const Row& row : rows) {
      if (i >= row.results.size() || !row.results[i].frame || !row.results[i].frame->mean_us) continue;
      series.x.push_back(static_cast<double>(row.points));
      series.y.push_back(*row.results[i].frame->mean_us);
    }
    chart.series.push_back(std::move(series));
  }
  return chart;
}

std::string growth_headline(const std::vector<Row>& rows) {
  const auto mean = [](const Row& row) {
    return row.results.empty() || !row.results[0].frame ? std::nullopt : row.results[0].frame->mean_us;
  };
  if (rows.size() < 2 || !mean(rows.front()) || !mean(rows.back())) return {};
  return fmt::format("Growth: from {} to {} points the mean frame of cloud goes from {} to {} µs, {} times.",
                     count_text(rows.front().points), count_text(rows.back().points),
                     short_number(mean(rows.front())), short_number(mean(rows.back())),
                     short_number(*mean(rows.back()) / *mean(rows.front())));
}

}  // namespace

void measure_growth(Reproduction& r) {
  metrics::ResultDocument document = new_document(r.context.command_line);
  document.scene = "sinusoid over 100 x 100 mm, by number of points";
  std::vector<Row> rows;
  for (const std::uint64_t points : kSizes) {
    if (points > kLargestInTime && !r.arguments.full && r.watch.ms() > kRoomForLargestMs) {
      r.missing.push_back(fmt::format("growth at {} points: no room within ten minutes; run with --full",
                                      count_text(points)));
      break;
    }
    Result<Row> row = measure(points, r, document);
    if (!row) {
      r.missing.push_back(fmt::format("growth at {} points: {}", count_text(points), row.error().message()));
      break;
    }
    rows.push_back(*std::move(row));
    if (r.context.progress.cancelled()) break;
  }
  if (const Result<OutputFolder> folder = r.folder.inside("growth"))
    if (const Status written = folder->write("result.json", metrics::to_json(document)); !written)
      r.missing.push_back("growth/result.json: " + written.error().message());
  Table table = growth_table(rows);
  Section section{"growth", "Growth with the number of points", {}, {table}, {}, {}};
  if (const Result<OutputFolder> figures = r.folder.inside("figures"))
    section.figures.push_back(draw(growth_chart(rows), *figures));
  r.page.sections.push_back(std::move(section));
  if (const std::string headline = growth_headline(rows); !headline.empty())
    r.page.headlines.push_back(headline);
  r.tables.push_back(std::move(table));
}

}  // namespace palpate::experiments
