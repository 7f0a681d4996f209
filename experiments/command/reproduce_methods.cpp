// Table 11: every method on models of the sizes at which they were published.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/command/reproduction.h"

namespace palpate::experiments {
namespace {

using R = metrics::RendererResult;
using Value = std::optional<double>;

constexpr double kPrepareLimitS = 120.0, kFullPrepareLimitS = 3600.0;
/// The option of renderers that make a mesh.
constexpr const char* kMeshLimit = "mesh_time_limit_s";
/// A published figure is compared with a model of at most this share more or fewer points.
constexpr double kSameSize = 0.1;

Cell plain(std::string text) {
  return {std::move(text), false, false};
}

Value bytes_per_point(const R& result) {
  if (!result.prepare || !result.model || result.model->points == 0) return std::nullopt;
  return static_cast<double>(result.prepare->bytes) / static_cast<double>(result.model->points);
}

const std::string& label_of(const ManifestMethod& method) {
  return method.label.empty() ? method.renderer : method.label;
}

bool is_in_build(const ManifestMethod& method, const Reproduction& r) {
  const Result<NamedOptions> named = parse_named_options(method.renderer);
  return named && r.registry.find(named->name) != nullptr;
}

/// What the thesis prints, and what each of ours does.
Table words_table(const Manifest& manifest) {
  Table table;
  table.title = manifest.title;
  table.columns = {"renderer", "kin", "preparation", "broad phase", "narrow phase", "response"};
  for (const ManifestMethod& m : manifest.methods)
    table.rows.push_back({plain(label_of(m)), plain(m.kin), plain(m.preparation), plain(m.broad),
                          plain(m.narrow), plain(m.response)});
  table.caption = "Thesis: " + manifest.hardware + ".";
  table.notes = manifest.notes;
  return table;
}

/// "70 µs: met", or a dash where nothing was published at this size.
Cell published_cell(const ManifestMethod& method, const R& result) {
  for (const ManifestMethod::Published& p : method.published) {
    if (!result.model) continue;
    const auto points = static_cast<double>(result.model->points);
    if (std::abs(points - p.points) > kSameSize * p.points) continue;
    const bool met = result.frame && result.frame->mean_us && *result.frame->mean_us <= p.us;
    return {fmt::format("{} µs: {}", short_number(p.us), met ? "met" : "missed"), false, !met};
  }
  return plain("–");
}

Table model_table(const ManifestModel& model, const Manifest& manifest,
                  const metrics::ResultDocument& document) {
  Table table;
  const std::uint64_t points = document.renderers.empty() || !document.renderers.front().model
                                   ? 0
                                   : document.renderers.front().model->points;
  table.title = fmt::format("Table 11 on the {}, {} points", model.name, count_text(points));
  table.columns = {"renderer",       "preparation",   "bytes a point", "mean frame, µs",
                   "99.9 % within",  "worst, µs",     "published",     "force error, RMS, %",
                   "missed, frames", "false, frames", "pop-throughs"};
  const auto number = [](const Value& v) { return v ? short_number(*v) : std::string("–"); };
  for (const R& r : document.renderers) {
    const auto method = std::find_if(manifest.methods.begin(), manifest.methods.end(),
                                     [&](const ManifestMethod& m) { return label_of(m) == r.label; });
    std::vector<Cell> row = {plain(r.label)};
    if (r.status != metrics::RunStatus::kOk) {
      row.push_back(
          {r.status == metrics::RunStatus::kFailed ? "does not run: " + r.reason : r.reason, false, true});
      row.resize(table.columns.size(), plain("–"));
      table.rows.push_back(std::move(row));
      continue;
    }
    row.push_back(plain(r.prepare ? duration_text(r.prepare->total_ms) : "–"));
    row.push_back(plain(number(bytes_per_point(r))));
    row.push_back(plain(number(r.frame ? r.frame->mean_us : Value())));
    row.push_back(plain(number(r.frame ? r.frame->p999_us : Value())));
    row.push_back(plain(number(r.frame ? r.frame->max_us : Value())));
    row.push_back(method == manifest.methods.end() ? plain("–") : published_cell(*method, r));
    row.push_back(plain(number(r.accuracy ? r.accuracy->force_rms_percent : Value())));
    const auto count = [&](std::optional<std::uint64_t> n) {
      return n ? Cell{count_text(*n), false, *n > 0} : plain("–");
    };
    using Count = std::optional<std::uint64_t>;
    row.push_back(count(r.accuracy ? Count(r.accuracy->missed_contact_frames) : Count()));
    row.push_back(count(r.accuracy ? Count(r.accuracy->false_contact_frames) : Count()));
    row.push_back(count(r.accuracy ? r.accuracy->pop_throughs : Count()));
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string ratio(double ours, double theirs) {
  if (!(ours > 0.0) || !(theirs > 0.0)) return "–";
  return ours <= theirs ? fmt::format("1/{}", short_number(theirs / ours)) : short_number(ours / theirs);
}

/// `cloud` against the fastest and the most accurate mesh renderer of the same run.
std::vector<std::string> against_meshes(const metrics::ResultDocument& document) {
  const R* cloud = nullptr;
  const R *fastest = nullptr, *rightest = nullptr;
  for (const R& r : document.renderers) {
    if (r.status != metrics::RunStatus::kOk || !r.frame || !r.frame->mean_us || !r.prepare) continue;
    if (r.label == "cloud") cloud = &r;
    if (!r.label.starts_with("mesh-")) continue;
    if (fastest == nullptr || *r.frame->mean_us < *fastest->frame->mean_us) fastest = &r;
    if (r.accuracy && r.accuracy->force_rms_percent &&
        (rightest == nullptr || *r.accuracy->force_rms_percent < *rightest->accuracy->force_rms_percent))
      rightest = &r;
  }
  std::vector<std::string> lines;
  const auto line = [&](const char* what, const R* mesh) {
    if (cloud == nullptr || mesh == nullptr) return;
    lines.push_back(
        fmt::format("cloud against the {} mesh renderer, {}: preparation {}, mean frame {}, memory {}.", what,
                    mesh->label, ratio(cloud->prepare->total_ms, mesh->prepare->total_ms),
                    ratio(*cloud->frame->mean_us, *mesh->frame->mean_us),
                    ratio(bytes_per_point(*cloud).value_or(0.0), bytes_per_point(*mesh).value_or(0.0))));
  };
  if (fastest == rightest) {
    line("fastest and most accurate", fastest);
  } else {
    line("fastest", fastest);
    line("most accurate", rightest);
  }
  return lines;
}

/// Every method on one model; what does not run says so in its result.
Result<metrics::ResultDocument> run_methods(const Manifest& manifest, const ManifestModel& model,
                                            Reproduction& r) {
  Result<scene::SceneFile> scene = scene_of(model, r);
  if (!scene) return std::move(scene).error();
  StageRequest request;
  request.scene_name = model.generate.empty() ? model.scan : scene->path;
  request.scene = *std::move(scene);
  request.path = r.arguments.quick ? manifest.quick_path : model.path.empty() ? manifest.path : model.path;
  request.threads = r.arguments.threads;
  Study study;
  study.document = new_document(r.context.command_line);
  Result<Stage> stage = set_up(request, r.readers, r.context.progress);
  if (!stage) return std::move(stage).error();
  study.stage = *std::move(stage);
  RunOptions options;
  options.threads = r.arguments.threads;
  options.prepare_limit_s = r.arguments.full ? kFullPrepareLimitS : kPrepareLimitS;
  for (const ManifestMethod& method : manifest.methods) {
    if (!is_in_build(method, r)) continue;  // said once, above
    const Result<std::vector<RendererRequest>> requests =
        parse_renderers(fmt::format("{}:label={}", method.renderer, label_of(method)), r.registry);
    if (!requests) return requests.error();
    RendererRequest wanted = requests->front();
    const std::vector<OptionSpec>& specs = r.registry.find(wanted.name)->options;
    if (std::any_of(specs.begin(), specs.end(), [](const OptionSpec& s) { return s.key == kMeshLimit; }))
      wanted.options.set(kMeshLimit, fmt::format("{}", mesh_limit_s(r)));
    Result<Run> run = run_renderer(study.stage, wanted, r.registry, options, r.context.progress);
    if (!run) return std::move(run).error();
    run->trace = {};  // a result is all that is shown
    study.runs.push_back(*std::move(run));
    if (r.context.progress.cancelled()) break;
  }
  finish_document(study);
  return std::move(study.document);
}

}  // namespace

void reproduce_methods(const Manifest& manifest, Reproduction& r) {
  Section section{
      fmt::format("table{}", manifest.table), manifest.title, {}, {words_table(manifest)}, {}, {}};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  HeadlineGroup found{manifest.title, {}};
  for (const ManifestMethod& method : manifest.methods)
    if (!is_in_build(method, r))
      r.missing.push_back(fmt::format("table {}: {} is not in this build", manifest.table, method.renderer));
  for (const ManifestModel& model : manifest.models) {
    if (model.full && !r.arguments.full) {
      r.missing.push_back(fmt::format("table {} on the {}: run with --full", manifest.table, model.name));
      continue;
    }
    if (r.arguments.quick && model.quick.empty()) continue;
    const Result<metrics::ResultDocument> document = run_methods(manifest, model, r);
    if (!document) {
      give_up(r, fmt::format("table {}, {}", manifest.table, model.name), document.error());
      continue;
    }
    Table table = model_table(model, manifest, *document);
    table.notes = against_meshes(*document);
    for (const std::string& line : table.notes) found.lines.push_back({model.name, line});
    std::string name = model.name;
    std::erase_if(name, [](char c) { return c == ',' || c == '.'; });
    std::replace(name.begin(), name.end(), ' ', '-');
    if (const Result<OutputFolder> folder = r.folder.inside(fmt::format("table{}", manifest.table)))
      if (const Status written = folder->write(name + ".json", metrics::to_json(*document)); !written)
        give_up(r, "table 11's results", written.error());
    r.tables.push_back(table);
    section.tables.push_back(std::move(table));
    if (r.context.progress.cancelled()) break;
  }
  if (!found.lines.empty()) r.page.headlines.push_back(std::move(found));
  r.page.sections.push_back(std::move(section));
}

}  // namespace palpate::experiments
