// Table 3: every reconstruction on every model, and the printed times beside them.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "experiments/command/reproduction.h"
#ifdef PALPATE_WITH_BASELINES
#include "baselines/reconstruct/reconstruct.h"
#include "baselines/reference/mesh_distance.h"
#endif
#include "toolkit/core/random.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::experiments {

#ifndef PALPATE_WITH_BASELINES

void reproduce_meshes(const Manifest& manifest, Reproduction& r) {
  give_up(r, fmt::format("table {}", manifest.table),
          {"built without the baselines", "configure with -DPALPATE_BUILD_BASELINES=ON", {}, 0});
}

#else

namespace {

constexpr double kMsPerMinute = 60000.0;
constexpr std::size_t kSamples = 20000;  // places whose distance is measured, either way
constexpr std::uint64_t kSeed = 1;       // of the points that a thinned model keeps

Cell plain(std::string text) {
  return {std::move(text), false, false};
}

/// `count` of the points, at random, in their order.
cloud::Cloud thinned(const cloud::Cloud& cloud, std::size_t count) {
  std::vector<std::uint32_t> kept(cloud.size());
  std::iota(kept.begin(), kept.end(), 0u);
  Random random(kSeed);
  for (std::size_t i = 0; i < count; ++i) std::swap(kept[i], kept[i + random.below(kept.size() - i)]);
  kept.resize(count);
  std::sort(kept.begin(), kept.end());
  cloud::Cloud thin;
  thin.origin_mm = cloud.origin_mm;
  for (const std::uint32_t i : kept) {
    thin.x_mm.push_back(cloud.x_mm[i]);
    thin.y_mm.push_back(cloud.y_mm[i]);
    thin.z_mm.push_back(cloud.z_mm[i]);
  }
  return thin;
}

/// One method on one model.
struct Row {
  std::string method, model;
  std::size_t points = 0;
  double spacing_mm = 0.0;
  std::optional<baselines::Reconstruction> made;
  std::optional<baselines::MeshDistance> distance;
  Error failure;

  [[nodiscard]] double normals_ms() const {
    double ms = 0.0;
    for (const render::PreparePhase& phase : made->made.phases)
      if (phase.name.find("normals") != std::string::npos) ms += phase.ms;
    return ms;
  }
};

Row run(const baselines::Method& method, const ManifestModel& model, const cloud::Cloud& cloud,
        baselines::MeshCache* cache, Reproduction& r) {
  Row row;
  row.method = method.name;
  row.model = model.name;
  row.points = cloud.size();
  row.spacing_mm = neighbourhood::mean_spacing_mm(cloud);
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
std::vector<Row> run_all(const ManifestModel& model, const cloud::Cloud& cloud, baselines::MeshCache* cache,
                         Reproduction& r) {
  std::vector<Row> rows;
  for (const baselines::Method& method : baselines::methods()) {
    if (r.context.progress.cancelled()) break;
    if (method.raster_only && !cloud.raster) continue;
    if (method.not_built.empty()) {
      rows.push_back(run(method, model, cloud, cache, r));
    } else {
      rows.push_back({});
      rows.back().method = method.name;
      rows.back().failure = {"not in this build", method.not_built, {}, 0};
    }
    const Row& row = rows.back();
    if (!row.made)
      r.missing.push_back(fmt::format("table 3, {}, {}: {}", model.name, row.method, row.failure.message()));
  }
  return rows;
}

std::string spacings(double mm, const Row& row) {
  return short_number(mm / row.spacing_mm);
}

Table model_table(const ManifestModel& model, const std::vector<Row>& rows) {
  constexpr double kMegabyte = 1e6;
  Table table;
  const std::size_t points = rows.empty() ? 0 : rows.front().points;
  table.title = fmt::format("Reconstruction of the {}, {} points", model.name, count_text(points));
  table.columns = {"method",      "time",         "of it normals", "faces",      "peak memory, MB",
                   "points, RMS", "points, most", "mesh, RMS",     "mesh, most", "made"};
  for (const Row& row : rows) {
    if (!row.made) {
      table.rows.push_back(
          {plain(row.method), {row.failure.gave_up ? "did not finish" : "failed", false, true}});
      table.rows.back().resize(table.columns.size(), plain("–"));
      table.notes.push_back(fmt::format("{}: {}.", row.method, row.failure.message()));
      continue;
    }
    const double normals_ms = row.normals_ms();
    table.rows.push_back({plain(row.method), plain(duration_text(row.made->made.total_ms)),
                          plain(normals_ms > 0.0 ? duration_text(normals_ms) : "–"),
                          plain(count_text(row.made->mesh.triangles.size())),
                          plain(count_text(static_cast<std::uint64_t>(
                              static_cast<double>(row.made->peak_bytes) / kMegabyte)))});
    std::vector<Cell>& cells = table.rows.back();
    if (const auto& d = row.distance)
      for (const double mm : {d->points_rms_mm, d->points_max_mm, d->mesh_rms_mm, d->mesh_max_mm})
        cells.push_back(plain(spacings(mm, row)));
    cells.resize(table.columns.size() - 1, plain("–"));
    cells.push_back(plain(row.made->recorded ? row.made->made_on : "now"));
  }
  table.caption = fmt::format(
      "Distances in spacings ({} mm), from {} points to the mesh and from as many places of the mesh to the "
      "nearest point; places between points are themselves half a spacing from them. Time: all phases in a "
      "process of its own. Made: a mesh from the cache shows the time of the day it was made.",
      rows.empty() ? "–" : short_number(rows.front().spacing_mm), count_text(std::min(kSamples, points)));
  return table;
}

const Row* kin_of(const PrintedMesh& printed, const std::vector<Row>& rows) {
  const auto found = std::find_if(rows.begin(), rows.end(), [&](const Row& row) {
    return row.method == printed.kin && row.model == printed.ours;
  });
  return found == rows.end() ? nullptr : &*found;
}

Table printed_table(const Manifest& manifest, const std::vector<Row>& rows) {
  Table table;
  table.title = manifest.title;
  table.columns = {"thesis", "its model", "its time", "its machine", "nearest kin", "our model", "our time"};
  for (const PrintedMesh& printed : manifest.printed_meshes) {
    table.rows.push_back({plain(printed.method), plain(printed.model), plain(printed.time),
                          plain(printed.machine), plain(printed.kin)});
    std::vector<Cell>& cells = table.rows.back();
    if (const Row* row = kin_of(printed, rows)) {
      cells.push_back(plain(fmt::format("{}, {}", row->model, count_text(row->points))));
      if (row->made)
        cells.push_back(plain(duration_text(row->made->made.total_ms)));
      else
        cells.push_back({row->failure.gave_up ? "did not finish" : "failed", false, true});
    }
    cells.resize(table.columns.size(), plain("–"));
  }
  table.caption = "Thesis: " + manifest.hardware + ". Ours: this machine, normals included.";
  table.notes = manifest.notes;
  return table;
}

metrics::RendererResult as_result(const Row& row, int threads) {
  metrics::RendererResult result;
  result.label = fmt::format("{}-{}", row.model, row.method);
  result.name = row.method;
  result.model = metrics::RendererResult::Model{row.points, 0.0};
  result.threads = threads;
  if (row.made) {
    result.prepare = row.made->made;
    result.threads = row.made->threads;
  } else {
    result.status = row.failure.gave_up ? metrics::RunStatus::kDidNotFinish : metrics::RunStatus::kFailed;
    result.reason = row.failure.message();
  }
  return result;
}

nlohmann::ordered_json to_json(const std::vector<Row>& rows) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const Row& row : rows) {
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
  return all;
}

void add_headlines(const Manifest& manifest, const std::vector<Row>& rows, Reproduction& r) {
  HeadlineGroup found{manifest.title, {}};
  for (const PrintedMesh& printed : manifest.printed_meshes) {
    const Row* row = kin_of(printed, rows);
    if (row == nullptr || !row->made || printed.minutes.empty()) continue;
    found.lines.push_back({fmt::format("{} as {}", printed.method, row->method),
                           fmt::format("{} for {} points of the {}; the thesis: {} for {}, on {}",
                                       duration_text(row->made->made.total_ms), count_text(row->points),
                                       row->model, printed.time, printed.model, printed.machine)});
  }
  if (!found.lines.empty()) r.page.headlines.push_back(std::move(found));
}

void write_results(const Manifest& manifest, const std::vector<Row>& rows, Reproduction& r) {
  metrics::ResultDocument document = new_document(r.context.command_line);
  for (const Row& row : rows) document.renderers.push_back(as_result(row, r.arguments.threads));
  const Result<OutputFolder> folder = r.folder.inside(fmt::format("table{}", manifest.table));
  Status written = folder ? folder->write("result.json", metrics::to_json(document)) : Status(folder.error());
  if (written) written = folder->write("meshes.json", to_json(rows).dump(2) + "\n");
  if (!written) give_up(r, fmt::format("the results of table {}", manifest.table), written.error());
}

}  // namespace

void reproduce_meshes(const Manifest& manifest, Reproduction& r) {
  std::optional<baselines::MeshCache> cache = baselines::MeshCache::standard();
  std::vector<Row> rows;
  std::vector<Table> tables;
  for (const ManifestModel& model : manifest.models) {
    const Result<scene::SceneFile> scene = scene_of(model, r);
    const Result<scene::LoadedScene> loaded = scene ? scene::load(*scene, r.readers, {}, r.context.progress)
                                                    : Result<scene::LoadedScene>(scene.error());
    if (!loaded) {
      give_up(r, fmt::format("table {}, {}", manifest.table, model.name), loaded.error());
      continue;
    }
    const cloud::Cloud& whole = *loaded->input.models.front().cloud;
    const bool thin = !r.arguments.full && model.points_in_time > 0 && model.points_in_time < whole.size();
    std::vector<Row> some =
        run_all(model, thin ? thinned(whole, model.points_in_time) : whole, cache ? &*cache : nullptr, r);
    tables.push_back(model_table(model, some));
    if (thin)
      tables.back().notes.push_back(fmt::format("{} of the {}'s {} points, at random; --full takes all.",
                                                count_text(model.points_in_time), model.name,
                                                count_text(whole.size())));
    std::move(some.begin(), some.end(), std::back_inserter(rows));
    if (r.context.progress.cancelled()) return;
  }
  write_results(manifest, rows, r);
  tables.insert(tables.begin(), printed_table(manifest, rows));
  add_headlines(manifest, rows, r);
  Section section{fmt::format("table{}", manifest.table), manifest.title, {}, tables, {}, {}};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  r.page.sections.push_back(std::move(section));
  std::move(tables.begin(), tables.end(), std::back_inserter(r.tables));
}

#endif

}  // namespace palpate::experiments
