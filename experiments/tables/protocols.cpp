// Three accuracy protocols: coarser versions of a scan, points off a mesh's vertices, a simulated scanner.
// The truth, a formula or finer mesh, is hidden from renderers; the path follows it.
#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/data/scans.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/statistics.h"

namespace palpate::experiments {
namespace {

using metrics::Accuracy;
using metrics::RendererResult;

// One pass of each kind: frame times are not measured here.
constexpr double kProtocolBudgetS = 1.0;
constexpr double kProtocolPrepareLimitS = 120.0;
constexpr const char* kSeedHere = "@";

/// One renderer on one model, with a result per seed.
struct ProtocolRow {
  std::string model, label;
  std::vector<RendererResult> seeds;
};

/// `text` with each @ replaced by the seed.
std::string with_seed(std::string text, int seed) {
  for (std::size_t at = text.find(kSeedHere); at != std::string::npos; at = text.find(kSeedHere))
    text.replace(at, 1, fmt::format("{}", seed));
  return text;
}

Result<std::string> truth_file(const std::string& scan, Reproduction& r) {
  ManifestModel alone;
  alone.scan = scan;
  PALPATE_ASSIGN(const ModelScene scene, scene_of(alone, r));
  return scene.file.models.front().cloud;
}

Result<StageRequest> request_for(const Manifest& manifest, const ManifestModel& model, int seed,
                                 Reproduction& r) {
  const bool quick = r.arguments.quick;
  ManifestModel one = model;
  one.generate = with_seed(model.generate, seed);
  one.quick = with_seed(model.quick, seed);
  StageRequest request;
  PALPATE_ASSIGN(ModelScene scene, scene_of(one, r));
  request.scene = std::move(scene.file);
  if (!model.sample.empty()) {
    PALPATE_ASSIGN(request.scene.models.front().sample,
                   parse_named_options(with_seed(
                       quick && !model.quick_sample.empty() ? model.quick_sample : model.sample, seed)));
  }
  if (!model.reference.empty() && !(quick && !model.quick.empty())) {
    request.reference = ReferenceChoice::kMeshFile;
    PALPATE_ASSIGN(request.reference_file, truth_file(model.reference, r));
  }
  request.scene_name = request.scene.path;
  request.path = quick && !manifest.quick_path.empty() ? manifest.quick_path : manifest.path;
  request.threads = r.arguments.threads;
  return request;
}

Status measure_model(const Manifest& manifest, const ManifestModel& model, int seed, Reproduction& r,
                     metrics::ResultDocument& document, std::vector<ProtocolRow>& rows) {
  PALPATE_ASSIGN(const StageRequest request, request_for(manifest, model, seed, r));
  PALPATE_ASSIGN(const Stage stage, set_up(request, r.readers, r.context.progress));
  document.path = stage.path.name;
  RunOptions options = run_options(r, kProtocolPrepareLimitS);
  options.passes = 1;
  options.budget_s = kProtocolBudgetS;
  PALPATE_ASSIGN(const std::vector<RendererRequest> requests, requests_of(manifest, r));
  PALPATE_ASSIGN(std::vector<Run> runs, run_on(stage, requests, options, r, document));
  for (Run& run : runs) {
    if (run.result.status != metrics::RunStatus::kOk)
      leave_out(
          r, fmt::format("{}, {} on {}: {}", manifest.id(), run.result.label, model.name, run.result.reason));
    document.renderers.push_back(run.result);
    document.renderers.back().label = fmt::format("{}-{}-{}", model.name, seed, run.result.label);
    auto row = std::find_if(rows.begin(), rows.end(), [&](const ProtocolRow& one) {
      return one.model == model.name && one.label == run.result.label;
    });
    if (row == rows.end()) row = rows.insert(rows.end(), {model.name, run.result.label, {}});
    row->seeds.push_back(std::move(run.result));
  }
  return Done{};
}

std::vector<double> over_seeds(const ProtocolRow& row, const ScoreGet& get) {
  std::vector<double> values;
  for (const RendererResult& result : row.seeds)
    if (const std::optional<double> value = get(result)) values.push_back(*value);
  return values;
}

std::optional<double> middle(const ProtocolRow& row, const ScoreGet& get) {
  std::vector<double> values = over_seeds(row, get);
  return values.empty() ? std::nullopt : std::optional(upper_median(std::move(values)));
}

std::string range_text(const ProtocolRow& row) {
  const std::vector<double> values = over_seeds(row, accuracy_score(&Accuracy::force_rms_percent));
  if (values.size() < 2) return kMissingNumber;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return fmt::format("{} to {}", format_number(*low), format_number(*high));
}

/// A row per renderer and model; medians over the seeds.
Table protocol_table(const Manifest& manifest, const std::vector<ProtocolRow>& rows) {
  Table table;
  table.title = manifest.title;
  table.columns = {"model", "renderer"};
  for (const ProtocolRow& row : rows) table.rows.push_back(plain_row({row.model, row.label}));
  const auto add = [&](const char* name, const auto& text_of) {
    table.columns.emplace_back(name);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const bool ran = std::any_of(rows[i].seeds.begin(), rows[i].seeds.end(), [](const RendererResult& one) {
        return one.status == metrics::RunStatus::kOk;
      });
      table.rows[i].push_back({ran ? text_of(rows[i]) : std::string("did not finish"), false, !ran});
    }
  };
  const auto number = [&](const char* name, const auto& member) {
    add(name, [&](const ProtocolRow& row) { return format_number(middle(row, accuracy_score(member))); });
  };
  add("points", [](const ProtocolRow& row) {
    return row.seeds.front().model ? format_count(row.seeds.front().model->points)
                                   : std::string(kMissingNumber);
  });
  number("history decides, % of contact", &Accuracy::history_percent);
  number("force error, median, %", &Accuracy::force_p50_percent);
  number("95 %, %", &Accuracy::force_p95_percent);
  number("RMS, %", &Accuracy::force_rms_percent);
  add("RMS over the seeds, %", range_text);
  number("missed beyond 0.055 mm", &Accuracy::missed_device_frames);
  number("false beyond 0.055 mm", &Accuracy::false_device_frames);
  number("missed beyond 0.1 mm", &Accuracy::missed_tenth_mm_frames);
  number("false beyond 0.1 mm", &Accuracy::false_tenth_mm_frames);
  number("missed beyond a spacing", &Accuracy::missed_contact_frames);
  number("false beyond a spacing", &Accuracy::false_contact_frames);
  table.bad_means = "did not run to its end";
  table.caption =
      "Frames and percent are medians over the seeds. The truth is the formula, or a mesh that no "
      "renderer sees. Rows that begin with floor- are other triangulations of the same points: what "
      "the points alone leave open.";
  table.notes = manifest.notes;
  return table;
}

/// Per model: "cloud 0.82 % (median 0.1 %, 95 % 1.2 %), floor 0.7 %".
std::vector<Headline> protocol_headlines(const std::vector<ProtocolRow>& rows) {
  std::vector<Headline> lines;
  for (const ProtocolRow& row : rows) {
    const auto text = [&](std::optional<double> Accuracy::*member) {
      return format_number(middle(row, accuracy_score(member)));
    };
    if (!middle(row, accuracy_score(&Accuracy::force_rms_percent))) continue;
    if (lines.empty() || lines.back().lead != row.model) lines.push_back({row.model, ""});
    lines.back().text +=
        fmt::format("{}{} {} % (median {}, 95 % {})", lines.back().text.empty() ? "force error, RMS: " : "; ",
                    row.label, text(&Accuracy::force_rms_percent), text(&Accuracy::force_p50_percent),
                    text(&Accuracy::force_p95_percent));
  }
  return lines;
}

}  // namespace

void reproduce_protocol(const Manifest& manifest, Reproduction& r) {
  metrics::ResultDocument document = new_document(r.context.command_line);
  document.title = manifest.title;
  document.scene = manifest.id();
  std::vector<ProtocolRow> rows;
  for (const ManifestModel& model : manifest.models) {
    if (model.full && !r.arguments.full) continue;
    const std::uint64_t seeds = r.arguments.quick ? 1 : std::max<std::uint64_t>(1, model.seeds);
    for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
      const Status done = measure_model(manifest, model, static_cast<int>(seed), r, document, rows);
      if (done) continue;
      leave_out(r, fmt::format("{}, {}", manifest.id(), model.name), done.error());
      break;
    }
  }
  check_done(r, !rows.empty());
  if (rows.empty()) return;
  write_beside(r, manifest, "result.json", metrics::to_json(document));
  r.part.sections.push_back({manifest.id(),
                             manifest.title,
                             {},
                             {manifest.text},
                             {protocol_table(manifest, rows)},
                             {},
                             {},
                             protocol_headlines(rows)});
}

// Growth with the number of points, measured: "largely insensitive" in the thesis (section 3.6.2).

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
