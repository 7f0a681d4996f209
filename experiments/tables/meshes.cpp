// Table 3: every reconstruction on every model, and the printed times beside them.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "baselines/reconstruct/oriented_normals.h"
#include "baselines/reconstruct/reconstruct.h"
#include "baselines/reference/mesh_distance.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/cloud/sample.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::experiments {

namespace {

constexpr double kMsPerMinute = 60000.0;
constexpr std::size_t kSamples = 20000;  // places whose distance is measured, either way
constexpr std::uint64_t kSeed = 1;       // of the points that a thinned model keeps

/// One method on one model.
struct MeshRow {
  std::string method, model;
  std::size_t points = 0;
  double spacing_mm = 0.0;
  double rounding_mm = 0.0;  ///< of a stored point: a mesh through the points is no nearer to them
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
  row.spacing_mm = neighbourhood::mean_spacing_mm(cloud);
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

/// Every method on one model: those that this build has, and that take its points.
std::vector<MeshRow> run_all(const ManifestModel& model, const cloud::Cloud& cloud,
                             baselines::MeshCache* cache, Reproduction& r) {
  std::vector<MeshRow> rows;
  for (const baselines::Method& method : baselines::methods()) {
    if (method.raster_only && !cloud.raster) continue;
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
  return rows;
}

std::string spacings(double mm, const MeshRow& row) {
  return short_number(settled(mm, row.rounding_mm) / row.spacing_mm);
}

Table model_table(const ManifestModel& model, const std::vector<MeshRow>& rows) {
  constexpr double kMegabyte = 1e6;
  Table table;
  const std::size_t points = rows.empty() ? 0 : rows.front().points;
  table.title = fmt::format("Reconstruction of the {}, {} points", model.name, count_text(points));
  table.columns = {"method",      "time",         "of it normals", "faces",      "peak memory, MB",
                   "points, RMS", "points, most", "mesh, RMS",     "mesh, most", "made"};
  for (const MeshRow& row : rows) {
    if (!row.made) {
      table.rows.push_back(
          {plain(row.method), {row.failure.gave_up ? "did not finish" : "failed", false, true}});
      table.rows.back().resize(table.columns.size(), plain(kNoNumber));
      table.notes.push_back(fmt::format("{}: {}.", row.method, row.failure.message()));
      continue;
    }
    const double normals_ms = row.normals_ms();
    table.rows.push_back({plain(row.method), plain(duration_text(row.made->made.total_ms)),
                          plain(normals_ms > 0.0 ? duration_text(normals_ms) : kNoNumber),
                          plain(count_text(row.made->mesh.triangles.size())),
                          plain(count_text(static_cast<std::uint64_t>(
                              static_cast<double>(row.made->peak_bytes) / kMegabyte)))});
    std::vector<Cell>& cells = table.rows.back();
    if (const auto& d = row.distance)
      for (const double mm : {d->points_rms_mm, d->points_max_mm, d->mesh_rms_mm, d->mesh_max_mm})
        cells.push_back(plain(spacings(mm, row)));
    cells.resize(table.columns.size() - 1, plain(kNoNumber));
    cells.push_back(plain(row.made->recorded ? row.made->made_on : "now"));
  }
  table.bad_means = "no mesh came of it: see below";
  table.caption = fmt::format(
      "Distances in spacings ({} mm), from {} points to the mesh and from as many places of the mesh to the "
      "nearest point; places between points are themselves half a spacing from them. 0: no more than the "
      "rounding of a stored point. Time: all phases in a "
      "process of its own. Made: a mesh from the cache shows the time of the day it was made.",
      rows.empty() ? kNoNumber : short_number(rows.front().spacing_mm),
      count_text(std::min(kSamples, points)));
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
    table.rows.push_back({plain(printed.method), plain(printed.model), plain(printed.time),
                          plain(printed.machine), plain(printed.kin)});
    std::vector<Cell>& cells = table.rows.back();
    if (const MeshRow* row = kin_of(printed, rows)) {
      cells.push_back(plain(fmt::format("{}, {}", row->model, count_text(row->points))));
      if (row->made)
        cells.push_back(plain(duration_text(row->made->made.total_ms)));
      else
        cells.push_back({row->failure.gave_up ? "did not finish" : "failed", false, true});
    }
    cells.resize(table.columns.size(), plain(kNoNumber));
  }
  table.bad_means = "no mesh came of it";
  table.caption = "Thesis: " + manifest.hardware + ". Ours: this machine, normals included.";
  table.notes = manifest.notes;
  return table;
}

/// docs/meshes.schema.json describes it.
nlohmann::ordered_json to_json(const std::vector<MeshRow>& rows, const std::vector<std::string>& warnings,
                               const metrics::DocumentHead& head) {
  nlohmann::ordered_json document = {{"schema", "palpate-meshes/1"}};
  document.update(nlohmann::ordered_json::parse(metrics::head_json(head)));
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

void add_headlines(const Manifest& manifest, const std::vector<MeshRow>& rows, Reproduction& r) {
  HeadlineGroup found{manifest.title, {}};
  for (const PrintedMesh& printed : manifest.printed_meshes) {
    const MeshRow* row = kin_of(printed, rows);
    if (row == nullptr || !row->made || printed.minutes.empty()) continue;
    found.lines.push_back({fmt::format("{} as {}", printed.method, row->method),
                           fmt::format("{} for {} points of the {}; the thesis: {} for {}, on {}",
                                       duration_text(row->made->made.total_ms), count_text(row->points),
                                       row->model, printed.time, printed.model, printed.machine)});
  }
  if (!found.lines.empty()) r.page.headlines.push_back(std::move(found));
}

void write_results(const Manifest& manifest, const std::vector<MeshRow>& rows,
                   const std::vector<std::string>& warnings, Reproduction& r) {
  add_known(r.page, {fmt::format("Table {}", manifest.table), warnings, {}});
  const Result<OutputFolder> folder = r.folder.inside(fmt::format("table{}", manifest.table));
  const auto text = to_json(rows, warnings, r.page.about)
                        .dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  const Status written = folder ? folder->write("meshes.json", text + "\n") : Status(folder.error());
  if (!written) give_up(r, fmt::format("the results of table {}", manifest.table), written.error());
}

}  // namespace

void reproduce_meshes(const Manifest& manifest, Reproduction& r) {
  std::optional<baselines::MeshCache> cache = baselines::MeshCache::standard();
  std::vector<std::string> warnings;
  std::vector<MeshRow> rows;
  std::vector<Table> tables;
  for (const ManifestModel& model : manifest.models) {
    const Result<scene::SceneFile> scene = scene_of(model, r);
    if (!scene) {
      leave_out(r, fmt::format("table {}, {}", manifest.table, model.name), scene.error());
      continue;
    }
    const Result<scene::LoadedScene> loaded = scene::load(*scene, r.readers, {}, r.context.progress);
    if (!loaded) {
      give_up(r, fmt::format("table {}, {}", manifest.table, model.name), loaded.error());
      continue;
    }
    add_warnings(warnings, model.name, *loaded);
    const cloud::Cloud& whole = *loaded->input.models.front().cloud;
    const bool thin = !r.arguments.full && model.points_in_time > 0 && model.points_in_time < whole.size();
    std::vector<MeshRow> some =
        run_all(model, thin ? cloud::sample_of(whole, model.points_in_time, kSeed) : whole,
                cache ? &*cache : nullptr, r);
    tables.push_back(model_table(model, some));
    if (thin)
      tables.back().notes.push_back(fmt::format("{} of the {}'s {} points, at random; --full takes all.",
                                                count_text(model.points_in_time), model.name,
                                                count_text(whole.size())));
    std::move(some.begin(), some.end(), std::back_inserter(rows));
  }
  check_done(r,
             std::any_of(rows.begin(), rows.end(), [](const MeshRow& row) { return row.made.has_value(); }));
  write_results(manifest, rows, warnings, r);
  tables.insert(tables.begin(), printed_table(manifest, rows));
  add_headlines(manifest, rows, r);
  Section section{fmt::format("table{}", manifest.table), manifest.title, {}, {}, tables, {}, {}};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  r.page.sections.push_back(std::move(section));
  std::move(tables.begin(), tables.end(), std::back_inserter(r.tables));
}

}  // namespace palpate::experiments
