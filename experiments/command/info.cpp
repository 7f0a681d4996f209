#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scans.h"
#include "experiments/live/recording_session.h"
#include "experiments/run/arguments.h"
#include "experiments/run/run.h"
#include "experiments/session/session.h"
#include "experiments/streams/open_stream.h"
#include "toolkit/cloud/height_field.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/neighbour_table.h"
#include "toolkit/spline_sdf/surface_file.h"

namespace palpate::experiments {
namespace {

struct Info {
  const render::ModelInput& model;
  const scene::Provenance& provenance;
  cloud::Statistics statistics;
  cloud::HeightFieldSummary lattice;
  search::Spacing spacing;
  std::string neighbours;  ///< which neighbours the resolution is about
  std::vector<std::string> warnings;
};

Info describe(const render::ModelInput& model, const scene::Provenance& provenance, int threads,
              Progress& progress) {
  Info info{model, provenance, {}, {}, {}, {}, provenance.warnings};
  progress.report("counting", -1.0);
  info.statistics = cloud::describe(*model.cloud);
  info.lattice = cloud::summarise_height_field(*model.cloud);
  progress.report("finding neighbours", -1.0);
  const bool raster = model.cloud->raster.has_value();
  Result<search::NeighbourTable> table =
      raster ? search::scanner_path(*model.cloud, threads) : search::exact_knn(*model.cloud, threads);
  if (!table) table = search::exact_knn(*model.cloud, threads);
  info.neighbours = raster ? "the scanner's path" : "the eight nearest points";
  info.spacing = search::describe_spacing(*model.cloud, *table);
  if (info.spacing.eighth_mm.p50 > kHighResolutionMm)
    info.warnings.push_back(
        fmt::format("half of the points have an eighth neighbour that is {:.3g} mm away or farther: no finer "
                    "shape can be felt; if the object is not that large, give --unit or --scale",
                    info.spacing.eighth_mm.p50));
  if (info.statistics.duplicates > 0)
    info.warnings.push_back(
        fmt::format("{} points stand where another one stands", info.statistics.duplicates));
  return info;
}

nlohmann::ordered_json percentiles(const search::Percentiles& p) {
  return {{"min", p.min}, {"p50", p.p50}, {"p99", p.p99}, {"p999", p.p999}, {"max", p.max}};
}

nlohmann::ordered_json to_json(const Info& info) {
  const cloud::Statistics& s = info.statistics;
  const auto vector = [](const Vec3& v) { return nlohmann::ordered_json{v.x(), v.y(), v.z()}; };
  nlohmann::ordered_json j = {
      {"name", info.model.name},
      {"source", info.provenance.source},
      {"format", info.provenance.format},
      {"content_hash", info.provenance.content_hash},
      {"unit", io::unit_name(info.provenance.unit)},
      {"unit_guessed", info.provenance.unit_guessed},
      {"points", s.points},
      {"file_points", info.provenance.file_points},
      {"non_finite", info.provenance.non_finite},
      {"outside", info.provenance.outside},
      {"duplicates", s.duplicates},
      {"box_mm",
       {{"low", vector(s.box_mm.low_mm)},
        {"high", vector(s.box_mm.high_mm)},
        {"extent", vector(s.box_mm.extent_mm())}}},
      {"resolution_mm", info.spacing.resolution_mm},
      {"resolution_over", info.neighbours},
      {"plan_resolution_mm", info.spacing.plan_resolution_mm},
      {"density_per_mm3", s.density_per_mm3},
      {"nearest_mm", percentiles(info.spacing.nearest_mm)},
      {"eighth_mm", percentiles(info.spacing.eighth_mm)},
      {"median_index_distance", info.spacing.median_index_distance},
      {"height_field", info.lattice.is},
      {"height_field_words", info.lattice.words},
      {"single_valued", s.single_valued},
      {"triangles", info.model.original_mesh ? info.model.original_mesh->triangles.size() : 0},
      {"formula", info.model.analytic ? nlohmann::ordered_json(info.model.analytic->formula())
                                      : nlohmann::ordered_json(nullptr)},
      {"cleaned", info.provenance.cleaned},
      {"warnings", info.warnings}};
  j["raster"] =
      s.raster ? nlohmann::ordered_json{{"columns", s.raster->columns},
                                        {"rows", s.raster->rows},
                                        {"to_and_fro", s.raster->order == cloud::ScanOrder::kBoustrophedon},
                                        {"columns_wrap", s.raster->columns_wrap},
                                        {"rows_wrap", s.raster->rows_wrap}}
               : nlohmann::ordered_json(nullptr);
  const cloud::Holes& holes = info.lattice.holes;
  j["lattice"] = info.lattice.is ? nlohmann::ordered_json{{"columns", info.lattice.columns},
                                                          {"rows", info.lattice.rows},
                                                          {"missing", holes.missing},
                                                          {"filled", holes.gaps},
                                                          {"open", holes.voids},
                                                          {"outside", holes.outside},
                                                          {"widest_hole", holes.widest}}
                                 : nlohmann::ordered_json(nullptr);
  if (info.model.prepared != nullptr) {
    j["prepared"] = {{"points", info.model.prepared->points()},
                     {"bytes", info.model.prepared->bytes()},
                     {"surfaces", nlohmann::ordered_json::array()}};
    for (const spline_sdf::StoredSurface& stored : info.model.prepared->surfaces())
      j["prepared"]["surfaces"].push_back({{"tiles", stored.keys.size()},
                                           {"bytes", stored.tile_bytes},
                                           {"spacing_mm", stored.surface.spacing_mm},
                                           {"noise_mm", stored.surface.noise_mm},
                                           {"rms_mm", stored.rms_mm}});
  }
  // JSON has no infinity: a flat box has no volume to be dense in.
  if (!std::isfinite(s.density_per_mm3)) j["density_per_mm3"] = nullptr;
  return j;
}

std::string order_text(const std::optional<cloud::ScanRaster>& raster, const cloud::Cloud& points) {
  if (!raster) {
    const Result<search::ScanTable> table = search::scan_table_of(points);
    if (!table) return "none found in the order of the points";
    std::uint32_t rows = 0, columns = 0;
    for (const search::ScanPosition& at : table->of) {
      rows = std::max(rows, at.row + 1);
      columns = std::max(columns, at.column + 1);
    }
    return fmt::format("yes, with holes: {} rows of up to {}", rows, columns);
  }
  const bool fro = raster->order == cloud::ScanOrder::kBoustrophedon;
  const char* const round = raster->columns_wrap && raster->rows_wrap ? ", both ways round"
                            : raster->columns_wrap                    ? ", columns round"
                            : raster->rows_wrap                       ? ", rows round"
                                                                      : "";
  return fmt::format("yes, {} rows of {}{}{}", raster->rows, raster->columns, fro ? ", to and fro" : "",
                     round);
}

/// Significant digits that show corners to as fine a part of the box wherever it stands.
int corner_digits(const geometry::Aabb& box) {
  constexpr int kNearOrigin = 6, kAllOfDouble = 17;
  const double extent = box.extent_mm().maxCoeff();
  const double farthest = std::max(box.low_mm.cwiseAbs().maxCoeff(), box.high_mm.cwiseAbs().maxCoeff());
  if (!(extent > 0.0)) return farthest > 0.0 ? kAllOfDouble : kNearOrigin;
  const double beyond = std::max(0.0, std::ceil(std::log10(farthest / extent)));
  return std::min(kAllOfDouble, kNearOrigin + static_cast<int>(beyond));
}

void print_surfaces(const spline_sdf::SurfaceFile& file) {
  fmt::print("  prepared from      {} points, {:.3g} MB\n", file.points(),
             static_cast<double>(file.bytes()) * 1e-6);
  for (std::size_t level = 0; level < file.surfaces().size(); ++level) {
    const spline_sdf::StoredSurface& s = file.surfaces()[level];
    fmt::print(
        "  level {}            {} tiles, {:.3g} MB; spacing {:.4g} mm, noise {:.3g} mm; RMS of the sample "
        "{:.3g} mm\n",
        level, s.keys.size(), static_cast<double>(s.tile_bytes) * 1e-6, s.surface.spacing_mm,
        s.surface.noise_mm, s.rms_mm);
  }
}

void print_text(const Info& info) {
  const cloud::Statistics& s = info.statistics;
  const Vec3 low = s.box_mm.low_mm, high = s.box_mm.high_mm, extent = s.box_mm.extent_mm();
  const auto row = [](const char* key, const std::string& value) { fmt::print("  {:<18} {}\n", key, value); };
  const auto spread = [](const search::Percentiles& p) {
    return fmt::format(
        "smallest {:.4g}, median {:.4g}, 99 % below {:.4g}, 99.9 % below {:.4g}, largest {:.4g} mm", p.min,
        p.p50, p.p99, p.p999, p.max);
  };
  fmt::print("{}\n", info.model.name);
  row("source", info.provenance.source);
  row("format", info.provenance.format);
  row("unit", fmt::format("{}{}", io::unit_name(info.provenance.unit),
                          info.provenance.unit_guessed ? " (guessed)" : ""));
  if (info.model.analytic) row("formula", info.model.analytic->formula());
  row("points", fmt::format("{}", s.points));
  row("left out", fmt::format("{} with NaN, infinite or missing coordinates", info.provenance.non_finite));
  for (const std::string& step : info.provenance.cleaned) row("cleaned", step);
  row("duplicates", fmt::format("{} at the position of another point", s.duplicates));
  const int digits = corner_digits(s.box_mm);
  row("box",
      fmt::format("({:.{}g}, {:.{}g}, {:.{}g}) to ({:.{}g}, {:.{}g}, {:.{}g}) mm", low.x(), digits, low.y(),
                  digits, low.z(), digits, high.x(), digits, high.y(), digits, high.z(), digits));
  if (const geometry::RigidTransform& pose = info.model.world_from_model; !pose.is_identity())
    row("pose", fmt::format("the scene {}moves it by ({:.9g}, {:.9g}, {:.9g}) mm; the box is before that",
                            pose.rotation.vec() == Vec3::Zero() ? "" : "turns it and ",
                            pose.translation_mm.x(), pose.translation_mm.y(), pose.translation_mm.z()));
  if (info.model.motion != nullptr)
    row("motion", "the model moves; everything here is of its points at rest");
  row("extent", fmt::format("{:.4g} x {:.4g} x {:.4g} mm", extent.x(), extent.y(), extent.z()));
  row("resolution", fmt::format("{:.4g} mm, the largest distance between neighbours: {}",
                                info.spacing.resolution_mm, info.neighbours));
  if (s.single_valued)
    row("plan resolution",
        fmt::format("{:.4g} mm, the same seen from above", info.spacing.plan_resolution_mm));
  row("density", std::isfinite(s.density_per_mm3)
                     ? fmt::format("{:.4g} points per mm3 of the box", s.density_per_mm3)
                     : std::string("none: the box is flat"));
  row("nearest point", spread(info.spacing.nearest_mm));
  row("eighth nearest", spread(info.spacing.eighth_mm));
  row("rows of a scanner", order_text(s.raster, *info.model.cloud));
  row("order", fmt::format("the nearest point is mostly {:.4g} lines away in the file (1: as a scanner goes)",
                           info.spacing.median_index_distance));
  row("height field", info.lattice.is   ? "yes, on " + info.lattice.words
                      : s.single_valued ? info.lattice.words + "; seen from above it does not overlap itself"
                                        : info.lattice.words);
  row("mesh", info.model.original_mesh
                  ? fmt::format("{} triangles", info.model.original_mesh->triangles.size())
                  : std::string("none: only points"));
  row("content hash", info.provenance.content_hash);
  if (info.model.prepared != nullptr) print_surfaces(*info.model.prepared);
  for (const std::string& warning : info.warnings) fmt::print("  warning: {}\n", warning);
}

struct InfoArguments {
  std::string model;
  ModelArguments load;
  bool skip_damaged = false, json = false;
};

void declare_info(const Declaration& declare, InfoArguments& a) {
  declare.required("MODEL", a.model,
                   std::string(kSceneHelp) + "; a recording (.palrec); or a stream of depth images");
  declare_json(declare, a.json);
  declare.flag("--skip-damaged", a.skip_damaged, "recordings: leave out damaged parts in the middle");
  declare_model(declare, a.load);
}

/// The first option given that says how models are read; empty: none.
std::string given_for_models(const ModelArguments& load) {
  if (std::string given = given_for_model_files(load); !given.empty()) return given;
  return load.memory_limit_gb > 0.0 ? "--memory-limit-gb" : load.threads > 0 ? "--threads" : "";
}

Result<int> run_info_recording(const InfoArguments& arguments, Context& context) {
  if (const std::string given = given_for_models(arguments.load); !given.empty())
    return Error{fmt::format("{} does nothing: this is a recording, and no model", given), "leave it out",
                 arguments.model};
  context.progress.report("reading the recording", -1.0);
  PALPATE_ASSIGN(const RecordingFacts facts, facts_of_recording(arguments.model, arguments.skip_damaged));
  context.progress.clear();
  fmt::print("{}", arguments.json ? facts_json(facts) + "\n" : facts_text(facts));
  return kExitOk;
}

Result<int> run_info_stream(const InfoArguments& arguments, Context& context) {
  if (const std::string given = given_for_models(arguments.load); !given.empty() || arguments.skip_damaged)
    return Error{fmt::format("{} does nothing: this is a stream, and no model",
                             given.empty() ? "--skip-damaged" : given),
                 "leave it out", arguments.model};
  const io::Readers readers = all_readers();
  PALPATE_ASSIGN(const StreamFacts facts, facts_of_stream(arguments.model, readers, context.progress));
  context.progress.clear();
  fmt::print("{}", arguments.json ? to_json(facts) + "\n" : to_text(facts));
  return kExitOk;
}

Result<int> run_info(const InfoArguments& arguments, Context& context) {
  if (is_stream_name(arguments.model)) return run_info_stream(arguments, context);
  if (is_recorded_session(arguments.model)) return run_info_recording(arguments, context);
  if (arguments.skip_damaged)
    return Error{"--skip-damaged does nothing: this is a model, and no recording", "leave it out",
                 arguments.model};
  PALPATE_ASSIGN(const scene::LoadOptions options, load_options(arguments.load));
  PALPATE_ASSIGN(const scene::SceneFile file, open_scene(arguments.model, all_renderers(), context.progress));
  PALPATE_ASSIGN(const scene::LoadedScene loaded,
                 scene::load(file, all_readers(), options, context.progress));
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < loaded.input.models.size(); ++i) {
    const Info info =
        describe(loaded.input.models[i], loaded.provenance[i], arguments.load.threads, context.progress);
    context.progress.clear();
    if (arguments.json)
      list.push_back(to_json(info));
    else
      print_text(info);
  }
  for (const std::string& warning : warnings_about_models(loaded)) tell("palpate: warning: {}\n", warning);
  if (arguments.json) fmt::print("{}\n", (list.size() == 1 ? list.front() : list).dump(2));
  return kExitOk;
}

}  // namespace

Subcommand info_subcommand() {
  return subcommand("info",
                    "what a model holds: points, box, resolution, density, spacing, defects; a recording: "
                    "length, renderers, device, faults; a stream of depth images: rate, holes, noise",
                    {"palpate info scan.ply --unit m", "palpate info session.palrec",
                     "palpate info sim:table:width=160:height=120", "palpate info stanford-bunny",
                     "palpate info sinusoid:points=1002001 --json"},
                    declare_info, run_info);
}

}  // namespace palpate::experiments
