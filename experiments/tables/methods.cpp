// Table 11: every method on models of the published sizes.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "baselines/reconstruct/reconstruct.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using R = metrics::RendererResult;
using Value = std::optional<double>;

constexpr double kMethodPrepareLimitS = 120.0;
/// Two renderers are equally right if their shares of frames that hands can tell from the truth agree to the
/// printed tenth of a percent.
constexpr double kSamePercent = 0.1;
/// Largest difference in points between a published model and ours.
constexpr double kSameSize = 0.1;

const std::string& label_of(const ManifestMethod& method) {
  return method.label.empty() ? method.renderer : method.label;
}

/// Reconstruction of a row's mesh, if it names one; Error: not in this build.
Result<const baselines::Method*> reconstruction_of(const ManifestMethod& method) {
  const Result<NamedOptions> named = parse_named_options(method.renderer);
  if (!named || !named->options.has("mesh") || named->options.text("mesh") == "original") return nullptr;
  return baselines::find_method(named->options.text("mesh"));
}

bool is_in_build(const ManifestMethod& method, const Reproduction& r) {
  const Result<NamedOptions> named = parse_named_options(method.renderer);
  return named && r.registry.find(named->name) != nullptr && reconstruction_of(method);
}

bool holds(const std::vector<std::string>& labels, const std::string& label) {
  return std::find(labels.begin(), labels.end(), label) != labels.end();
}

/// A model's rows. Reports rows left out for time, in one line; silently omits rows that need a raster on
/// models without one.
std::vector<const ManifestMethod*> rows_on(const ManifestModel& model, const Manifest& manifest, bool raster,
                                           Reproduction& r) {
  std::vector<const ManifestMethod*> rows;
  std::vector<std::string> slow;
  for (const ManifestMethod& method : manifest.methods) {
    const std::string& label = label_of(method);
    if (!is_in_build(method, r)) continue;  // reported once for all models
    if (!model.only.empty() && !holds(model.only, label)) continue;
    const baselines::Method* made = *reconstruction_of(method);
    if (made != nullptr && made->raster_only && !raster) continue;
    if (holds(model.slow, label) && !r.arguments.full) {
      slow.push_back(label);
      continue;
    }
    rows.push_back(&method);
  }
  if (!slow.empty())
    leave_out(r, fmt::format("table {}, {} on the {}: slow; run with --full", manifest.table, joined(slow),
                             model.name));
  return rows;
}

Table words_table(const Manifest& manifest) {
  Table table;
  table.title = manifest.title;
  table.columns = {"renderer", "kin", "preparation", "broad phase", "narrow phase", "response"};
  for (const ManifestMethod& m : manifest.methods)
    table.rows.push_back(plain_row({label_of(m), m.kin, m.preparation, m.broad, m.narrow, m.response}));
  table.caption = "Thesis: " + manifest.hardware + ".";
  table.notes = manifest.notes;
  return table;
}

/// The mean frame that its authors published for a model of this size, µs.
Value published_us(const ManifestMethod& method, const R& result) {
  if (!result.model) return std::nullopt;
  const auto points = static_cast<double>(result.model->points);
  for (const ManifestMethod::Published& p : method.published)
    if (std::abs(points - p.points) <= kSameSize * p.points) return p.us;
  return std::nullopt;
}
bool is_met(const R& result, double limit_us) {
  return result.frame && result.frame->mean_us && *result.frame->mean_us <= limit_us;
}

/// Number of published times, and of those that are met.
struct PublishedTimes {
  std::size_t met = 0, all = 0;
};

/// A line a renderer, with the mean frame in contact beside the published one.
Table model_table(const ManifestModel& model, const Manifest& manifest,
                  const metrics::ResultDocument& document, PublishedTimes& times) {
  Table table = summary_table(document);
  const std::uint64_t points = document.renderers.empty() || !document.renderers.front().model
                                   ? 0
                                   : document.renderers.front().model->points;
  table.title =
      fmt::format("Table {} on the {}, {} points", manifest.table, model.name, format_count(points));
  table.columns.insert(table.columns.end(), {"mean in contact, µs", "published, µs"});
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const R& r = document.renderers[i];
    table.rows[i].push_back(plain(r.frame ? format_number(r.frame->mean_us) : kMissingNumber));
    const auto method = std::find_if(manifest.methods.begin(), manifest.methods.end(),
                                     [&](const ManifestMethod& m) { return label_of(m) == r.label; });
    const Value published = method == manifest.methods.end() ? Value() : published_us(*method, r);
    table.rows[i].push_back(plain(kMissingNumber));
    if (published) {
      const bool met = is_met(r, *published);
      ++times.all;
      times.met += met ? 1u : 0u;
      table.rows[i].back() = {fmt::format("{}: {}", format_number(*published), met ? "met" : "missed"), false,
                              !met};
    }
    if (r.status == metrics::RunStatus::kOk) continue;
    const char* const fell = r.status == metrics::RunStatus::kFailed ? "does not run" : "did not finish";
    table.rows[i][1] = {fell, false, true};
    table.notes.push_back(fmt::format("{} {}: {}", r.label, fell, r.reason));
  }
  table.notes.push_back(
      "The best mesh: most frames that no hand tells from the truth, to a tenth of a percent, and of these "
      "the one that is ready first; where there is no truth, the shortest mean frame.");
  table.bad_means = "falls short: contact is wrong, slower than published, or did not run";
  table.caption =
      "Times are back to back and without the clock, of frames that are the same for all; those in contact "
      "are compared with the published ones.";
  return table;
}

std::string ratio(double ours, double theirs) {
  constexpr double kMost = 1e6;  // above it one of the two is rounding noise
  if (!(ours > 0.0) || !(theirs > 0.0)) return kMissingNumber;
  const double times = std::max(ours, theirs) / std::min(ours, theirs);
  const std::string text = times > kMost ? "more than a million" : format_number(times);
  return ours <= theirs ? "1/" + text : text;
}

/// Mesh renderers compared with ours.
struct MeshRivals {
  /// Rival with the most frames that hands cannot tell from the truth; of equals the first ready. Without a
  /// truth: the shortest frame.
  const R* best = nullptr;
  const R* ready_first = nullptr;  ///< among preparations measured in this run
};

MeshRivals mesh_rivals(const metrics::ResultDocument& document) {
  std::vector<const R*> meshes;
  double most = -1.0;
  const auto share = [](const R& r) { return r.accuracy ? r.accuracy->indistinguishable_percent : Value(); };
  for (const R& r : document.renderers) {
    if (r.status != metrics::RunStatus::kOk || !r.frame || !r.frame->mean_us || !r.prepare) continue;
    if (r.works_on != render::Geometry::kMesh) continue;
    meshes.push_back(&r);
    most = std::max(most, share(r).value_or(-1.0));
  }
  MeshRivals found;
  const auto take = [](const R*& held, const R* r, double value, double of_held) {
    if (held == nullptr || value < of_held) held = r;
  };
  const auto ms = [](const R* r) { return r == nullptr ? 0.0 : r->prepare->total_ms; };
  const auto us = [](const R* r) { return r == nullptr ? 0.0 : *r->frame->mean_us; };
  for (const R* r : meshes) {
    if (!prepared_from_cache(*r)) take(found.ready_first, r, ms(r), ms(found.ready_first));
    if (most < 0.0)
      take(found.best, r, us(r), us(found.best));
    else if (share(*r).value_or(-1.0) >= most - kSamePercent)
      take(found.best, r, ms(r), ms(found.best));
  }
  return found;
}

/// Compares our point renderers with the best and the first-ready mesh renderer of the same run.
std::vector<std::string> against_meshes(const metrics::ResultDocument& document) {
  const MeshRivals rivals = mesh_rivals(document);
  std::vector<std::string> lines;
  const auto line = [&](const R& own, const char* what, const R* mesh) {
    if (mesh == nullptr) return;
    const std::string preparation = prepared_from_cache(*mesh)
                                        ? "not measured (its mesh came from the cache)"
                                        : ratio(own.prepare->total_ms, mesh->prepare->total_ms);
    lines.push_back(fmt::format(
        "{} against the {} mesh renderer, {}: preparation {}, mean frame {}, memory {}.", own.label, what,
        mesh->label, preparation, ratio(*own.frame->mean_us, *mesh->frame->mean_us),
        ratio(bytes_a_point(own).value_or(0.0), bytes_a_point(*mesh).value_or(0.0))));
  };
  for (const R& own : document.renderers) {
    if (own.status != metrics::RunStatus::kOk || !own.frame || !own.frame->mean_us || !own.prepare) continue;
    if (own.role != render::Role::kOurs || own.works_on != render::Geometry::kPoints) continue;
    if (rivals.best == rivals.ready_first) {
      line(own, "best and first ready", rivals.best);
    } else {
      line(own, "best", rivals.best);
      line(own, "first ready", rivals.ready_first);
    }
  }
  return lines;
}

/// Runs every method on one model; a failure is noted in its result.
Result<metrics::ResultDocument> run_methods(const Manifest& manifest, const ManifestModel& model,
                                            const scene::SceneFile& scene, Reproduction& r) {
  StageRequest request;
  request.scene_name = model.generate.empty() ? model.scan : scene.path;
  request.scene = scene;
  request.path = r.arguments.quick ? manifest.quick_path : model.path.empty() ? manifest.path : model.path;
  request.threads = r.arguments.threads;
  StagedStudy study;
  study.document = new_document(r.context.command_line);
  study.document.title = fmt::format("Table {} on the {}", manifest.table, model.name);
  PALPATE_ASSIGN(study.stage, set_up(request, r.readers, r.context.progress));
  std::vector<RendererRequest> wanted;
  const std::vector<render::ModelInput>& models = study.stage.scene.input.models;
  const bool raster = !models.empty() && models.front().cloud->raster.has_value();
  for (const ManifestMethod* method : rows_on(model, manifest, raster, r)) {
    PALPATE_ASSIGN(RendererRequest one,
                   request_of(fmt::format("{}:label={}", method->renderer, label_of(*method)), r));
    wanted.push_back(std::move(one));
  }
  PALPATE_ASSIGN(study.runs,
                 run_on(study.stage, wanted, run_options(r, kMethodPrepareLimitS), r, study.document));
  for (Run& run : study.runs) run.trace = {};  // only the result is shown
  finish_document(study);
  return std::move(study.document);
}

/// A line of the first page: the published times, and ours beside the best mesh on the last model.
void conclude_methods(const Manifest& manifest, const PublishedTimes& times,
                      const metrics::ResultDocument& last, bool quick, std::vector<Answer>& answers) {
  Answer answer;
  answer.table = fmt::format("{}", manifest.table);
  answer.page = manifest.id() + ".html";
  answer.says = "our approach and others: mean frames that their authors published";
  answer.printed = manifest.hardware;
  if (times.all > 0) answer.ours = fmt::format("{} of {} are met", times.met, times.all);
  const auto error = [](const R& r) {
    const Value percent = settled_score(r, &metrics::Accuracy::force_rms_percent);
    return percent ? format_number(*percent) + " %" : std::string();
  };
  for (const R& r : last.renderers)
    if (r.name == "cloud") answer.error = error(r);
  if (const R* mesh = mesh_rivals(last).best) answer.mesh_error = error(*mesh);
  if (!quick && times.all > 0) answer.reproduced = times.met == times.all ? Judged::kYes : Judged::kNo;
  answer.status = quick || times.all == 0             ? "tried on small models only"
                  : answer.reproduced == Judged::kYes ? "reproduced"
                                                      : "in part: some published times are missed";
  answers.push_back(std::move(answer));
}

}  // namespace

void reproduce_methods(const Manifest& manifest, Reproduction& r) {
  Section section{manifest.id(), manifest.title, {}, {}, {}, {}, {}};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  for (const ManifestMethod& method : manifest.methods)
    if (!is_in_build(method, r))
      leave_out(r, fmt::format("table {}: {} is not in this build", manifest.table, method.renderer));
  PublishedTimes times;
  std::vector<std::string> waiting;
  std::optional<metrics::ResultDocument> last;
  for (const ManifestModel& model : manifest.models) {
    const std::string what = fmt::format("table {}, {}", manifest.table, model.name);
    if (model.full && !r.arguments.full && (!r.arguments.quick || model.quick.empty())) {
      waiting.push_back(model.name);
      continue;
    }
    if (r.arguments.quick && model.quick.empty()) continue;
    const Result<ModelScene> scene = scene_of(model, r);
    if (!scene) {
      leave_out(r, what, scene.error());
      continue;
    }
    Result<metrics::ResultDocument> document = run_methods(manifest, model, scene->file, r);
    if (!document) {
      give_up(r, what, document.error());
      continue;
    }
    add_known(r.part, known_of(document->title, *document));
    Table table = model_table(model, manifest, *document, times);
    for (const std::string& line : against_meshes(*document)) section.found.push_back({model.name, line});
    std::string name = model.name;
    std::erase_if(name, [](char c) { return c == ',' || c == '.'; });
    std::replace(name.begin(), name.end(), ' ', '-');
    write_beside(r, manifest, name + ".json", metrics::to_json(*document));
    section.tables.push_back(std::move(table));
    section.tables.push_back(comparison_table(*document));
    section.tables.back().title = "All scores on the " + model.name;
    last = *std::move(document);
  }
  if (!waiting.empty())
    leave_out(r, fmt::format("table {}, {}: run with --full", manifest.table, joined(waiting, "; ")));
  check_done(r, !section.tables.empty());
  if (last) conclude_methods(manifest, times, *last, r.arguments.quick, r.part.answers);
  section.tables.push_back(words_table(manifest));
  r.part.sections.push_back(std::move(section));
}

}  // namespace palpate::experiments
