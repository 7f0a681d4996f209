#include "baselines/renderers/mesh_refine.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "baselines/mesh/refine.h"
#include "baselines/proximity/mesh_gap.h"
#include "toolkit/core/try.h"

namespace palpate::baselines {
namespace {

using MeshPointer = std::shared_ptr<const geometry::TriangleMesh>;

/// Places that a distance is sampled at: a maximum over so many misses one part in a hundred thousand.
constexpr std::size_t kSamples = 100'000;

struct Probed {
  SurfaceMesh mesh;
  std::unique_ptr<SegmentIndex> index;
};

Result<std::unique_ptr<Probed>> probed(const geometry::TriangleMesh& source, int threads) {
  auto made = std::make_unique<Probed>();
  auto mesh = SurfaceMesh::build(source, threads);
  if (!mesh.ok()) return std::move(mesh).error();
  made->mesh = std::move(mesh).value();
  auto index = SegmentIndex::build(made->mesh, threads);
  if (!index.ok()) return std::move(index).error();
  made->index = std::make_unique<SegmentIndex>(std::move(index).value());
  return made;
}

std::vector<Vec3> sampled_points(const cloud::Cloud& cloud) {
  std::vector<Vec3> places;
  const std::size_t stride = cloud.size() / kSamples + 1;
  for (std::size_t i = 0; i < cloud.size(); i += stride) places.push_back(cloud.point_mm(i));
  return places;
}

/// How far `now` is from the points, and from the mesh that it was made of.
Status measure(const geometry::TriangleMesh& before, const geometry::TriangleMesh& now,
               const cloud::Cloud& cloud, int threads, render::PreparePhases& phases) {
  const auto old_one = probed(before, threads);
  if (!old_one.ok()) return old_one.error();
  const auto new_one = probed(now, threads);
  if (!new_one.ok()) return new_one.error();
  const auto gap = [&](const Probed& to, const std::vector<Vec3>& from) {
    return gap_to(to.mesh, *to.index, from, threads);
  };
  const MeshGap points = gap(**new_one, sampled_points(cloud));
  const MeshGap there = gap(**new_one, places_on(before, kSamples)),
                back = gap(**old_one, places_on(now, kSamples));
  phases.note(
      fmt::format("refined: {} facets of {}; points off by {:.4g} mm RMS, {:.4g} mm at most; from the "
                  "mesh before {:.4g} mm RMS, {:.4g} mm at most (Hausdorff, {} samples each way)",
                  now.triangles.size(), before.triangles.size(), points.rms_mm, points.max_mm,
                  std::max(there.rms_mm, back.rms_mm), std::max(there.max_mm, back.max_mm), kSamples));
  return Done{};
}

Status repair(MeshPointer& mesh, const Options& options, render::PreparePhases& phases) {
  phases.begin("repair (OpenMesh)");
  RepairReport found;
  auto made = repaired(*mesh, static_cast<std::size_t>(options.integer("repair_holes")), &found);
  if (!made.ok()) return std::move(made).error();
  mesh = std::make_shared<const geometry::TriangleMesh>(std::move(made).value());
  phases.end();
  phases.note(
      fmt::format("repair: {} vertices welded, {} collapsed facets dropped, {} facets turned, {} cut loose "
                  "where too many meet, {} holes filled with {} facets, {} boundary loops left",
                  found.welded, found.dropped, found.turned, found.cut, found.filled_holes,
                  found.filled_facets, found.left_loops));
  return Done{};
}

}  // namespace

std::vector<OptionSpec> mesh_refine_specs() {
  return {
      {"repair",
       OptionKind::kFlag,
       "false",
       "orient the mesh, cut it where more than two facets meet, fill its small holes",
       {}},
      {"repair_holes",
       OptionKind::kInteger,
       "100",
       "edges of the largest hole that is filled",
       {},
       0.0,
       500.0,
       {{"repair", {"true"}}}},
      {"smooth", OptionKind::kInteger, "0", "rounds of Laplace smoothing of second order", {}, 0.0, 10'000.0},
      {"decimate",
       OptionKind::kNumber,
       "1",
       "share of the facets to keep, by quadric error; 1: all",
       {},
       1e-6,
       1.0}};
}

Result<MeshPointer> refined(MeshPointer source, const render::ModelInput& input, const Options& options,
                            int threads, render::PreparePhases& phases) {
  MeshPointer mesh = source;
  if (options.flag("repair")) PALPATE_TRY(repair(mesh, options, phases));
  if (const long long rounds = options.integer("smooth"); rounds > 0) {
    phases.begin("smooth (OpenMesh)");
    auto made = smoothed(*mesh, static_cast<int>(rounds));
    if (!made.ok()) return std::move(made).error();
    mesh = std::make_shared<const geometry::TriangleMesh>(std::move(made).value());
    phases.end();
  }
  if (const double share = options.number("decimate"); share < 1.0) {
    phases.begin("decimate (OpenMesh)");
    auto made = decimated(*mesh, share);
    if (!made.ok()) return std::move(made).error();
    if (made->empty()) return Error{"nothing is left of the mesh", "keep a larger share: decimate", {}, 0};
    mesh = std::make_shared<const geometry::TriangleMesh>(std::move(made).value());
    phases.end();
  }
  if (mesh == source) return mesh;
  phases.begin("measure the refined mesh");
  PALPATE_TRY(measure(*source, *mesh, *input.cloud, threads, phases));
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
