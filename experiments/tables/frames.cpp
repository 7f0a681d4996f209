#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/tables/reproduction.h"

namespace palpate::experiments {

void give_up(Reproduction& r, const std::string& what, const Error& error) {
  r.missing.push_back(fmt::format("{}: {}", what, error.message()));
  check_done(r, false);
}

void leave_out(Reproduction& r, const std::string& what, const Error& error) {
  r.missing.push_back(fmt::format("{}: {}", what, error.message()));
}

void check_done(Reproduction& r, bool anything) {
  if (!anything && !r.arguments.tables.empty()) r.fell_short = true;
}

void set_passes(RunOptions& options, const Reproduction& r) {
  constexpr double kFullBudgetS = 60.0;
  constexpr std::uint64_t kQuickPasses = 3;
  if (r.arguments.quick) options.passes = kQuickPasses;
  if (r.arguments.full) options.budget_s = kFullBudgetS;
}

void add_warnings(std::vector<std::string>& warnings, const std::string& model,
                  const scene::LoadedScene& loaded) {
  for (const scene::Provenance& p : loaded.provenance)
    for (const std::string& warning : p.warnings) warnings.push_back(model + ": " + warning);
}

namespace {

constexpr std::uint64_t kPacedFrames = 5000;  // five seconds a renderer
constexpr std::uint64_t kQuickPacedFrames = 20;
// A preparation that takes longer is no baseline for a ten-minute run.
constexpr double kPrepareLimitS = 180.0, kFullPrepareLimitS = 3600.0;
constexpr double kUsPerMs = 1000.0;

using R = metrics::RendererResult;
using Value = std::optional<double>;
using Count = std::optional<std::uint64_t>;

auto frame_value(Value trace::FrameStatistics::*member) {
  return [member](const R& r) { return r.frame ? (*r.frame).*member : std::nullopt; };
}
auto all_value(Value trace::FrameStatistics::*member) {
  return [member](const R& r) { return r.frame_all ? (*r.frame_all).*member : std::nullopt; };
}
auto score_value(Value metrics::Accuracy::*member) {
  return [member](const R& r) { return settled_score(r, member); };
}
auto score_count(Count metrics::Accuracy::*member) {
  return [member](const R& r) { return r.accuracy ? (*r.accuracy).*member : Count(); };
}
auto defect_count(std::uint64_t metrics::Accuracy::*member) {
  return [member](const R& r) { return r.accuracy ? Count((*r.accuracy).*member) : Count(); };
}

/// Rows of a name, what is printed, and a value of every renderer.
class BesideThesis {
 public:
  BesideThesis(Table& table, const metrics::ResultDocument& document) : table_(table), document_(document) {}

  template <class Of>
  void counts(const std::string& name, const std::string& printed, const Of& value) {
    std::vector<std::string> texts;
    for (const R& r : document_.renderers) {
      const Count n = value(r);
      texts.push_back(n ? count_text(*n) : kNoNumber);
    }
    put(name, printed, std::move(texts));
  }
  template <class Of>
  void numbers(const std::string& name, const std::string& printed, const Of& value) {
    put(name, printed, aligned_numbers(values(value)));
  }
  template <class Of>
  void texts(const std::string& name, const Of& text) {
    std::vector<std::string> all;
    for (const R& r : document_.renderers) all.push_back(text(r));
    put(name, kNoNumber, std::move(all));
  }
  template <class Of>
  void times(const std::string& name, const Of& value_ms) {
    AlignedTimes aligned = aligned_times(values(value_ms));
    put(name + ", " + aligned.unit, kNoNumber, std::move(aligned.texts));
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
  const std::string all = frames_text(document);
  rows.counts("frames in contact" + (all.empty() ? "" : ", ours " + all), count_text(manifest.printed_frames),
              [](const R& r) { return r.frame ? Count(r.frame->timed_frames) : Count(); });
  rows.numbers("fastest frame, µs", us(manifest.printed_min_ms), frame_value(&F::min_us));
  rows.numbers("slowest frame, µs", us(manifest.printed_max_ms), frame_value(&F::max_us));
  rows.numbers("average frame, µs", us(manifest.printed_mean_ms), frame_value(&F::mean_clocked_us));
  table.rows.push_back({plain("Not in the thesis")});
  rows.numbers("average without the clock, µs", kNoNumber, frame_value(&F::mean_us));
  rows.texts("its interval, 95 %", [](const R& r) {
    return r.frame ? interval_text(r.frame->mean_interval_us) : std::string(kNoNumber);
  });
  rows.numbers("average of all frames without the clock, µs", kNoNumber, all_value(&F::mean_us));
  rows.texts("its interval, 95 %, of all frames", [](const R& r) {
    return r.frame_all ? interval_text(r.frame_all->mean_interval_us) : std::string(kNoNumber);
  });
  rows.numbers("99.9 % of frames within, µs", kNoNumber, frame_value(&F::p999_us));
  rows.numbers("99.9 % of all frames within, µs", kNoNumber, all_value(&F::p999_us));
  rows.times("preparation", [](const R& r) { return r.prepare ? Value(r.prepare->total_ms) : Value(); });
  rows.counts("missed contact, frames", kNoNumber, defect_count(&A::missed_contact_frames));
  rows.counts("false contact, frames", kNoNumber, defect_count(&A::false_contact_frames));
  rows.counts("longest stick, frames", kNoNumber, defect_count(&A::longest_stick_frames));
  rows.numbers("frames that no hand tells from the truth, %", kNoNumber,
               score_value(&A::indistinguishable_percent));
  rows.numbers("force error, RMS, %", kNoNumber, score_value(&A::force_rms_percent));
  rows.numbers("force error, median, %", kNoNumber, score_value(&A::force_p50_percent));
  rows.numbers("force error, 95 %, %", kNoNumber, score_value(&A::force_p95_percent));
  rows.numbers("frames where history decides, % of contact", kNoNumber, score_value(&A::history_percent));
  rows.counts("missed beyond 0.1 mm, frames", kNoNumber, score_count(&A::missed_tenth_mm_frames));
  rows.counts("false beyond 0.1 mm, frames", kNoNumber, score_count(&A::false_tenth_mm_frames));
  rows.numbers("force direction, 99 % within, degrees", kNoNumber, score_value(&A::direction_p99_deg));
  rows.numbers("god object error, RMS, mm", kNoNumber, score_value(&A::god_object_rms_mm));
  table.caption = "Thesis: " + manifest.hardware +
                  ". Ours: single frames, each with the cost of reading the clock in it, but for the average "
                  "without the clock, which is of whole stretches of frames. All renderers over the same "
                  "frames, those of the ground truth's contact.";
  table.turns = true;
  table.bad_means = "did not run to its end";
  table.notes = manifest.notes;
  return table;
}

Table add_frames(Page& page, const Manifest& manifest, const Study& study, const OutputFolder& folder) {
  add_study(page, study, manifest.id(),
            fmt::format("Table {} ({})", manifest.table, manifest.models.front().name), folder);
  page.headlines.back().lines.push_back(
      {"The thesis", fmt::format("mean frame in contact {} µs, on a {}",
                                 short_number(manifest.printed_mean_ms * kUsPerMs), manifest.hardware)});
  Table table = frames_table(manifest, study.document);
  Section& section = page.sections.back();
  section.tables.insert(section.tables.begin(), table);
  return table;
}

void reproduce_frames(const Manifest& manifest, Reproduction& r) {
  const std::string what = fmt::format("table {}", manifest.table);
  const bool quick = r.arguments.quick;
  const ManifestModel& model = manifest.models.front();
  const std::size_t stand_ins = r.stand_ins.size();
  Result<scene::SceneFile> scene = scene_of(model, r);
  if (!scene) return give_up(r, what, scene.error());
  const bool stand_in = r.stand_ins.size() > stand_ins;
  StageRequest request;
  request.scene_name = model.generate.empty() && model.scene.empty()
                           ? fmt::format("{} (unit {}, scale {})", model.scan, model.unit, model.scale)
                           : scene->path;
  const bool scanned = !scene->models.front().scan.empty() && !manifest.scan_path.empty();
  request.scene = *std::move(scene);
  request.path = quick ? manifest.quick_path : scanned ? manifest.scan_path : manifest.path;
  request.threads = r.arguments.threads;
  request.contact_frames = quick ? 0 : manifest.contact_frames;
  StagedStudy study;
  study.document = new_document(r.context.command_line);
  study.document.title = manifest.title + (stand_in ? ", on a STAND-IN" : "");
  study.document.about = manifest.text;
  if (stand_in)
    study.document.about +=
        fmt::format(" The scan could not be had: this ran on a stand-in of the same size and spacing, {}.",
                    request.scene_name);
  if (stand_in) r.missing.push_back("stand-in instead of " + r.stand_ins.back());
  Result<Stage> stage = set_up(request, r.readers, r.context.progress);
  if (!stage) return give_up(r, what, stage.error());
  study.stage = *std::move(stage);

  RunOptions options;
  options.threads = r.arguments.threads;
  options.paced_frames = quick ? kQuickPacedFrames : manifest.paced || r.arguments.full ? kPacedFrames : 0;
  options.prepare_limit_s = r.arguments.full ? kFullPrepareLimitS : kPrepareLimitS;
  set_passes(options, r);
  std::vector<RendererRequest> wanted;
  for (const ManifestRun& run : manifest.runs) {
    const std::string& text = quick && !run.quick.empty() ? run.quick : run.renderer;
    Result<std::vector<RendererRequest>> requests = parse_renderers(text, r.registry);
    if (!requests) {
      give_up(r, what + ", " + text, requests.error());
      continue;
    }
    wanted.push_back(std::move(requests->front()));
    limit_reconstruction(wanted.back(), r);
  }
  Result<std::vector<Run>> runs = run_renderers(study.stage, wanted, r.registry, options, r.context.progress,
                                                study.document.conditions.emplace(), {});
  if (!runs) return give_up(r, what, runs.error());
  add_program(*study.document.conditions);
  study.runs = *std::move(runs);
  for (const Run& run : study.runs) {
    if (run.result.status == metrics::RunStatus::kOk) continue;
    r.missing.push_back(fmt::format("{}, {}: {}", what, run.result.label, run.result.reason));
    r.fell_short = true;
  }
  const Result<OutputFolder> folder = r.folder.inside(manifest.id());
  const Status written = folder ? write_study(study, *folder) : Status(folder.error());
  const Result<Study> whole = written ? read_study(folder->path()) : Result<Study>(written.error());
  if (!whole) {
    r.fell_short = true;
    return give_up(r, what, whole.error());
  }
  r.context.progress.report("drawing the figures", -1.0);
  r.tables.push_back(add_frames(r.page, manifest, *whole, r.folder));
}

}  // namespace palpate::experiments
