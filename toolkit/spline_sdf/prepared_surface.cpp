#include "toolkit/spline_sdf/prepared_surface.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "toolkit/cloud/statistics.h"
#include "toolkit/render/prepare.h"
#include "toolkit/spline_sdf/morton_points.h"

namespace palpate::spline_sdf {

using namespace render;

namespace {

/// The coarsest surface is whole in memory: its bricks take less than this.
constexpr std::size_t kSmallSurfaceBytes = std::size_t{16} << 20;
/// Points without which there is no coarser surface worth feeling.
constexpr std::size_t kLeastPoints = 2000;
/// Name of the renderer's levels in messages.
constexpr const char* kSurfaceList = "`palpate info FILE` lists its surfaces";

Status check_prepared(const ModelInput& input, std::size_t level) {
  const SurfaceFile& file = *input.prepared;
  if (level >= file.surfaces().size())
    return Error{fmt::format("level {} is not in the prepared file, which has {} surfaces", level,
                             file.surfaces().size()),
                 kSurfaceList, file.path()};
  if (input.surface.per_point != nullptr)
    return Error{"a prepared file has no values by point", "feel the scan itself, or leave them out",
                 file.path()};
  return Done{};
}

}  // namespace

std::shared_ptr<const cloud::Cloud> thinned(const MortonPoints& points, const cloud::Cloud& cloud,
                                            std::size_t count) {
  std::vector<std::uint32_t> kept;
  const std::size_t step = std::max<std::size_t>(points.size() / std::max<std::size_t>(count, 1), 1);
  for (std::size_t i = step / 2; i < points.size(); i += step) kept.push_back(points.index(i));
  std::sort(kept.begin(), kept.end());
  auto out = std::make_shared<cloud::Cloud>();
  out->origin_mm = cloud.origin_mm;
  for (const std::uint32_t i : kept) {
    out->x_mm.push_back(cloud.x_mm[i]);
    out->y_mm.push_back(cloud.y_mm[i]);
    out->z_mm.push_back(cloud.z_mm[i]);
  }
  return out;
}

Status add_coarser_surfaces(const cloud::Cloud& cloud, const MortonPoints& points, std::size_t count,
                            const SplineSdfOptions& build, const PrepareContext& context,
                            SurfaceFileWriter& writer) {
  for (;; count /= kCoarserShare) {
    count = std::max(count, std::min(points.size(), kLeastPoints));
    PrepareReport unread;
    PALPATE_ASSIGN(const std::shared_ptr<const SplineSdf> coarse,
                   build_spline_sdf(*thinned(points, cloud, count), build, context, unread));
    PALPATE_TRY(writer.add(*coarse, context.threads));
    if (coarse->grid.bytes() <= kSmallSurfaceBytes || count <= kLeastPoints) return Done{};
  }
}

Status prepare_surface_file(const std::shared_ptr<const cloud::Cloud>& cloud, const SplineSdfOptions& build,
                            const PrepareContext& context, PrepareReport& report, const std::string& path) {
  PALPATE_ASSIGN(std::shared_ptr<const SplineSdf> surface, build_spline_sdf(*cloud, build, context, report));
  if (surface->grid.bricks.empty()) return no_surface();
  const MortonPoints points(*cloud, context.threads);
  PALPATE_ASSIGN(SurfaceFileWriter writer,
                 SurfaceFileWriter::create(path, cloud->size(), thinned(points, *cloud, kSamplePoints)));
  PreparePhases phases(report, context);
  phases.begin("write");
  PALPATE_TRY(writer.add(*surface, context.threads));
  surface.reset();
  phases.end();
  phases.begin("coarser surfaces");
  PALPATE_TRY(add_coarser_surfaces(*cloud, points, points.size() / kCoarserShare, build, context, writer));
  phases.end();
  return writer.finish();
}

Error no_surface() {
  return {"the points make no surface, so there is nothing to prepare", "check the file and its unit"};
}

Result<SplineSdfDecision> decide_prepared(const ModelInput& input, std::size_t level) {
  PALPATE_TRY(check_prepared(input, level));
  PALPATE_ASSIGN(const SurfaceDecision surface, decide_surface(input));
  const SplineSdf& stored = input.prepared->surfaces()[level].surface;
  return SplineSdfDecision{stored.spacing_mm, stored.noise_mm, stored.grid.voxel_mm, stored.cubes, surface};
}

Result<SplineSdfBody> open_prepared_body(const ModelInput& input, const PagedOptions& options,
                                         PrepareReport& report, std::unique_ptr<PagedContact>& paged) {
  const std::shared_ptr<const SurfaceFile>& file = input.prepared;
  PALPATE_TRY(check_prepared(input, options.level));
  SplineSdfBody body;
  PALPATE_ASSIGN(body.surface, build_surface_field(input, {}, report));
  PALPATE_ASSIGN(std::unique_ptr<PagedSurface> fine,
                 PagedSurface::start(file, options.level, options.resident_bytes));
  PALPATE_ASSIGN(std::shared_ptr<const SplineSdf> coarse, file->load(file->surfaces().size() - 1));
  const StoredSurface& stored = fine->stored();
  body.smooth = std::make_shared<const SplineSdf>(stored.surface);
  body.pose = ModelPose(input, input.cloud->origin_mm);
  report.bytes += fine->bytes() + coarse->grid.bytes();
  report.notes.push_back(
      fmt::format("prepared surface: {} tiles, {:.3g} MB on disk, at most {:.3g} MB of them in memory; where "
                  "one is late a surface "
                  "of {:.3g} mm RMS error answers",
                  stored.keys.size(), static_cast<double>(stored.tile_bytes) * 1e-6,
                  static_cast<double>(fine->bytes()) * 1e-6, file->surfaces().back().rms_mm));
  if (options.paced && !fine->locked())
    report.warnings.emplace_back(
        "The prepared surface's memory could not be locked, so a frame may wait for a page that was swapped "
        "out: "
        "`palpate list devices --doctor` says how to raise the limit.");
  paged =
      std::make_unique<PagedContact>(std::move(fine), std::move(coarse), !options.paced, options.most_steps);
  return body;
}

}  // namespace palpate::spline_sdf
