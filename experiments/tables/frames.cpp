// Tables 7 to 10, 12 and 13: the printed frame times beside ours, each a study of its own.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/tables/reproduction.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr std::uint64_t kPacedFrames = 5000;  // five seconds per renderer
constexpr std::uint64_t kQuickPacedFrames = 20;
constexpr double kFramesPrepareLimitS = 180.0;
constexpr double kUsPerMs = 1000.0;
constexpr const char* kStandIn = ", on a STAND-IN";

using R = metrics::RendererResult;

/// The first that ran of those for which `is` holds.
template <class Is>
const R* first_of(const metrics::ResultDocument& document, const Is& is) {
  for (const R& r : document.renderers)
    if (r.status == metrics::RunStatus::kOk && r.frame && r.frame->mean_us && is(r)) return &r;
  return nullptr;
}

Judged judged(bool yes) {
  return yes ? Judged::kYes : Judged::kNo;
}
Judged contact_judged(const R* r) {
  return r == nullptr || !r->accuracy ? Judged::kNot : judged(contact_faults(*r).empty());
}

/// "13,141 frames of wrong contact", or the first other fault.
std::string short_fault(const R& r) {
  const std::uint64_t wrong = r.accuracy->missed_contact_frames + r.accuracy->false_contact_frames;
  if (wrong > 0) return format_count(wrong) + " frames of wrong contact";
  const std::string faults = contact_faults(r);
  return faults.substr(0, faults.find(", "));
}

std::string error_text(const R* r) {
  const std::optional<double> percent =
      r == nullptr ? std::nullopt : settled_score(*r, &metrics::Accuracy::force_rms_percent);
  return percent ? format_number(*percent) + " %" : kMissingNumber;
}

std::string status_of(const Answer& answer, const R* literal, const R& ours) {
  if (answer.as_fast == Judged::kNo) return "not reproduced: slower than printed";
  if (answer.ours_right == Judged::kNo) return "in part: contact is wrong, " + short_fault(ours);
  if (answer.literal_right == Judged::kNo)
    return "in part: as fast; as printed " + short_fault(*literal) + ", made right none";
  return "reproduced";
}

}  // namespace

Answer frames_answer(const Manifest& manifest, const metrics::ResultDocument& document) {
  const auto role = [](render::Role wanted) { return [wanted](const R& r) { return r.role == wanted; }; };
  const R* literal = first_of(document, role(render::Role::kLiteral));
  const R* ours = first_of(document, role(render::Role::kOurs));
  const R* mesh = first_of(document, [](const R& r) { return r.works_on == render::Geometry::kMesh; });
  const double printed_us = manifest.printed_mean_ms * kUsPerMs;
  Answer answer;
  answer.table = fmt::format("{}", manifest.table);
  answer.page = manifest.id() + ".html";
  answer.says = manifest.title.substr(manifest.title.find(": ") + 1) + ": mean frame in contact";
  answer.printed = fmt::format("{:.1f} µs, {}", printed_us, manifest.hardware);
  answer.status = "not measured";
  if (ours == nullptr) return answer;
  const auto text = [](const R& r) { return r.label + " " + format_number(*r.frame->mean_us) + " µs"; };
  if (literal != nullptr) answer.literal = text(*literal);
  answer.ours = text(*ours);
  answer.error = error_text(ours);
  answer.mesh_error = error_text(mesh);
  answer.take = choice_of(document).label;
  answer.literal_right = contact_judged(literal);
  answer.ours_right = contact_judged(ours);
  // A quick trial uses a small part of the model: nothing to hold against the printed time.
  if (!ours->model || ours->model->points < manifest.printed_points / 2) {
    answer.status = "tried on a small model only";
    answer.literal_right = answer.ours_right = Judged::kNot;
    answer.take.clear();
    return answer;
  }
  answer.ratio = printed_us / *ours->frame->mean_us;
  answer.as_fast = judged(*(literal != nullptr ? literal : ours)->frame->mean_us <= printed_us);
  answer.status = status_of(answer, literal, *ours);
  answer.reproduced = judged(answer.status == "reproduced");
  if (document.title.ends_with(kStandIn)) answer.status += ", on a stand-in";
  return answer;
}

Table frames_table(const Manifest& manifest, const metrics::ResultDocument& document) {
  using F = trace::FrameStatistics;
  using A = metrics::Accuracy;
  Table table;
  table.title = manifest.title;
  table.columns = {"", "thesis"};
  for (const R& r : document.renderers) table.columns.push_back(r.label);
  const auto row = [&](const std::string& name, const std::string& printed, Show show, const ScoreGet& get) {
    std::vector<std::optional<double>> values;
    for (const R& r : document.renderers) values.push_back(get(r));
    std::vector<Cell> cells = score_row(name, values, show);
    for (std::size_t i = 0; i < values.size(); ++i)
      if (const metrics::RunStatus status = document.renderers[i].status; status != metrics::RunStatus::kOk)
        cells[i + 1] = {status == metrics::RunStatus::kFailed ? "failed" : "did not finish", false, true};
    cells.insert(cells.begin() + 1, plain(printed));
    table.rows.push_back(std::move(cells));
  };
  // Prints as many digits as the thesis, shifted by three places.
  const auto us = [](double ms) { return fmt::format("{:.1f}", ms * kUsPerMs); };
  const std::string all = frames_text(document), none = kMissingNumber;
  row("points", format_count(manifest.printed_points), Show::kCounts, [](const R& r) {
    return r.model ? std::optional(static_cast<double>(r.model->points)) : std::nullopt;
  });
  row("frames in contact" + (all.empty() ? "" : ", ours " + all), format_count(manifest.printed_frames),
      Show::kCounts, [](const R& r) {
        return r.frame ? std::optional(static_cast<double>(r.frame->timed_frames)) : std::nullopt;
      });
  row("fastest frame, µs", us(manifest.printed_min_ms), Show::kNumbers, frame_score(&R::frame, &F::min_us));
  row("slowest frame, µs", us(manifest.printed_max_ms), Show::kNumbers, frame_score(&R::frame, &F::max_us));
  row("average frame, µs", us(manifest.printed_mean_ms), Show::kNumbers,
      frame_score(&R::frame, &F::mean_clocked_us));
  table.rows.push_back({plain("Not in the thesis")});
  row("average without the clock, µs", none, Show::kNumbers, frame_score(&R::frame, &F::mean_us));
  row("average of all frames without the clock, µs", none, Show::kNumbers,
      frame_score(&R::frame_all, &F::mean_us));
  row("99.9 % of all frames within, µs", none, Show::kNumbers, frame_score(&R::frame_all, &F::p999_us));
  row("preparation", none, Show::kTimes, prepare_ms);
  row("missed contact, frames", none, Show::kCounts, accuracy_score(&A::missed_contact_frames));
  row("false contact, frames", none, Show::kCounts, accuracy_score(&A::false_contact_frames));
  row("frames that no hand tells from the truth, %", none, Show::kNumbers,
      accuracy_score(&A::indistinguishable_percent));
  row("force error, RMS, %", none, Show::kNumbers,
      [](const R& r) { return settled_score(r, &A::force_rms_percent); });
  table.caption = "Thesis: " + manifest.hardware +
                  ". Ours: single frames, each with the cost of reading the clock in it, but for the average "
                  "without the clock, which is of whole stretches of frames. All renderers over the same "
                  "frames, those of the ground truth's contact. Every other score stands below.";
  table.turns = true;
  table.bad_means = "did not run to its end";
  table.notes = manifest.notes;
  return table;
}

Part frames_part(const Manifest& manifest, const Study& study, const OutputFolder& folder) {
  Page page;
  add_study(page, study, manifest.id(),
            fmt::format("Table {} ({})", manifest.table, manifest.models.front().name), folder);
  Section& section = page.sections.back();
  section.found.push_back(
      {"The thesis", fmt::format("mean frame in contact {} µs, on a {}",
                                 format_number(manifest.printed_mean_ms * kUsPerMs), manifest.hardware)});
  section.tables.insert(section.tables.begin(), frames_table(manifest, study.document));
  return {page.known, page.sections, {frames_answer(manifest, study.document)}, {}, false};
}

void reproduce_frames(const Manifest& manifest, Reproduction& r) {
  const std::string what = fmt::format("table {}", manifest.table);
  const bool quick = r.arguments.quick;
  const ManifestModel& model = manifest.models.front();
  Result<ModelScene> scene = scene_of(model, r);
  if (!scene) return give_up(r, what, scene.error());
  const bool stand_in = !scene->stand_in.empty();
  StageRequest request;
  request.scene_name = model.generate.empty() && model.scene.empty()
                           ? fmt::format("{} (unit {}, scale {})", model.scan, model.unit, model.scale)
                           : scene->file.path;
  const bool scanned = !scene->file.models.front().scan.empty() && !manifest.scan_path.empty();
  request.scene = std::move(scene->file);
  request.path = quick ? manifest.quick_path : scanned ? manifest.scan_path : manifest.path;
  request.threads = r.arguments.threads;
  request.contact_frames = quick ? 0 : manifest.contact_frames;
  StagedStudy study;
  study.document = new_document(r.context.command_line);
  study.document.title = manifest.title + (stand_in ? kStandIn : "");
  study.document.about = manifest.text;
  if (stand_in) {
    study.document.about +=
        fmt::format(" The scan could not be had: this ran on a stand-in of the same size and spacing, {}.",
                    request.scene_name);
    leave_out(r, "stand-in instead of " + scene->stand_in);
  }
  Result<Stage> stage = set_up(request, r.readers, r.context.progress);
  if (!stage) return give_up(r, what, stage.error());
  study.stage = *std::move(stage);
  std::vector<RendererRequest> wanted;
  for (const ManifestRun& run : manifest.runs) {
    const std::string& text = quick && !run.quick.empty() ? run.quick : run.renderer;
    if (Result<RendererRequest> one = request_of(text, r))
      wanted.push_back(*std::move(one));
    else
      give_up(r, what + ", " + text, one.error());
  }
  RunOptions options = run_options(r, kFramesPrepareLimitS);
  const bool wanted_paced = manifest.paced || r.arguments.full;
  options.paced_frames = quick ? kQuickPacedFrames : wanted_paced && !waits_for_full(r) ? kPacedFrames : 0;
  if (wanted_paced && waits_for_full(r)) leave_out(r, what + ", frames paced at 1 kHz: run with --full");
  Result<std::vector<Run>> runs = run_on(study.stage, wanted, options, r, study.document);
  if (!runs) return give_up(r, what, runs.error());
  study.runs = *std::move(runs);
  for (const Run& run : study.runs) {
    if (run.result.status == metrics::RunStatus::kOk) continue;
    leave_out(r, fmt::format("{}, {}: {}", what, run.result.label, run.result.reason));
    r.part.fell_short = true;
  }
  const Result<OutputFolder> folder = r.folder.inside(manifest.id());
  const Status written = folder ? write_study(study, *folder) : Status(folder.error());
  const Result<Study> whole = written ? read_study(folder->path()) : Result<Study>(written.error());
  if (!whole) {
    r.part.fell_short = true;
    return give_up(r, what, whole.error());
  }
  r.context.progress.report("drawing the figures", -1.0);
  Part drawn = frames_part(manifest, *whole, r.folder);
  drawn.missing = std::move(r.part.missing);
  drawn.fell_short = r.part.fell_short;
  r.part = std::move(drawn);
}

// The first page of `palpate reproduce`: whether the thesis is reproduced, whom to take, a line a table.

namespace {

/// Number of the judged ones that are so.
struct Share {
  std::size_t yes = 0, all = 0;

  [[nodiscard]] std::string text() const {
    return yes == all ? fmt::format("all {}", all) : fmt::format("{} of {}", yes, all);
  }
  [[nodiscard]] const char* verdict() const {
    return yes == all ? "are reproduced" : yes > 0 ? "are reproduced in part" : "are not reproduced";
  }
};

Share share_of(const std::vector<Answer>& answers, Judged Answer::*what) {
  Share share;
  for (const Answer& answer : answers) {
    share.yes += answer.*what == Judged::kYes ? 1u : 0u;
    share.all += answer.*what != Judged::kNot ? 1u : 0u;
  }
  return share;
}

std::string times_text(double ratio) {
  return format_number(ratio) + " times";
}

std::string reproduced_text(const std::vector<Answer>& answers) {
  const Share fast = share_of(answers, &Answer::as_fast), literal = share_of(answers, &Answer::literal_right),
              ours = share_of(answers, &Answer::ours_right), whole = share_of(answers, &Answer::reproduced);
  if (whole.all == 0) return "Not judged: nothing of the printed size was measured.";
  if (whole.all == 1) {
    const auto one = std::find_if(answers.begin(), answers.end(),
                                  [](const Answer& answer) { return answer.reproduced != Judged::kNot; });
    const std::string faster =
        one->ratio > 0.0 ? fmt::format(", ours {} faster", times_text(one->ratio)) : "";
    return fmt::format("Table {} alone was measured at its size: {}{}.", one->table, one->status, faster);
  }
  std::vector<std::string> parts;
  if (fast.all > 0) {
    double least = HUGE_VAL, most = 0.0;
    for (const Answer& answer : answers) {
      if (!(answer.ratio > 0.0)) continue;
      least = std::min(least, answer.ratio);
      most = std::max(most, answer.ratio);
    }
    parts.push_back(fmt::format("Its times {}: {} are as short as printed or shorter, ours by {} to {}.",
                                fast.verdict(), fast.text(), format_number(least), times_text(most)));
  }
  if (literal.all > 0)
    parts.push_back(fmt::format("Its contact is right in {} tables with the algorithm as printed{}.",
                                literal.text(),
                                ours.all > 0 ? fmt::format(", in {} made right", ours.text()) : ""));
  parts.push_back(fmt::format("Of the lines below {} are reproduced whole.", whole.text()));
  return joined(parts, " ");
}

/// "cloud-smooth (table 7), cloud (tables 8, 9)".
std::string taken_text(const std::vector<Answer>& answers) {
  std::vector<std::pair<std::string, std::vector<std::string>>> taken;
  for (const Answer& answer : answers) {
    if (answer.take.empty()) continue;
    auto same =
        std::find_if(taken.begin(), taken.end(), [&](const auto& t) { return t.first == answer.take; });
    if (same == taken.end()) same = taken.insert(taken.end(), {answer.take, {}});
    same->second.push_back(answer.table);
  }
  std::vector<std::string> parts;
  for (const auto& [label, tables] : taken)
    parts.push_back(fmt::format("{} (table{} {})", label, tables.size() == 1 ? "" : "s", joined(tables)));
  return joined(parts);
}

/// The first page's table.
Table answers_table(const std::vector<Answer>& answers) {
  Table table;
  table.columns = {"table",  "what it says", "thesis",   "as printed, here", "made right, here",
                   "faster", "force error",  "a mesh's", "reproduced"};
  const auto or_dash = [](const std::string& text) { return plain(text.empty() ? kMissingNumber : text); };
  for (const Answer& a : answers) {
    std::vector<Cell> row = {plain(a.table), plain(a.says)};
    row.front().link = a.page;
    for (const std::string& text : {a.printed, a.literal, a.ours}) row.push_back(or_dash(text));
    row.push_back(or_dash(a.ratio > 0.0 ? times_text(a.ratio) : ""));
    for (const std::string& text : {a.error, a.mesh_error}) row.push_back(or_dash(text));
    row.push_back({a.status, a.reproduced == Judged::kYes,
                   a.reproduced == Judged::kNo && !a.status.starts_with("in part")});
    table.rows.push_back(std::move(row));
  }
  table.best_means = "reproduced";
  table.bad_means = "not reproduced";
  table.caption =
      "Thesis: the printed value and its hardware. As printed: the thesis's algorithm with its parameters. "
      "Made right: the first of ours. Faster: the printed time by that of ours. Force error: RMS, of ours "
      "and "
      "of a mesh of the same points. A table's number leads to its page.";
  return table;
}

}  // namespace

std::vector<Headline> verdicts_of(const std::vector<Answer>& answers) {
  std::vector<Headline> verdicts;
  if (answers.empty()) return verdicts;
  verdicts.push_back({"The thesis", reproduced_text(answers)});
  if (const std::string taken = taken_text(answers); !taken.empty())
    verdicts.push_back(
        {"Take", taken + ": its contact is right, none is told to be more accurate, and of equals it is "
                         "the fastest."});
  return verdicts;
}

Page page_of(const metrics::DocumentHead& head, const std::vector<Part>& parts) {
  Page page = begin_page(kReproductionTitle, head);
  page.apart = true;
  std::vector<Answer> answers;
  HeadlineGroup missing{"Not done", {}};
  for (const Part& part : parts) {
    page.known.insert(page.known.end(), part.known.begin(), part.known.end());
    page.sections.insert(page.sections.end(), part.sections.begin(), part.sections.end());
    answers.insert(answers.end(), part.answers.begin(), part.answers.end());
    for (const std::string& what : part.missing) {
      const std::size_t colon = what.find(": ");
      const bool whole = colon == std::string::npos;
      missing.lines.push_back({whole ? "" : what.substr(0, colon), whole ? what : what.substr(colon + 2)});
    }
  }
  page.answers = verdicts_of(answers);
  if (!answers.empty()) page.tables = {answers_table(answers)};
  if (!missing.lines.empty()) page.headlines = {std::move(missing)};
  // The picture of the trade is that of the first table that has one.
  for (const Section& section : page.sections)
    for (const Figure& figure : section.figures)
      if (page.figures.empty() && figure.name == section.id + kTradeSuffix && !figure.svg.empty()) {
        page.figures = {figure};
        page.figures.front().title += ": " + section.title;
      }
  page.commands.push_back("palpate reproduce --help    # shorter and longer runs");
  return page;
}

}  // namespace palpate::experiments
