// Table 3: every reconstruction on every model, beside the printed times.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "baselines/reconstruct/method_functions.h"
#include "baselines/reconstruct/reconstruct.h"
#include "baselines/reference/facet_tree.h"
#include "experiments/driver/json_document.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/messages.h"
#include "toolkit/search/knn.h"

namespace palpate::experiments {

namespace {

constexpr std::size_t kSamples = 20000;  // points measured in each direction
constexpr std::uint64_t kSeed = 1;       // for thinning a model

/// One method on one model.
struct MeshRow {
  std::string method, model;
  std::size_t points = 0;
  double spacing_mm = 0.0;
  double rounding_mm = 0.0;  ///< of a stored point: no mesh through the points is more accurate
  std::optional<baselines::Reconstruction> made;
  std::optional<baselines::MeshDistance> distance;
  Error failure;

  [[nodiscard]] double normals_ms() const {
    double ms = 0.0;
    for (const render::PreparePhase& phase : made->made.phases)
      if (baselines::is_of_normals(phase)) ms += phase.ms;
    return ms;
  }
};

MeshRow run(const baselines::Method& method, const ManifestModel& model, const cloud::Cloud& cloud,
            baselines::MeshCache* cache, Reproduction& r) {
  MeshRow row;
  row.method = method.name;
  row.model = model.name;
  row.points = cloud.size();
  row.spacing_mm = search::mean_spacing_mm(cloud);
  row.rounding_mm = cloud::stored_rounding_mm(cloud);
  baselines::ReconstructRequest request;
  request.method = method.name;
  request.threads = r.arguments.threads;
  request.cache = cache;
  request.limits.time_s = mesh_limit_s(r);
  r.context.progress.report(fmt::format("{}, {}", model.name, method.name), -1.0);
  Result<baselines::Reconstruction> made = baselines::reconstruct(request, cloud, r.context.progress);
  if (!made) {
    row.failure = std::move(made).error();
    return row;
  }
  row.made = *std::move(made);
  r.context.progress.report(fmt::format("{}, {}: distances", model.name, method.name), -1.0);
  if (const Result<baselines::MeshDistance> distance =
          baselines::mesh_distance(row.made->mesh, cloud, kSamples, r.arguments.threads))
    row.distance = *distance;
  row.made->mesh = {.vertices_mm = {}, .triangles = std::move(row.made->mesh.triangles)};
  return row;
}

/// Runs the methods of this build that accept the model's points; without --full the kin of printed ones.
std::vector<MeshRow> run_all(const Manifest& manifest, const ManifestModel& model, const cloud::Cloud& cloud,
                             baselines::MeshCache* cache, Reproduction& r) {
  std::vector<MeshRow> rows;
  std::vector<std::string> waiting;
  for (const baselines::Method& method : baselines::methods()) {
    if (method.raster_only && !cloud.raster) continue;
    const bool is_kin = std::any_of(manifest.printed_meshes.begin(), manifest.printed_meshes.end(),
                                    [&](const PrintedMesh& printed) { return printed.kin == method.name; });
    if (!is_kin && waits_for_full(r)) {
      waiting.push_back(method.name);
      continue;
    }
    if (method.not_built.empty()) {
      rows.push_back(run(method, model, cloud, cache, r));
    } else {
      rows.push_back({});
      rows.back().method = method.name;
      rows.back().failure = {"not in this build", method.not_built, {}, 0};
    }
    const MeshRow& row = rows.back();
    if (!row.made) leave_out(r, fmt::format("table 3, {}, {}", model.name, row.method), row.failure);
  }
  if (!waiting.empty())
    leave_out(r, fmt::format("table 3, {}, {}: no kin of a printed one; run with --full", model.name,
                             joined(waiting)));
  return rows;
}

std::string spacings(double mm, const MeshRow& row) {
  return format_number(zero_if_rounding(mm, row.rounding_mm) / row.spacing_mm);
}

Table model_table(const ManifestModel& model, const std::vector<MeshRow>& rows) {
  constexpr double kMegabyte = 1e6;
  Table table;
  const std::size_t points = rows.empty() ? 0 : rows.front().points;
  table.title = fmt::format("Reconstruction of the {}, {} points", model.name, format_count(points));
  table.columns = {"method",      "time",         "of it normals", "faces",      "peak memory, MB",
                   "points, RMS", "points, most", "mesh, RMS",     "mesh, most", "made"};
  for (const MeshRow& row : rows) {
    if (!row.made) {
      table.rows.push_back(
          {plain(row.method), {row.failure.gave_up ? "did not finish" : "failed", false, true}});
      table.rows.back().resize(table.columns.size(), plain(kMissingNumber));
      table.notes.push_back(fmt::format("{}: {}.", row.method, row.failure.message()));
      continue;
    }
    const double normals_ms = row.normals_ms();
    table.rows.push_back(plain_row(
        {row.method, format_duration(row.made->made.total_ms),
         normals_ms > 0.0 ? format_duration(normals_ms) : kMissingNumber,
         format_count(row.made->mesh.triangles.size()),
         format_count(static_cast<std::uint64_t>(static_cast<double>(row.made->peak_bytes) / kMegabyte))}));
    std::vector<Cell>& cells = table.rows.back();
    if (const auto& d = row.distance)
      for (const double mm : {d->points_rms_mm, d->points_max_mm, d->mesh_rms_mm, d->mesh_max_mm})
        cells.push_back(plain(spacings(mm, row)));
    cells.resize(table.columns.size() - 1, plain(kMissingNumber));
    cells.push_back(plain(row.made->recorded ? row.made->made_on : "now"));
  }
  table.bad_means = "no mesh came of it: see below";
  table.caption = fmt::format(
      "Distances in spacings ({} mm), from {} points to the mesh and from as many places of the mesh to the "
      "nearest point; places between points are themselves half a spacing from them. 0: no more than the "
      "rounding of a stored point. Time: all phases in a "
      "process of its own. Made: a mesh from the cache shows the time of the day it was made.",
      rows.empty() ? kMissingNumber : format_number(rows.front().spacing_mm),
      format_count(std::min(kSamples, points)));
  return table;
}

const MeshRow* kin_of(const PrintedMesh& printed, const std::vector<MeshRow>& rows) {
  const auto found = std::find_if(rows.begin(), rows.end(), [&](const MeshRow& row) {
    return row.method == printed.kin && row.model == printed.ours;
  });
  return found == rows.end() ? nullptr : &*found;
}

Table printed_table(const Manifest& manifest, const std::vector<MeshRow>& rows) {
  Table table;
  table.title = manifest.title;
  table.columns = {"thesis", "its model", "its time", "its machine", "nearest kin", "our model", "our time"};
  for (const PrintedMesh& printed : manifest.printed_meshes) {
    table.rows.push_back(
        plain_row({printed.method, printed.model, printed.time, printed.machine, printed.kin}));
    std::vector<Cell>& cells = table.rows.back();
    if (const MeshRow* row = kin_of(printed, rows)) {
      cells.push_back(plain(fmt::format("{}, {}", row->model, format_count(row->points))));
      if (row->made)
        cells.push_back(plain(format_duration(row->made->made.total_ms)));
      else
        cells.push_back({row->failure.gave_up ? "did not finish" : "failed", false, true});
    }
    cells.resize(table.columns.size(), plain(kMissingNumber));
  }
  table.bad_means = "no mesh came of it";
  table.caption = "Thesis: " + manifest.hardware + ". Ours: this machine, normals included.";
  table.notes = manifest.notes;
  return table;
}

/// Format: docs/schemas/meshes.schema.json.
nlohmann::ordered_json to_json(const std::vector<MeshRow>& rows, const std::vector<std::string>& warnings,
                               const metrics::DocumentHead& head) {
  nlohmann::ordered_json document = begin_json("palpate-meshes/1", head);
  document["warnings"] = warnings;
  nlohmann::ordered_json& all = document["meshes"] = nlohmann::ordered_json::array();
  for (const MeshRow& row : rows) {
    nlohmann::ordered_json one = {{"model", row.model}, {"method", row.method}, {"points", row.points}};
    if (row.made) {
      one["total_ms"] = row.made->made.total_ms;
      for (const render::PreparePhase& phase : row.made->made.phases)
        one["phases"].push_back({{"name", phase.name}, {"ms", phase.ms}});
      one["faces"] = row.made->mesh.triangles.size();
      one["peak_bytes"] = row.made->peak_bytes;
      one["threads"] = row.made->threads;
      one["made_on"] = row.made->made_on;
      one["recorded"] = row.made->recorded;
      one["notes"] = row.made->made.notes;
    } else {
      one["failure"] = row.failure.message();
      one["gave_up"] = row.failure.gave_up;
    }
    if (row.distance) {
      one["samples"] = row.distance->samples;
      one["points_to_mesh_rms_mm"] = row.distance->points_rms_mm;
      one["points_to_mesh_max_mm"] = row.distance->points_max_mm;
      one["mesh_to_points_rms_mm"] = row.distance->mesh_rms_mm;
      one["mesh_to_points_max_mm"] = row.distance->mesh_max_mm;
    }
    all.push_back(std::move(one));
  }
  return document;
}

/// Time of each printed method here, and a line of the first page that is not judged: models and machines
/// differ.
void conclude_meshes(const Manifest& manifest, const std::vector<MeshRow>& rows, Section& section,
                     std::vector<Answer>& answers) {
  double first = HUGE_VAL, last = 0.0, first_min = HUGE_VAL, last_min = 0.0;
  for (const PrintedMesh& printed : manifest.printed_meshes) {
    const MeshRow* row = kin_of(printed, rows);
    if (row == nullptr || !row->made || printed.minutes.empty()) continue;
    const double ms = row->made->made.total_ms;
    section.found.push_back(
        {fmt::format("{} as {}", printed.method, row->method),
         fmt::format("{} for {} points of the {}; the thesis: {} for {}, on {}", format_duration(ms),
                     format_count(row->points), row->model, printed.time, printed.model, printed.machine)});
    first = std::min(first, ms);
    last = std::max(last, ms);
    first_min = std::min(first_min, printed.minutes.front());
    last_min = std::max(last_min, printed.minutes.back());
  }
  if (section.found.empty()) return;
  Answer answer;
  answer.table = fmt::format("{}", manifest.table);
  answer.page = section.id + ".html";
  answer.says = "surface reconstruction takes minutes";
  answer.printed =
      fmt::format("{} to {} min, {}", format_number(first_min), format_number(last_min), manifest.hardware);
  answer.ours = fmt::format("{} to {}", format_duration(first), format_duration(last));
  answer.status = "not judged: other machines and sizes";
  answers.push_back(std::move(answer));
}

}  // namespace

void reproduce_meshes(const Manifest& manifest, Reproduction& r) {
  std::optional<baselines::MeshCache> cache = baselines::MeshCache::standard();
  std::vector<std::string> warnings;
  std::vector<MeshRow> rows;
  std::vector<Table> tables;
  for (const ManifestModel& model : manifest.models) {
    const Result<ModelScene> scene = scene_of(model, r);
    if (!scene) {
      leave_out(r, fmt::format("table {}, {}", manifest.table, model.name), scene.error());
      continue;
    }
    const Result<scene::LoadedScene> loaded = scene::load(scene->file, r.readers, {}, r.context.progress);
    if (!loaded) {
      give_up(r, fmt::format("table {}, {}", manifest.table, model.name), loaded.error());
      continue;
    }
    add_warnings(warnings, model.name, *loaded);
    const cloud::Cloud& whole = *loaded->input.models.front().cloud;
    const bool thin = !r.arguments.full && model.points_in_time > 0 && model.points_in_time < whole.size();
    std::vector<MeshRow> some =
        run_all(manifest, model, thin ? cloud::random_subset(whole, model.points_in_time, kSeed) : whole,
                cache ? &*cache : nullptr, r);
    tables.push_back(model_table(model, some));
    if (thin)
      tables.back().notes.push_back(fmt::format("{} of the {}'s {} points, at random; --full takes all.",
                                                format_count(model.points_in_time), model.name,
                                                format_count(whole.size())));
    std::move(some.begin(), some.end(), std::back_inserter(rows));
  }
  check_done(r,
             std::any_of(rows.begin(), rows.end(), [](const MeshRow& row) { return row.made.has_value(); }));
  add_known(r.part, {fmt::format("Table {}", manifest.table), warnings, {}});
  write_beside(
      r, manifest, "meshes.json",
      to_json(rows, warnings, r.head).dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) +
          "\n");
  tables.insert(tables.begin(), printed_table(manifest, rows));
  Section section{manifest.id(), manifest.title, {}, {}, std::move(tables), {}, {}};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  conclude_meshes(manifest, rows, section, r.part.answers);
  r.part.sections.push_back(std::move(section));
}

}  // namespace palpate::experiments
