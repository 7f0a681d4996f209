#include "experiments/bench/ranking.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/trace.h>
#include "experiments/bench/cases.h"
#include "experiments/driver/suite.h"
#include "experiments/run/run.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr const char* kBenchFolder = "out/bench";
/// Timed passes of each entry and case, and what they may take; a case that is checked needs none.
constexpr std::uint64_t kBenchPasses = 8;
constexpr double kBenchBudgetS = 2.0;
/// Longer than every reconstruction of 51,000 points that was seen to end.
constexpr double kBenchPrepareLimitS = 300.0;

constexpr const char *kRendererKind = "renderer", *kTracesKind = "traces";

/// An entry with what runs it.
struct Entrant {
  BenchEntry entry;
  std::optional<RendererRequest> renderer;
  std::filesystem::path traces;
};

Result<std::vector<Entrant>> read_entries(const std::string& text, const render::Registry& registry) {
  std::vector<Entrant> entrants;
  std::set<std::string> labels;
  for (const std::string& word : split_list(text)) {
    Entrant one;
    std::error_code none;
    if (std::filesystem::is_directory(word, none)) {
      one.traces = std::filesystem::weakly_canonical(word, none);
      const std::string name = one.traces.filename().string();
      one.entry = {name, kTracesKind, name};
    } else {
      PALPATE_ASSIGN(std::vector<RendererRequest> requests, parse_renderers(word, registry));
      if (requests.empty()) continue;
      one.renderer = std::move(requests.front());
      one.entry = {one.renderer->label, kRendererKind, word};
    }
    if (!labels.insert(one.entry.label).second)
      return Error{fmt::format("two entries are called '{}'", one.entry.label),
                   fmt::format("name one: {}:label=another, or rename its folder", word)};
    entrants.push_back(std::move(one));
  }
  if (entrants.empty()) return Error{"there is no entry", "name a renderer, or a folder of traces"};
  return entrants;
}

std::string trace_file(const std::filesystem::path& folder, const std::string& name) {
  return (folder / (name + ".csv")).string();
}

/// A recorded trace of this stage's path; every row must be there, and be of this path.
Result<trace::ForceTrace> read_entered(const std::string& file, const trace::ProbePath& path) {
  PALPATE_ASSIGN(trace::PathAndTrace read, trace::read_trace_csv(file));
  const auto differs = [&](std::size_t row) {
    return Error{"is not along the case's path", "answer every row of path.csv, with its first four columns",
                 file, static_cast<std::int64_t>(row) + 2};  // the first line is the header
  };
  const std::size_t rows = std::min(read.path.size(), path.size());
  for (std::size_t i = 0; i < rows; ++i)
    if (read.path.t_s[i] != path.t_s[i] || read.path.hip_mm[i] != path.hip_mm[i]) return differs(i);
  if (read.path.size() != path.size()) return differs(rows);
  return std::move(read.trace);
}

BenchRow row_of(const BenchCase& one, const Run& run) {
  const metrics::RendererResult& result = run.result;
  BenchRow row;
  row.entry = result.label;
  row.name = one.name;
  row.shape = one.shape;
  if (result.status != metrics::RunStatus::kOk || !result.accuracy) {
    row.reason = result.reason.empty() ? "it has no score" : result.reason;
    return row;
  }
  const metrics::Accuracy& a = *result.accuracy;
  const auto real = [](const std::optional<std::uint64_t>& n) {
    return n ? std::optional(static_cast<double>(*n)) : std::nullopt;
  };
  row.trace_hash = result.trace_hash;
  row.caught = real(a.caught);
  row.lost = real(a.lost);
  row.kicks = real(a.kicks);
  row.force_rms_percent = a.force_rms_whole_percent ? a.force_rms_whole_percent : a.force_rms_percent;
  row.direction_mean_deg = a.direction_mean_deg;
  row.force_peak_excess_percent = a.force_peak_excess_percent;
  if (result.frame_all) {
    row.frame_mean_us = result.frame_all->mean_us;
    row.frame_p999_us = result.frame_all->p999_us;
  }
  row.prepare_ms = prepare_ms(result);
  row.bytes_per_point = bytes_a_point(result);
  return row;
}

class Bench {
 public:
  Bench(const BenchArguments& arguments, const BenchSeed& seed, std::vector<Entrant> entrants,
        const render::Registry& registry, const Suite& suite)
      : arguments_(arguments),
        seed_(seed),
        entrants_(std::move(entrants)),
        registry_(registry),
        suite_(suite),
        cases_(bench_cases(seed, arguments.quick)) {
    for (const Entrant& one : entrants_)
      if (one.renderer) requests_.push_back(*one.renderer);
  }

  /// Each case's points and path, and what they are.
  Status save_cases();
  /// Each entry on each case; without `timed` frames are run once.
  Result<BenchDocument> run(const metrics::DocumentHead& head, bool timed);

 private:
  Result<CaseResult> run_case(const BenchCase& one, bool timed);
  Run run_traces(const Entrant& entrant, const Stage& stage);
  Result<Stage> stage_of(const BenchCase& one) {
    suite_.progress().set_prefix(one.name + ": ");
    return bench_stage(one, suite_.folder(), arguments_.threads, suite_.progress());
  }

  const BenchArguments& arguments_;
  const BenchSeed& seed_;
  std::vector<Entrant> entrants_;
  const render::Registry& registry_;
  const Suite& suite_;
  std::vector<BenchCase> cases_;
  std::vector<RendererRequest> requests_;
};

Status Bench::save_cases() {
  BenchDocument document;
  document.quick = arguments_.quick;
  document.seed = seed_.name;
  document.seed_sha256 = seed_.sha256;
  for (const BenchCase& one : cases_) {
    PALPATE_ASSIGN(const Stage stage, stage_of(one));
    PALPATE_ASSIGN(const OutputFolder folder, suite_.folder().inside(one.name));
    PALPATE_ASSIGN(const std::string points, folder.claim("points.ply"));
    PALPATE_TRY(io::write_cloud_ply(points, *stage.scene.input.models.front().cloud));
    PALPATE_ASSIGN(const std::string path, folder.claim("path.csv"));
    PALPATE_TRY(trace::write_path_csv(stage.path, path));
    document.cases.push_back(inputs_of(one, stage));
  }
  document.head = new_head({});
  PALPATE_TRY(suite_.folder().write(kBenchFile, to_json(document)));
  return suite_.folder().complete();
}

Run Bench::run_traces(const Entrant& entrant, const Stage& stage) {
  Run run;
  run.result.label = run.result.name = entrant.entry.label;
  Result<trace::ForceTrace> trace = read_entered(trace_file(entrant.traces, stage.scene_name), stage.path);
  Status scored = trace ? Status(Done{}) : Status(trace.error());
  if (trace) {
    run.trace = *std::move(trace);
    run.trace.label = entrant.entry.label;
    run.result.trace_hash = trace::trace_hash(run.trace);
    scored = score_run(stage, run);
  }
  if (!scored) {
    run.result.status = metrics::RunStatus::kFailed;
    run.result.reason = scored.error().message();
  }
  return run;
}

Result<CaseResult> Bench::run_case(const BenchCase& one, bool timed) {
  PALPATE_ASSIGN(const Stage stage, stage_of(one));
  RunOptions options;
  options.threads = arguments_.threads;
  options.passes = timed ? kBenchPasses : 1;
  options.budget_s = kBenchBudgetS;
  options.prepare_limit_s = kBenchPrepareLimitS;
  metrics::MeasurementConditions conditions;
  PALPATE_ASSIGN(const std::vector<Run> runs,
                 run_renderers(stage, requests_, registry_, options, suite_.progress(), conditions, {}));
  CaseResult result{inputs_of(one, stage), {}};
  auto run = runs.begin();
  for (const Entrant& entrant : entrants_)
    result.rows.push_back(row_of(one, entrant.renderer ? *run++ : run_traces(entrant, stage)));
  return result;
}

Result<BenchDocument> Bench::run(const metrics::DocumentHead& head, bool timed) {
  BenchDocument document;
  document.head = head;
  document.quick = arguments_.quick;
  document.threads = arguments_.threads;
  document.seed = seed_.name;
  document.seed_sha256 = seed_.sha256;
  for (const Entrant& one : entrants_) document.entries.push_back(one.entry);
  for (const BenchCase& one : cases_) {
    PALPATE_ASSIGN(CaseResult result,
                   suite_.once<CaseResult>(one.name, one.name, [&] { return run_case(one, timed); }));
    document.cases.push_back(std::move(result.inputs));
    for (BenchRow& row : result.rows) document.rows.push_back(std::move(row));
  }
  suite_.progress().set_prefix("");
  return document;
}

/// Everything in `claimed` that was found otherwise. Times are no matter of right or wrong.
std::vector<std::string> differences(const BenchDocument& claimed, const BenchDocument& found) {
  std::vector<std::string> faults;
  std::map<std::string, const CaseInputs*> inputs;
  for (const CaseInputs& one : claimed.cases) inputs.emplace(one.name, &one);
  for (const CaseInputs& one : found.cases) {
    const auto other = inputs.find(one.name);
    if (other == inputs.end())
      faults.push_back(fmt::format("{}: the case is missing", one.name));
    else if (other->second->points_hash != one.points_hash || other->second->path_hash != one.path_hash ||
             other->second->truth_hash != one.truth_hash)
      faults.push_back(fmt::format("{}: points, path or truth are others", one.name));
  }
  if (claimed.cases.size() > found.cases.size())
    faults.push_back(
        fmt::format("{} cases are none of this seed", claimed.cases.size() - found.cases.size()));
  for (const BenchRow& row : found.rows) {
    const auto other = std::find_if(claimed.rows.begin(), claimed.rows.end(), [&](const BenchRow& r) {
      return r.entry == row.entry && r.name == row.name;
    });
    const bool same = other != claimed.rows.end() && other->trace_hash == row.trace_hash &&
                      std::all_of(bench_measures().begin(), bench_measures().end(), [&](const auto& m) {
                        return m.group != "right" || (*other).*m.value == row.*m.value;
                      });
    if (!same) faults.push_back(fmt::format("{}: {} answers otherwise", row.name, row.entry));
  }
  return faults;
}

/// The entries of a result that can be run here, as --entry takes them.
std::string entries_of(const BenchDocument& claimed, std::vector<std::string>& warnings) {
  std::string entries;
  for (const BenchEntry& entry : claimed.entries) {
    if (entry.kind == kRendererKind)
      entries += (entries.empty() ? "" : ",") + entry.request;
    else
      warnings.push_back(fmt::format("{} is not checked: name its folder of traces by --entry", entry.label));
  }
  return entries;
}

/// The command as typed, without what nobody else may know.
std::string shown_command(const BenchArguments& arguments, const BenchSeed& seed, std::string command) {
  if (seed.name != "secret") return command;
  // As the shell wants it, where it has quotes; and as it is.
  for (const std::string& secret : {for_shell(arguments.seed), arguments.seed})
    for (std::size_t at = 0; (at = command.find(secret, at)) != std::string::npos;)
      command.replace(at, secret.size(), "SECRET");
  return command;
}

}  // namespace

Page bench_page(const BenchDocument& document, const std::vector<Table>& tables) {
  Page page =
      begin_page(fmt::format("Palpate Bench {}: {} cases", kBenchVersion, document.seed), document.head);
  page.commands = {document.head.command};
  Section section;
  section.id = "bench";
  section.title = "Who stands where";
  section.paragraphs = {
      "Every entry gets the same points and the same path of a simulated hand, which felt the exact surface. "
      "Right: how often the god object is caught, contact lost or the hand kicked, summed over cases, and "
      "the "
      "medians of the errors. Fast, ready and small are medians of what this machine measured.",
      "An interval holds 95 % of a thousand drawings of shapes with replacement. A rank is one more than the "
      "entries whose interval ends before this one begins. There is no single score.",
      fmt::format("SHA-256 of version and seed: {}.", document.seed_sha256)};
  section.tables = tables;
  for (const BenchEntry& entry : document.entries) {
    Fact fact{entry.label, {fmt::format("Entered as {} {}.", entry.kind, entry.request)}};
    for (const BenchRow& row : document.rows)
      if (row.entry == entry.label && !row.reason.empty())
        fact.sentences.push_back(fmt::format("{}: {}.", row.name, row.reason));
    section.facts.push_back(std::move(fact));
  }
  page.sections.push_back(std::move(section));
  return page;
}

Result<int> run_bench(const BenchArguments& given, Context& context) {
  const render::Registry registry = all_renderers();
  BenchArguments arguments = given;
  std::optional<BenchDocument> claimed, other;
  SuiteResults results{kBenchFile, {}, {}};
  if (!arguments.check.empty()) {
    PALPATE_ASSIGN(claimed, read_bench(arguments.check));
    arguments.quick = claimed->quick;
    if (arguments.entries.empty()) arguments.entries = entries_of(*claimed, results.warnings);
  }
  if (!arguments.against.empty()) {
    PALPATE_ASSIGN(other, read_bench(arguments.against));
  }
  PALPATE_ASSIGN(const BenchSeed seed, read_seed(arguments.seed));
  if (claimed && claimed->seed_sha256 != seed.sha256)
    return Error{fmt::format("is of another seed ({})", claimed->seed),
                 "give the one it was made with by --seed", arguments.check};
  if (other && (other->quick != arguments.quick || other->seed_sha256 == seed.sha256))
    return Error{"is of the same seed, or of another size", "give a run of other cases, quick or not as this",
                 arguments.against};
  if (context.cases.list && seed.name == "secret")
    return Error{"jobs hold their command line, and so the secret seed",
                 "run it without --emit and --engine"};
  PALPATE_ASSIGN(std::vector<Entrant> entrants,
                 read_entries(arguments.entries.empty() ? kUsualEntries : arguments.entries, registry));
  const std::string folder = !arguments.save_cases.empty() ? arguments.save_cases
                             : arguments.out.empty()       ? kBenchFolder
                                                           : arguments.out;
  Suite suite(context);
  PALPATE_TRY(suite.open(folder, std::vector<std::string>{arguments.check, arguments.against}));
  RunKey key;
  key.add("bench").add(seed.sha256).add(arguments.save_cases).add(std::uint64_t{arguments.quick});
  key.add(static_cast<std::uint64_t>(arguments.threads)).add(std::uint64_t{claimed.has_value()});
  for (const Entrant& one : entrants) {
    key.add(one.entry.label).add(one.renderer ? key_of(*one.renderer) : one.traces.string());
    for (const BenchCase& of : bench_cases(seed, arguments.quick))
      if (!one.renderer) key.add_file(trace_file(one.traces, of.name));
  }
  PALPATE_TRY(suite.begin(key));
  Bench bench(arguments, seed, std::move(entrants), registry, suite);
  if (!arguments.save_cases.empty()) {
    PALPATE_TRY(bench.save_cases());
    suite.progress().clear();
    fmt::print("cases: {}\n", std::filesystem::absolute(suite.folder().path()).string());
    return kExitOk;
  }
  PALPATE_ASSIGN(const BenchDocument document,
                 bench.run(new_head(shown_command(arguments, seed, context.command_line)), !claimed));
  if (suite.partial()) return suite.leave();
  results.json = to_json(document);
  results.tables = bench_tables(document);
  if (other) results.tables.push_back(tuning_table(document, *other));
  if (claimed) results.faults = differences(*claimed, document);
  if (arguments.quick)
    results.warnings.emplace_back("A quick run tries the machinery; its numbers are no measurement.");
  // A case that an entry does not take is a result; an entry that takes none is none.
  const bool all_ran = std::all_of(document.entries.begin(), document.entries.end(),
                                   [&](const auto& entry) { return finished_by(document, entry.label) > 0; });
  PALPATE_TRY(suite.publish(results, bench_page(document, results.tables), arguments.json));
  if (claimed)
    tell("palpate: {}: {}\n", arguments.check, results.faults.empty() ? "is as it says" : "differs");
  return all_ran && results.faults.empty() ? kExitOk : kExitFellShort;
}

}  // namespace palpate::experiments
