#include <fmt/format.h>

#include <algorithm>

#include "experiments/command/reproduction.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::experiments {
namespace {

constexpr std::uint64_t kPacedFrames = 5000;  // five seconds a renderer
constexpr std::uint64_t kQuickPacedFrames = 20;
// A preparation that takes longer is no baseline for a ten-minute run.
constexpr double kPrepareLimitS = 180.0, kFullPrepareLimitS = 3600.0;
constexpr double kMsPerMinute = 60000.0, kUsPerMs = 1000.0, kPercent = 100.0;

Cell plain(std::string text) {
  return {std::move(text), false, false};
}

/// Says what is missing. It is a failure only where it was asked for by name.
void give_up(Reproduction& r, const std::string& what, const Error& error) {
  r.missing.push_back(fmt::format("{}: {}", what, error.message()));
  if (!r.arguments.tables.empty()) r.fell_short = true;
}

struct Timed {
  double ms = 0.0;
  neighbourhood::NeighbourTable table;
};

/// The best of three: what else the machine does only adds.
Timed time_modified(const cloud::Cloud& cloud, int threads, bool complete) {
  constexpr int kRepeats = 3;
  Timed best;
  for (int i = 0; i < kRepeats; ++i) {
    neighbourhood::ModifiedKnnOptions options;
    options.complete_to_eight = complete;
    const Stopwatch watch;
    neighbourhood::NeighbourTable table = neighbourhood::modified_knn(cloud, options, threads);
    const double ms = watch.ms();
    if (i == 0 || ms < best.ms) best.ms = ms;
    best.table = std::move(table);
  }
  return best;
}

metrics::RendererResult neighbour_result(const std::string& model, const cloud::Cloud& cloud, bool complete,
                                         int threads, double ms) {
  metrics::RendererResult result;
  result.label = fmt::format("{}-{}-{}-threads", model, complete ? "completed" : "as-printed", threads);
  result.name = "modified-knn";
  result.options = {{"complete_to_eight", complete ? "true" : "false"}};
  result.model = metrics::RendererResult::Model{cloud.size(), 0.0};
  result.threads = threads;
  render::PrepareReport report;
  report.total_ms = ms;
  report.phases = {{"neighbours", ms}};
  report.bytes = cloud.size() * sizeof(neighbourhood::Neighbours);
  result.prepare = std::move(report);
  return result;
}

std::string agreement_note(const std::string& model, const cloud::Cloud& cloud,
                           const neighbourhood::NeighbourTable& modified) {
  const Result<neighbourhood::NeighbourTable> path = neighbourhood::scanner_path(cloud, 0);
  if (!path) return {};
  const neighbourhood::Agreement a = neighbourhood::agreement(*path, modified);
  const auto share = [](std::uint64_t part, std::uint64_t whole) {
    return whole == 0 ? 0.0 : kPercent * static_cast<double>(part) / static_cast<double>(whole);
  };
  return fmt::format(
      "Agreement with the scanner's path on the {}: the same eight neighbours at {:.1f} % of the {} points "
      "({:.1f} % of the {} interior ones); the thesis claims 100 %.",
      model, share(a.equal_sets, a.points), count_text(a.points), share(a.interior_equal, a.interior_points),
      count_text(a.interior_points));
}

}  // namespace

void reproduce_neighbours(const Manifest& manifest, Reproduction& r) {
  metrics::ResultDocument document = new_document(r.context.command_line);
  Table table;
  table.title = manifest.title;
  table.columns = {"model", "points", "thesis", "1 thread", "2 threads", "as printed, 1 thread"};
  table.notes = manifest.notes;
  for (const ManifestModel& model : manifest.models) {
    Result<scene::SceneFile> scene = scene_of(model, r);
    const Result<scene::LoadedScene> loaded = scene ? scene::load(*scene, r.readers, {}, r.context.progress)
                                                    : Result<scene::LoadedScene>(scene.error());
    const std::string printed = model.printed_min ? fmt::format("{} min", *model.printed_min) : "–";
    if (!loaded) {
      table.rows.push_back({plain(model.name),
                            plain("–"),
                            plain(printed),
                            {"did not run", false, true},
                            plain("–"),
                            plain("–")});
      give_up(r, fmt::format("table {}, {}", manifest.table, model.name), loaded.error());
      continue;
    }
    r.context.progress.report("building neighbours of the " + model.name, -1.0);
    const cloud::Cloud& cloud = *loaded->input.models.front().cloud;
    const Timed one = time_modified(cloud, 1, true), two = time_modified(cloud, 2, true),
                literal = time_modified(cloud, 1, false);
    for (const auto& [complete, threads, ms] :
         {std::tuple{true, 1, one.ms}, {true, 2, two.ms}, {false, 1, literal.ms}})
      document.renderers.push_back(neighbour_result(model.name, cloud, complete, threads, ms));
    table.rows.push_back({plain(model.name), plain(count_text(cloud.size())), plain(printed),
                          plain(duration_text(one.ms)), plain(duration_text(two.ms)),
                          plain(duration_text(literal.ms))});
    if (const std::string note = agreement_note(model.name, cloud, two.table); !note.empty())
      table.notes.insert(table.notes.begin(), note);
    if (model.printed_min)
      r.page.headlines.push_back(
          fmt::format("Table {}: neighbours of the {} in {} on one thread, {} on two; the thesis needed {} "
                      "({} times longer than one thread).",
                      manifest.table, model.name, duration_text(one.ms), duration_text(two.ms), printed,
                      short_number(*model.printed_min * kMsPerMinute / one.ms)));
  }
  table.caption =
      "Thesis: " + manifest.hardware +
      ". Ours: the best of three, completed to eight neighbours; as printed, a point may keep fewer.";
  if (const Result<OutputFolder> folder = r.folder.inside(fmt::format("table{}", manifest.table)))
    if (const Status written = folder->write("result.json", metrics::to_json(document)); !written)
      give_up(r, "table 6's result.json", written.error());
  Section section{fmt::format("table{}", manifest.table), manifest.title, {}, {table}, {}, {}};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  r.page.sections.push_back(std::move(section));
  r.tables.push_back(std::move(table));
}

Table frames_table(const Manifest& manifest, const metrics::ResultDocument& document) {
  Table table;
  table.title = manifest.title;
  table.columns = {"", "thesis"};
  for (const metrics::RendererResult& r : document.renderers) table.columns.push_back(r.label);
  const auto row = [&](const char* name, const std::string& printed, const auto& value) {
    std::vector<Cell> cells = {plain(name), plain(printed)};
    for (const metrics::RendererResult& r : document.renderers) {
      if (r.status == metrics::RunStatus::kOk)
        cells.push_back(plain(value(r)));
      else
        cells.push_back({r.status == metrics::RunStatus::kFailed ? "failed" : "did not finish", false, true});
    }
    table.rows.push_back(std::move(cells));
  };
  using R = metrics::RendererResult;
  const auto us = [](double ms) { return short_number(ms * kUsPerMs); };
  row("points",
      document.renderers.empty() || !document.renderers.front().model
          ? "–"
          : count_text(document.renderers.front().model->points),
      [](const R& r) { return r.model ? count_text(r.model->points) : std::string("–"); });
  row("frames in contact", count_text(manifest.printed_frames),
      [](const R& r) { return r.frame ? count_text(r.frame->contact_frames) : std::string("–"); });
  row("fastest, µs", us(manifest.printed_min_ms),
      [](const R& r) { return short_number(r.frame ? r.frame->min_us : std::nullopt); });
  row("slowest, µs", us(manifest.printed_max_ms),
      [](const R& r) { return short_number(r.frame ? r.frame->max_us : std::nullopt); });
  row("average, µs", us(manifest.printed_mean_ms),
      [](const R& r) { return short_number(r.frame ? r.frame->mean_us : std::nullopt); });
  row("99.9 %, µs", "–", [](const R& r) { return short_number(r.frame ? r.frame->p999_us : std::nullopt); });
  row("preparation", "–",
      [](const R& r) { return r.prepare ? duration_text(r.prepare->total_ms) : std::string("–"); });
  row("missed / false contact, frames", "none felt", [](const R& r) {
    return r.accuracy ? fmt::format("{} / {}", count_text(r.accuracy->missed_contact_frames),
                                    count_text(r.accuracy->false_contact_frames))
                      : std::string("–");
  });
  row("longest stick, frames", "–", [](const R& r) {
    return r.accuracy ? count_text(r.accuracy->longest_stick_frames) : std::string("–");
  });
  table.caption = "Thesis: " + manifest.hardware +
                  ". Fastest and slowest contain the cost of reading the clock; the average does not.";
  table.notes = manifest.notes;
  return table;
}

void reproduce_frames(const Manifest& manifest, Reproduction& r) {
  const std::string what = fmt::format("table {}", manifest.table);
  const bool quick = r.arguments.quick;
  const ManifestModel& model = manifest.models.front();
  Result<scene::SceneFile> scene = scene_of(model, r);
  if (!scene) return give_up(r, what, scene.error());
  StageRequest request;
  request.scene_name = model.generate.empty()
                           ? fmt::format("{} (unit {}, scale {})", model.scan, model.unit, model.scale)
                           : scene->path;
  request.scene = *std::move(scene);
  request.path = quick ? manifest.quick_path : manifest.path;
  request.threads = r.arguments.threads;
  request.contact_frames = quick ? 0 : manifest.contact_frames;
  Study study;
  study.name = fmt::format("Table {} ({})", manifest.table, model.name);
  study.title = manifest.title;
  study.text = manifest.text;
  study.document = new_document(r.context.command_line);
  Result<Stage> stage = set_up(request, r.readers, r.context.progress);
  if (!stage) return give_up(r, what, stage.error());
  study.stage = *std::move(stage);

  RunOptions options;
  options.threads = r.arguments.threads;
  options.paced_frames = quick ? kQuickPacedFrames : kPacedFrames;
  options.prepare_limit_s = r.arguments.full ? kFullPrepareLimitS : kPrepareLimitS;
  for (const ManifestRun& wanted : manifest.runs) {
    const std::string& text = quick && !wanted.quick.empty() ? wanted.quick : wanted.renderer;
    const Result<std::vector<RendererRequest>> requests = parse_renderers(text, r.registry);
    Result<Run> run =
        requests ? run_renderer(study.stage, requests->front(), r.registry, options, r.context.progress)
                 : Result<Run>(requests.error());
    if (!run) {
      give_up(r, what + ", " + text, run.error());
      continue;
    }
    if (run->result.status != metrics::RunStatus::kOk) {
      r.missing.push_back(fmt::format("{}, {}: {}", what, run->result.label, run->result.reason));
      r.fell_short = true;
    }
    study.runs.push_back(*std::move(run));
    if (r.context.progress.cancelled()) break;
  }
  finish_document(study);
  const Result<OutputFolder> folder = r.folder.inside(fmt::format("table{}", manifest.table));
  const Status written = folder ? write_study(study, *folder) : Status(folder.error());
  if (!written) {
    give_up(r, what, written.error());
    r.fell_short = true;
  }
  r.context.progress.report("drawing the figures", -1.0);
  add_study(r.page, study, fmt::format("table{}", manifest.table), r.folder);
  Table table = frames_table(manifest, study.document);
  Section& section = r.page.sections.back();
  section.tables.insert(section.tables.begin(), table);
  r.tables.push_back(std::move(table));
}

}  // namespace palpate::experiments
