// The three protocols of accuracy: coarser versions of a scan, points off a mesh's vertices, a simulated
// scanner. Their truth is a formula or a finer mesh, which no renderer sees; the path follows the truth.
#include <fmt/format.h>

#include <algorithm>

#include "experiments/data/locate.h"
#include "experiments/data/scene_scans.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/nearest_rank.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

using metrics::Accuracy;
using metrics::RendererResult;

// Frames are not what is measured here: one pass of each kind.
constexpr double kProtocolBudgetS = 1.0;
constexpr double kProtocolPrepareLimitS = 120.0, kFullProtocolPrepareLimitS = 3600.0;
/// Of the ten minutes of a run of everything: a model that begins later waits for --full, or to be asked for.
constexpr double kRoomForProtocolsMs = 540'000.0;
constexpr const char* kSeedHere = "@";

/// One renderer on one model: a result a seed.
struct ProtocolRow {
  std::string model, label;
  std::vector<RendererResult> seeds;
};

/// `text` with the seed where the manifest has an @.
std::string with_seed(std::string text, int seed) {
  for (std::size_t at = text.find(kSeedHere); at != std::string::npos; at = text.find(kSeedHere))
    text.replace(at, 1, fmt::format("{}", seed));
  return text;
}

/// The file of a scan that is the truth: found, or fetched.
Result<std::string> truth_file(const std::string& scan, Reproduction& r) {
  ManifestModel alone;
  alone.scan = scan;
  PALPATE_ASSIGN(const scene::SceneFile scene, scene_of(alone, r));
  return scene.models.front().cloud;
}

Result<StageRequest> request_for(const Manifest& manifest, const ManifestModel& model, int seed,
                                 Reproduction& r) {
  const bool quick = r.arguments.quick;
  ManifestModel one = model;
  one.generate = with_seed(model.generate, seed);
  one.quick = with_seed(model.quick, seed);
  StageRequest request;
  PALPATE_ASSIGN(request.scene, scene_of(one, r));
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
  RunOptions options;
  options.threads = r.arguments.threads;
  options.passes = 1;
  options.budget_s = kProtocolBudgetS;
  options.prepare_limit_s = r.arguments.full ? kFullProtocolPrepareLimitS : kProtocolPrepareLimitS;
  std::vector<RendererRequest> requests;
  for (const ManifestRun& run : manifest.runs) {
    PALPATE_ASSIGN(std::vector<RendererRequest> named, parse_renderers(run.renderer, r.registry));
    requests.push_back(std::move(named.front()));
    limit_reconstruction(requests.back(), r);
  }
  metrics::Conditions conditions;
  PALPATE_ASSIGN(std::vector<Run> runs,
                 run_renderers(stage, requests, r.registry, options, r.context.progress, conditions, {}));
  add_program(conditions);
  document.conditions = std::move(conditions);
  for (Run& run : runs) {
    if (run.result.status != metrics::RunStatus::kOk)
      r.missing.push_back(
          fmt::format("{}, {} on {}: {}", manifest.id(), run.result.label, model.name, run.result.reason));
    RendererResult named = run.result;
    named.label = fmt::format("{}-{}-{}", model.name, seed, named.label);
    document.renderers.push_back(std::move(named));
    auto row = std::find_if(rows.begin(), rows.end(), [&](const ProtocolRow& one) {
      return one.model == model.name && one.label == run.result.label;
    });
    if (row == rows.end()) row = rows.insert(rows.end(), {model.name, run.result.label, {}});
    row->seeds.push_back(std::move(run.result));
  }
  return Done{};
}

using ProtocolValue = std::optional<double>;

template <class Member>
std::vector<double> over_seeds(const ProtocolRow& row, Member member) {
  std::vector<double> values;
  for (const RendererResult& result : row.seeds) {
    if (!result.accuracy) continue;
    if (const auto value = (*result.accuracy).*member) values.push_back(static_cast<double>(*value));
  }
  return values;
}

template <class Member>
ProtocolValue middle(const ProtocolRow& row, Member member) {
  std::vector<double> values = over_seeds(row, member);
  return values.empty() ? ProtocolValue() : upper_median(std::move(values));
}

std::string range_text(const ProtocolRow& row) {
  const std::vector<double> values = over_seeds(row, &Accuracy::force_rms_percent);
  if (values.size() < 2) return kNoNumber;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return fmt::format("{} to {}", short_number(*low), short_number(*high));
}

/// A row a renderer and model; medians over the seeds.
Table protocol_table(const Manifest& manifest, const std::vector<ProtocolRow>& rows) {
  Table table;
  table.title = manifest.title;
  table.columns = {"model", "renderer"};
  for (const ProtocolRow& row : rows)
    table.rows.push_back({{row.model, false, false}, {row.label, false, false}});
  const auto add = [&](const char* name, const auto& text_of) {
    table.columns.emplace_back(name);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const bool ran = std::any_of(rows[i].seeds.begin(), rows[i].seeds.end(), [](const RendererResult& one) {
        return one.status == metrics::RunStatus::kOk;
      });
      table.rows[i].push_back({ran ? text_of(rows[i]) : std::string("did not finish"), false, !ran});
    }
  };
  const auto number = [&](const char* name, auto member) {
    add(name, [member](const ProtocolRow& row) { return short_number(middle(row, member)); });
  };
  add("points", [](const ProtocolRow& row) {
    return row.seeds.front().model ? count_text(row.seeds.front().model->points) : std::string(kNoNumber);
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
  const auto count = [&](const char* name, std::uint64_t Accuracy::*member) {
    add(name, [member](const ProtocolRow& row) {
      std::vector<double> all;
      for (const RendererResult& one : row.seeds)
        if (one.accuracy) all.push_back(static_cast<double>((*one.accuracy).*member));
      return all.empty() ? std::string(kNoNumber) : short_number(upper_median(std::move(all)));
    });
  };
  count("missed beyond a spacing", &Accuracy::missed_contact_frames);
  count("false beyond a spacing", &Accuracy::false_contact_frames);
  table.bad_means = "did not run to its end";
  table.caption =
      "Frames and percent are medians over the seeds. The truth is the formula, or a mesh that no "
      "renderer sees. Rows that begin with floor- are other triangulations of the same points: what "
      "the points alone leave open.";
  table.notes = manifest.notes;
  return table;
}

/// "cloud 0.82 % (median 0.1 %, 95 % 1.2 %), floor 0.7 %" for each model.
std::vector<Headline> protocol_headlines(const std::vector<ProtocolRow>& rows) {
  std::vector<Headline> lines;
  for (const ProtocolRow& row : rows) {
    const ProtocolValue rms = middle(row, &Accuracy::force_rms_percent);
    if (!rms) continue;
    if (lines.empty() || lines.back().lead != row.model) lines.push_back({row.model, ""});
    lines.back().text +=
        fmt::format("{}{} {} % (median {}, 95 % {})", lines.back().text.empty() ? "force error, RMS: " : "; ",
                    row.label, short_number(*rms), short_number(middle(row, &Accuracy::force_p50_percent)),
                    short_number(middle(row, &Accuracy::force_p95_percent)));
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
    if (r.arguments.tables.empty() && !r.arguments.full && r.watch.ms() > kRoomForProtocolsMs) {
      r.missing.push_back(
          fmt::format("{}, from {} on: no room within ten minutes; run with --full, or --tables {}",
                      manifest.id(), model.name, manifest.id()));
      break;
    }
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
  if (const Result<OutputFolder> folder = r.folder.inside(manifest.id()))
    if (const Status written = folder->write("result.json", metrics::to_json(document)); !written)
      r.missing.push_back(manifest.id() + "/result.json: " + written.error().message());
  Table table = protocol_table(manifest, rows);
  r.page.sections.push_back({manifest.id(), manifest.title, {}, {manifest.text}, {table}, {}, {}});
  r.page.headlines.push_back({manifest.title, protocol_headlines(rows)});
  r.tables.push_back(std::move(table));
}

}  // namespace palpate::experiments
