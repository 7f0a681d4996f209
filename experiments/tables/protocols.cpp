// Three accuracy protocols: coarser versions of a scan, points off a mesh's vertices, a simulated scanner.
// The truth, a formula or finer mesh, is hidden from renderers; the path follows it.
#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/data/scans.h"
#include "experiments/tables/reproduction.h"
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

}  // namespace palpate::experiments
