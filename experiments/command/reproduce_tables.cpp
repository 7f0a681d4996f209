#include <fmt/format.h>

#include <algorithm>
#include <cmath>

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

std::string whole_ms(double ms) {
  return count_text(static_cast<std::uint64_t>(std::llround(ms)));
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
  table.columns = {"model",        "points",        "thesis, min",
                   "1 thread, ms", "2 threads, ms", "as printed, 1 thread, ms"};
  HeadlineGroup found{manifest.title, {}};
  table.notes = manifest.notes;
  for (const ManifestModel& model : manifest.models) {
    Result<scene::SceneFile> scene = scene_of(model, r);
    const Result<scene::LoadedScene> loaded = scene ? scene::load(*scene, r.readers, {}, r.context.progress)
                                                    : Result<scene::LoadedScene>(scene.error());
    const std::string printed = model.printed_min ? fmt::format("{:.2f}", *model.printed_min) : "–";
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
                          plain(whole_ms(one.ms)), plain(whole_ms(two.ms)), plain(whole_ms(literal.ms))});
    if (const std::string note = agreement_note(model.name, cloud, two.table); !note.empty())
      table.notes.insert(table.notes.begin(), note);
    if (model.printed_min)
      found.lines.push_back(
          {fmt::format("{}, {} points", model.name, count_text(cloud.size())),
           fmt::format("neighbours in {} on one thread, {} on two; the thesis: {} min, {} times one thread's",
                       duration_text(one.ms), duration_text(two.ms), printed,
                       short_number(*model.printed_min * kMsPerMinute / one.ms))});
  }
  r.page.headlines.push_back(std::move(found));
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

namespace {

using R = metrics::RendererResult;
using Value = std::optional<double>;
using Count = std::optional<std::uint64_t>;

auto frame_value(Value trace::FrameStatistics::*member) {
  return [member](const R& r) { return r.frame ? (*r.frame).*member : std::nullopt; };
}
auto score_value(Value metrics::Accuracy::*member) {
  return [member](const R& r) { return r.accuracy ? (*r.accuracy).*member : std::nullopt; };
}
auto defect_count(std::uint64_t metrics::Accuracy::*member) {
  return [member](const R& r) { return r.accuracy ? Count((*r.accuracy).*member) : Count(); };
}

/// Rows of a name, what is printed, and a value of every renderer.
class BesideThesis {
 public:
  BesideThesis(Table& table, const metrics::ResultDocument& document) : table_(table), document_(document) {}

  template <class Of>
  void counts(const char* name, const std::string& printed, const Of& value) {
    std::vector<std::string> texts;
    for (const R& r : document_.renderers) {
      const Count n = value(r);
      texts.push_back(n ? count_text(*n) : std::string("–"));
    }
    put(name, printed, std::move(texts));
  }
  template <class Of>
  void numbers(const char* name, const std::string& printed, const Of& value) {
    put(name, printed, aligned_numbers(values(value)));
  }
  template <class Of>
  void times(const std::string& name, const Of& value_ms) {
    AlignedTimes aligned = aligned_times(values(value_ms));
    put(name + ", " + aligned.unit, "–", std::move(aligned.texts));
  }

 private:
  template <class Of>
  std::vector<Value> values(const Of& value) const {
    std::vector<Value> all;
    for (const R& r : document_.renderers) all.push_back(value(r));
    return all;
  }
  void put(const std::string& name, const std::string& printed, std::vector<std::string> texts) {
    std::vector<Cell> cells = {plain(name), plain(printed)};
    for (std::size_t i = 0; i < texts.size(); ++i) {
      const metrics::RunStatus status = document_.renderers[i].status;
      if (status == metrics::RunStatus::kOk)
        cells.push_back(plain(std::move(texts[i])));
      else
        cells.push_back({status == metrics::RunStatus::kFailed ? "failed" : "did not finish", false, true});
    }
    table_.rows.push_back(std::move(cells));
  }

  Table& table_;
  const metrics::ResultDocument& document_;
};

}  // namespace

Table frames_table(const Manifest& manifest, const metrics::ResultDocument& document) {
  using F = trace::FrameStatistics;
  using A = metrics::Accuracy;
  Table table;
  table.title = manifest.title;
  table.columns = {"", "thesis"};
  for (const R& r : document.renderers) table.columns.push_back(r.label);
  // As many digits as are printed, moved by three places.
  const auto us = [](double ms) { return fmt::format("{:.1f}", ms * kUsPerMs); };
  BesideThesis rows(table, document);
  rows.counts("points", count_text(manifest.printed_points),
              [](const R& r) { return r.model ? Count(r.model->points) : Count(); });
  rows.counts("frames in contact", count_text(manifest.printed_frames),
              [](const R& r) { return r.frame ? Count(r.frame->contact_frames) : Count(); });
  rows.numbers("fastest frame, µs", us(manifest.printed_min_ms), frame_value(&F::min_us));
  rows.numbers("slowest frame, µs", us(manifest.printed_max_ms), frame_value(&F::max_us));
  rows.numbers("average frame, µs", us(manifest.printed_mean_ms), frame_value(&F::mean_us));
  table.rows.push_back({plain("Not in the thesis")});
  rows.numbers("99.9 % of frames within, µs", "–", frame_value(&F::p999_us));
  rows.times("preparation", [](const R& r) { return r.prepare ? Value(r.prepare->total_ms) : Value(); });
  rows.counts("missed contact, frames", "–", defect_count(&A::missed_contact_frames));
  rows.counts("false contact, frames", "–", defect_count(&A::false_contact_frames));
  rows.counts("longest stick, frames", "–", defect_count(&A::longest_stick_frames));
  rows.numbers("force error, RMS, %", "–", score_value(&A::force_rms_percent));
  rows.numbers("force direction, 99 % within, degrees", "–", score_value(&A::direction_p99_deg));
  rows.numbers("god object error, RMS, mm", "–", score_value(&A::god_object_rms_mm));
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
  if (!r.page.headlines.empty())
    for (Headline& line : r.page.headlines.back().lines)
      if (line.lead == "Mean frame in contact")
        line.text += fmt::format("; the thesis: {} µs, on a {}",
                                 short_number(manifest.printed_mean_ms * kUsPerMs), manifest.hardware);
  Section& section = r.page.sections.back();
  section.tables.insert(section.tables.begin(), table);
  r.tables.push_back(std::move(table));
}

}  // namespace palpate::experiments
