// Table 11: every method on models of the sizes at which they were published.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "baselines/reconstruct/methods.h"
#include "experiments/tables/reproduction.h"

namespace palpate::experiments {
namespace {

using R = metrics::RendererResult;
using Value = std::optional<double>;

constexpr double kMethodPrepareLimitS = 120.0, kMethodFullPrepareLimitS = 3600.0;
/// Two renderers of which hands tell the same share of frames from the truth, to the tenth of a percent that
/// is printed, are equally right.
constexpr double kSamePercent = 0.1;
/// A published figure is compared with a model of at most this share more or fewer points.
constexpr double kSameSize = 0.1;

Value bytes_per_point(const R& result) {
  if (!result.prepare || !result.model || result.model->points == 0) return std::nullopt;
  return static_cast<double>(result.prepare->bytes) / static_cast<double>(result.model->points);
}

const std::string& label_of(const ManifestMethod& method) {
  return method.label.empty() ? method.renderer : method.label;
}

/// How a row's mesh is made, where it names a reconstruction; an Error where this build does not have that
/// one.
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

/// The rows that a model gets. What is left out for time is said; what needs a raster has no meaning without
/// one.
std::vector<const ManifestMethod*> rows_on(const ManifestModel& model, const Manifest& manifest, bool raster,
                                           Reproduction& r) {
  std::vector<const ManifestMethod*> rows;
  for (const ManifestMethod& method : manifest.methods) {
    const std::string& label = label_of(method);
    if (!is_in_build(method, r)) continue;  // said once for all models
    if (!model.only.empty() && !holds(model.only, label)) continue;
    const baselines::Method* made = *reconstruction_of(method);
    if (made != nullptr && made->raster_only && !raster) continue;
    if (holds(model.slow, label) && !r.arguments.full) {
      r.missing.push_back(fmt::format("table {}, {} on the {}: it is slow; run with --full", manifest.table,
                                      label, model.name));
      continue;
    }
    rows.push_back(&method);
  }
  return rows;
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
  return plain(kNoNumber);
}

/// A table with a row for each renderer, made column by column; who did not run has dashes.
class ByRenderer {
 public:
  explicit ByRenderer(const metrics::ResultDocument& document) : document_(document) {
    table.columns = {"renderer"};
    for (const R& r : document.renderers) table.rows.push_back({plain(r.label)});
  }
  template <class Of>
  void cells(std::string name, const Of& cell) {
    table.columns.push_back(std::move(name));
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
      const R& r = document_.renderers[i];
      table.rows[i].push_back(r.status == metrics::RunStatus::kOk ? cell(r, i) : plain(kNoNumber));
    }
  }
  template <class Of>
  void numbers(std::string name, const Of& value) {
    std::vector<Value> values;
    for (const R& r : document_.renderers) values.push_back(value(r));
    const std::vector<std::string> texts = aligned_numbers(values);
    cells(std::move(name), [&](const R&, std::size_t i) { return plain(texts[i]); });
  }
  void times(std::string name, Value trace::FrameStatistics::*member) {
    numbers(std::move(name), [member](const R& r) { return r.frame ? (*r.frame).*member : std::nullopt; });
  }
  /// Any is too many.
  template <class Of>
  void faults(std::string name, const Of& value) {
    cells(std::move(name), [&](const R& r, std::size_t) {
      const std::optional<std::uint64_t> n = r.accuracy ? value(*r.accuracy) : std::nullopt;
      return n ? Cell{count_text(*n), false, *n > 0} : plain(kNoNumber);
    });
  }

  Table table;

 private:
  const metrics::ResultDocument& document_;
};

Table model_table(const ManifestModel& model, const Manifest& manifest,
                  const metrics::ResultDocument& document) {
  using A = metrics::Accuracy;
  using F = trace::FrameStatistics;
  using MaybeCount = std::optional<std::uint64_t>;
  ByRenderer by(document);
  const std::uint64_t points = document.renderers.empty() || !document.renderers.front().model
                                   ? 0
                                   : document.renderers.front().model->points;
  by.table.title =
      fmt::format("Table {} on the {}, {} points", manifest.table, model.name, count_text(points));
  by.cells("preparation", [](const R& r, std::size_t) { return plain(preparation_text(r)); });
  by.numbers("bytes a point", bytes_per_point);
  const std::string frames = frames_text(document);
  by.cells("frames in contact" + (frames.empty() ? "" : ", " + frames), [](const R& r, std::size_t) {
    return plain(r.frame ? count_text(r.frame->timed_frames) : kNoNumber);
  });
  by.times("mean without the clock, µs", &F::mean_us);
  by.cells("published", [&](const R& r, std::size_t) {
    const auto method = std::find_if(manifest.methods.begin(), manifest.methods.end(),
                                     [&](const ManifestMethod& m) { return label_of(m) == r.label; });
    return method == manifest.methods.end() ? plain(kNoNumber) : published_cell(*method, r);
  });
  by.cells("its interval, 95 %", [](const R& r, std::size_t) {
    return plain(r.frame ? interval_text(r.frame->mean_interval_us) : kNoNumber);
  });
  by.numbers("mean of all frames, µs",
             [](const R& r) { return r.frame_all ? r.frame_all->mean_us : Value(); });
  by.times("mean, µs", &F::mean_clocked_us);
  by.times("99.9 %, µs", &F::p999_us);
  by.numbers("99.9 % of all frames, µs",
             [](const R& r) { return r.frame_all ? r.frame_all->p999_us : Value(); });
  by.times("longest, µs", &F::max_us);
  by.numbers("frames that no hand tells from the truth, %",
             [](const R& r) { return r.accuracy ? r.accuracy->indistinguishable_percent : Value(); });
  by.numbers("force error, RMS, %", [](const R& r) { return settled_score(r, &A::force_rms_percent); });
  by.faults("missed, frames", [](const A& a) { return MaybeCount(a.missed_contact_frames); });
  by.faults("false, frames", [](const A& a) { return MaybeCount(a.false_contact_frames); });
  by.faults("pop-throughs", [](const A& a) { return a.pop_throughs; });
  for (std::size_t i = 0; i < document.renderers.size(); ++i) {
    const R& r = document.renderers[i];
    if (r.status == metrics::RunStatus::kOk) continue;
    const char* const fell = r.status == metrics::RunStatus::kFailed ? "does not run" : "did not finish";
    by.table.rows[i][1] = {fell, false, true};
    by.table.notes.push_back(fmt::format("{} {}: {}", r.label, fell, r.reason));
  }
  by.table.notes.push_back(
      "Best: most frames that no hand tells from the truth, to a tenth of a percent, and of these the one "
      "that is "
      "ready first; where there is no truth, the shortest mean frame.");
  by.table.bad_means = "falls short: slower than published, contact missed, false or lost, or did not run";
  by.table.caption =
      "Times are of the ground truth's contact frames, the same for all, back to back: without the clock of "
      "whole runs of frames, which the "
      "published times are compared with; the others of single frames, each with the clock's cost in it.";
  return std::move(by.table);
}

std::string ratio(double ours, double theirs) {
  constexpr double kMost = 1e6;  // beyond it one of the two is rounding or chance
  if (!(ours > 0.0) || !(theirs > 0.0)) return kNoNumber;
  const double times = std::max(ours, theirs) / std::min(ours, theirs);
  const std::string text = times > kMost ? "more than a million" : short_number(times);
  return ours <= theirs ? "1/" + text : text;
}

/// The mesh renderers that ours are held against.
struct MeshRivals {
  /// Of those whose forces most frames cannot be told from the truth by, the one that is ready first; without
  /// a truth the one with the shortest frame.
  const R* best = nullptr;
  const R* ready_first = nullptr;  ///< of those whose preparation was measured in this run
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

/// Each of ours that works on points against the best mesh renderer of the same run, and the one ready first.
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
        ratio(bytes_per_point(own).value_or(0.0), bytes_per_point(*mesh).value_or(0.0))));
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

/// Every method on one model; what does not run says so in its result.
Result<metrics::ResultDocument> run_methods(const Manifest& manifest, const ManifestModel& model,
                                            const scene::SceneFile& scene, Reproduction& r) {
  StageRequest request;
  request.scene_name = model.generate.empty() ? model.scan : scene.path;
  request.scene = scene;
  request.path = r.arguments.quick ? manifest.quick_path : model.path.empty() ? manifest.path : model.path;
  request.threads = r.arguments.threads;
  StagedStudy study;
  study.document = new_document(r.context.command_line);
  Result<Stage> stage = set_up(request, r.readers, r.context.progress);
  if (!stage) return std::move(stage).error();
  study.stage = *std::move(stage);
  RunOptions options;
  options.threads = r.arguments.threads;
  options.prepare_limit_s = r.arguments.full ? kMethodFullPrepareLimitS : kMethodPrepareLimitS;
  set_passes(options, r);
  std::vector<RendererRequest> wanted;
  const std::vector<render::ModelInput>& models = study.stage.scene.input.models;
  const bool raster = !models.empty() && models.front().cloud->raster.has_value();
  for (const ManifestMethod* method : rows_on(model, manifest, raster, r)) {
    Result<std::vector<RendererRequest>> requests =
        parse_renderers(fmt::format("{}:label={}", method->renderer, label_of(*method)), r.registry);
    if (!requests) return std::move(requests).error();
    wanted.push_back(std::move(requests->front()));
    limit_reconstruction(wanted.back(), r);
  }
  Result<std::vector<Run>> runs = run_renderers(study.stage, wanted, r.registry, options, r.context.progress,
                                                study.document.conditions.emplace(), {});
  if (!runs) return std::move(runs).error();
  add_program(*study.document.conditions);
  study.runs = *std::move(runs);
  for (Run& run : study.runs) run.trace = {};  // a result is all that is shown
  finish_document(study);
  return std::move(study.document);
}

}  // namespace

void reproduce_methods(const Manifest& manifest, Reproduction& r) {
  Section section{
      fmt::format("table{}", manifest.table), manifest.title, {}, {}, {words_table(manifest)}, {}, {}};
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
    const Result<scene::SceneFile> scene = scene_of(model, r);
    if (!scene) {
      leave_out(r, fmt::format("table {}, {}", manifest.table, model.name), scene.error());
      continue;
    }
    const Result<metrics::ResultDocument> document = run_methods(manifest, model, *scene, r);
    if (!document) {
      give_up(r, fmt::format("table {}, {}", manifest.table, model.name), document.error());
      continue;
    }
    add_known(r.page, known_of(fmt::format("Table {} on the {}", manifest.table, model.name), *document));
    Table table = model_table(model, manifest, *document);
    for (const std::string& line : against_meshes(*document)) {
      table.notes.push_back(line);
      found.lines.push_back({model.name, line});
    }
    std::string name = model.name;
    std::erase_if(name, [](char c) { return c == ',' || c == '.'; });
    std::replace(name.begin(), name.end(), ' ', '-');
    if (const Result<OutputFolder> folder = r.folder.inside(fmt::format("table{}", manifest.table)))
      if (const Status written = folder->write(name + ".json", metrics::to_json(*document)); !written)
        give_up(r, "table 11's results", written.error());
    r.tables.push_back(table);
    section.tables.push_back(std::move(table));
  }
  check_done(r, section.tables.size() > 1);  // the first is of words
  if (!found.lines.empty()) r.page.headlines.push_back(std::move(found));
  r.page.sections.push_back(std::move(section));
}

}  // namespace palpate::experiments
