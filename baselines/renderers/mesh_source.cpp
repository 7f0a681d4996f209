#include "baselines/renderers/mesh_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include <palpate/result.h>
#include "baselines/mesh/mesh_repair.h"
#include "baselines/option_specs.h"
#include "baselines/proximity/segment_index.h"
#include "baselines/reconstruct/reconstruct.h"
#include "baselines/renderers/depth_rebuild.h"
#include "baselines/renderers/mesh_body.h"

namespace palpate::baselines {
namespace {

std::atomic<std::uint64_t> recorded_meshes{0};

constexpr double kBytesPerGb = 1e9;
constexpr const char* kAuto = "auto";
constexpr const char* kOriginal = "original";
/// Of streams.
constexpr const char* kImage = "depth image";
/// Used by `auto` if the model has no faces: the fastest method that goes through every point.
constexpr const char* kMadeByDefault = "advancing-front";

bool has_faces(const render::ModelInput& input) {
  return input.original_mesh != nullptr && !input.original_mesh->empty();
}

/// A surface through its points has about two facets for each (Euler).
constexpr double kFacetsPerPoint = 2.0;
/// Advancing front of 1,002,001 points, without the mesh renderer's own work (table 7 of reproduce).
constexpr double kMadeMsPerMillion = 35'000.0;

}  // namespace

std::vector<OptionSpec> mesh_source_specs(const std::string& usual) {
  OptionSpec mesh = option::choice(
      "mesh", usual,
      fmt::format(
          "which mesh: the file's own or a reconstruction; auto: the file's own where it has faces, else {}",
          kMadeByDefault),
      {kAuto, kOriginal});
  for (const Method& method : methods()) mesh.choices.push_back(method.name);
  const std::vector<OptionCondition> made = {{"mesh", {kOriginal}, true}};
  std::vector<OptionSpec> specs = {
      std::move(mesh),
      option::number("mesh_time_limit_s", "120", "a reconstruction may take so long; 0: no limit", 0.0, 1e9,
                     made),
      option::number("mesh_memory_limit_gb", "0",
                     "a reconstruction may use so much memory; 0: three quarters of the machine's", 0.0, 1e6,
                     made),
      option::flag("mesh_cache", "true", "take a reconstruction from the cache, and keep it there", made)};
  for (OptionSpec& spec : all_method_options("mesh")) specs.push_back(std::move(spec));
  return specs;
}

Result<MeshSource> decide_mesh(const render::ModelInput& input, const Options& options) {
  const std::string& asked = options.text("mesh");
  MeshSource source;
  if (input.camera != nullptr) {
    if (asked != kAuto)
      return Error{fmt::format("the mesh of a stream is made of its images, not by {}", asked),
                   "leave out the option mesh"};
    source.name = kImage;
    source.facets = kFacetsPerPoint * static_cast<double>(input.camera->pixels());
    source.explanation = {"mesh", kImage, "two facets for each square of four pixels, made of every image",
                          true};
    return source;
  }
  source.name = asked != kAuto ? asked : has_faces(input) ? kOriginal : kMadeByDefault;
  source.made = source.name != kOriginal;
  if (!source.made && !has_faces(input))
    return Error{fmt::format("model '{}' brings no mesh of its own", input.name),
                 "take a reconstruction, for example mesh=advancing-front"};
  source.facets = source.made ? kFacetsPerPoint * static_cast<double>(input.cloud->size())
                              : static_cast<double>(input.original_mesh->triangles.size());
  std::string reason = "as given";
  if (asked == kAuto)
    reason = source.made
                 ? fmt::format("{}, since the model brings no faces of its own (auto)", source.name)
                 : fmt::format("the model's own {} faces (auto)", input.original_mesh->triangles.size());
  source.explanation = {"mesh", source.name, std::move(reason), asked != kAuto};
  return source;
}

std::optional<double> expected_ms(const MeshSource& source, std::uint64_t points) {
  if (!source.made) return 0.0;
  if (source.name != kMadeByDefault) return std::nullopt;
  return kMadeMsPerMillion * 1e-6 * static_cast<double>(points);
}

Result<std::shared_ptr<const geometry::TriangleMesh>> mesh_of(const render::ModelInput& input,
                                                              const MeshSource& source,
                                                              const Options& options, int threads,
                                                              render::PreparePhases& phases) {
  if (!source.explanation.given) phases.note(source.note());
  if (!source.made) return input.original_mesh;
  const std::string& name = source.name;
  PALPATE_ASSIGN(const Method* const method, find_method(name));
  std::optional<MeshCache> cache;
  if (options.flag("mesh_cache")) cache = MeshCache::standard();
  ReconstructRequest request;
  request.method = name;
  request.options = own_options(*method, options);
  request.limits.time_s = options.number("mesh_time_limit_s");
  request.limits.memory_bytes =
      static_cast<std::size_t>(options.number("mesh_memory_limit_gb") * kBytesPerGb);
  request.threads = threads;
  request.cache = cache ? &*cache : nullptr;
  PALPATE_ASSIGN(Reconstruction made, reconstruct(request, *input.cloud, phases.progress()));
  for (render::PreparePhase& phase : made.made.phases)
    phases.add({fmt::format("{}: {}", name, phase.name), phase.ms});
  for (std::string& note : made.made.notes) phases.note(std::move(note));
  if (made.recorded) {
    ++recorded_meshes;
    phases.note(fmt::format("{}: from the cache; its times are those of {}, on {} threads", name,
                            made.made_on, made.threads));
  }
  return std::make_shared<const geometry::TriangleMesh>(std::move(made.mesh));
}

std::uint64_t meshes_from_cache() noexcept {
  return recorded_meshes;
}

namespace {

using MeshPointer = std::shared_ptr<const geometry::TriangleMesh>;

/// Sample count of a distance: the maximum misses about one part in a hundred thousand.
constexpr std::size_t kSamples = 100'000;

struct Probed {
  SurfaceMesh mesh;
  std::unique_ptr<SegmentIndex> index;
};

Result<std::unique_ptr<Probed>> probed(const geometry::TriangleMesh& source, int threads) {
  auto made = std::make_unique<Probed>();
  PALPATE_ASSIGN(made->mesh, SurfaceMesh::build(source, threads));
  PALPATE_ASSIGN(auto index, SegmentIndex::build(made->mesh, threads));
  made->index = std::make_unique<SegmentIndex>(std::move(index));
  return made;
}

std::vector<Vec3> sampled_points(const cloud::Cloud& cloud) {
  std::vector<Vec3> places;
  const std::size_t stride = cloud.size() / kSamples + 1;
  for (std::size_t i = 0; i < cloud.size(); i += stride) places.push_back(cloud.point_mm(i));
  return places;
}

/// Distances of `now` from the points and from the mesh it was made of.
Status measure(const geometry::TriangleMesh& before, const geometry::TriangleMesh& now,
               const cloud::Cloud& cloud, int threads, render::PreparePhases& phases) {
  PALPATE_ASSIGN(const auto old_one, probed(before, threads));
  PALPATE_ASSIGN(const auto new_one, probed(now, threads));
  const auto gap = [&](const Probed& to, const std::vector<Vec3>& from) {
    return gap_to(to.mesh, *to.index, from, threads);
  };
  const MeshGap points = gap(*new_one, sampled_points(cloud));
  const MeshGap there = gap(*new_one, places_on(before, kSamples)),
                back = gap(*old_one, places_on(now, kSamples));
  phases.note(
      fmt::format("refined: {} facets of {}; points off by {:.4g} mm RMS, {:.4g} mm at most; from the mesh "
                  "before {:.4g} mm RMS, {:.4g} mm at most (Hausdorff, {} samples each way)",
                  now.triangles.size(), before.triangles.size(), points.rms_mm, points.max_mm,
                  std::max(there.rms_mm, back.rms_mm), std::max(there.max_mm, back.max_mm), kSamples));
  return Done{};
}

Status repair(MeshPointer& mesh, const Options& options, render::PreparePhases& phases) {
  phases.begin("repair (OpenMesh)");
  RepairReport found;
  PALPATE_ASSIGN(auto made,
                 repaired(*mesh, static_cast<std::size_t>(options.integer("repair_holes")), &found));
  mesh = std::make_shared<const geometry::TriangleMesh>(std::move(made));
  phases.end();
  phases.note(
      fmt::format("repair: {} vertices welded, {} collapsed facets dropped, {} facets turned, {} cut loose "
                  "where too many meet, {} holes filled with {} facets, {} boundary loops left",
                  found.welded, found.dropped, found.flipped, found.cut, found.filled_holes,
                  found.filled_facets, found.left_loops));
  return Done{};
}

}  // namespace

std::vector<OptionSpec> mesh_refine_specs() {
  return {
      option::flag("repair", "false",
                   "orient the mesh, cut it where more than two facets meet, fill its small holes"),
      option::integer("repair_holes", "100", "edges of the largest hole that is filled", 0.0, 500.0,
                      {{"repair", {"true"}}}),
      option::integer("smooth", "0", "rounds of Laplace smoothing of second order", 0.0, 10'000.0),
      option::number("decimate", "1", "share of the facets to keep, by quadric error; 1: all", 1e-6, 1.0)};
}

Result<MeshPointer> refined(MeshPointer source, const render::ModelInput& input, const Options& options,
                            int threads, render::PreparePhases& phases) {
  MeshPointer mesh = source;
  if (options.flag("repair")) PALPATE_TRY(repair(mesh, options, phases));
  if (const long long rounds = options.integer("smooth"); rounds > 0) {
    phases.begin("smooth (OpenMesh)");
    PALPATE_ASSIGN(auto made, smoothed(*mesh, static_cast<int>(rounds)));
    mesh = std::make_shared<const geometry::TriangleMesh>(std::move(made));
    phases.end();
  }
  if (const double share = options.number("decimate"); share < 1.0) {
    phases.begin("decimate (OpenMesh)");
    PALPATE_ASSIGN(auto made, decimated(*mesh, share));
    if (made.empty()) return Error{"nothing is left of the mesh", "keep a larger share: decimate"};
    mesh = std::make_shared<const geometry::TriangleMesh>(std::move(made));
    phases.end();
  }
  if (mesh == source) return mesh;
  phases.begin("measure the refined mesh");
  PALPATE_TRY(measure(*source, *mesh, *input.cloud, threads, phases));
  phases.end();
  return mesh;
}

RasterSheet sheet_of(const DepthPatch& patch) {
  const render::PixelWindow& window = patch.window;
  const stream::DepthCamera& camera = patch.rays.camera();
  const auto columns = static_cast<std::size_t>(window.columns());
  const auto rows = static_cast<std::size_t>(window.rows());
  RasterSheet sheet;
  sheet.columns = columns;
  sheet.at_mm.resize(columns * rows);
  sheet.measured.assign(columns * rows, 0);
  sheet.square.assign(columns * rows, 0);
  std::vector<double> depth(columns * rows);
  std::size_t i = 0;
  for (int row = window.first_row; row < window.last_row; ++row)
    for (int column = window.first_column; column < window.last_column; ++column, ++i) {
      const std::size_t pixel = patch.rays.index(column, row);
      depth[i] = patch.depth_mm(pixel);
      if (!(depth[i] > 0.0)) continue;
      sheet.measured[i] = 1;
      sheet.at_mm[i] = patch.at(pixel, depth[i]);
    }
  // On one sheet: both measured, with depths as near as slope and noise explain.
  const auto joined = [&](std::size_t a, std::size_t b, double focal_px) {
    const double nearer = std::min(depth[a], depth[b]);
    return nearer > 0.0 && std::abs(depth[a] - depth[b]) <=
                               kSteepest * nearer / focal_px + kExplainedSigmas * camera.noise_at_mm(nearer);
  };
  for (std::size_t row = 0; row + 1 < rows; ++row)
    for (std::size_t column = 0; column + 1 < columns; ++column) {
      const std::size_t a = row * columns + column, b = a + 1, d = a + columns, e = d + 1;
      sheet.square[a] = joined(a, b, camera.fx_px) && joined(d, e, camera.fx_px) &&
                                joined(a, d, camera.fy_px) && joined(b, e, camera.fy_px)
                            ? 1
                            : 0;
    }
  return sheet;
}

std::shared_ptr<const MeshGeometry> mesh_of_image(const DepthPatch& patch, const Vec3& origin_mm,
                                                  bool normals) {
  auto made = std::make_shared<MeshGeometry>();
  made->mesh = SurfaceMesh::of_raster(sheet_of(patch), origin_mm);
  if (made->mesh.facets().empty()) return nullptr;
  made->sides = PieceOrientation::open_sheet();
  if (normals) made->vertex_normals = interpolation_normals(made->mesh);
  Result<SegmentIndex> index = SegmentIndex::build(made->mesh, 1, TreeQuality::kFast);
  if (!index.ok()) return nullptr;
  made->index = std::make_unique<SegmentIndex>(std::move(index).value());
  return made;
}

}  // namespace palpate::baselines
