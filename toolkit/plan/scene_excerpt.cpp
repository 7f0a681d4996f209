#include "toolkit/plan/plan.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#include <palpate/geometry.h>
#include "toolkit/render/prepare.h"

namespace palpate::plan {
namespace {

/// Margin around the felt points in spacings: holds rings of neighbours and their borders.
constexpr double kMarginSpacings = 8.0;
/// Fewer points are nearly all border: the margin grows.
constexpr std::size_t kFewestPoints = 1024;
/// More take too long for a plan.
constexpr std::size_t kMaxPoints = 2 * kMaxWholePoints;
/// Stride of HIP places that form the tube: at most a few spacings.
constexpr std::size_t kTubeStride = 8;
/// 2^6 times the margin holds any model, and an eighth of a window still has contact frames.
constexpr int kMaxGrowths = 6, kMaxHalvings = 3;
constexpr std::size_t kWindowFrames = 900;

geometry::Aabb box_around(const std::vector<Vec3>& hips, double margin_mm, bool heights) {
  geometry::Aabb box;
  for (const Vec3& hip : hips) box.add(hip);
  Vec3 margin = Vec3::Constant(margin_mm);
  if (heights) margin.z() = std::numeric_limits<double>::infinity();
  return {box.low_mm - margin, box.high_mm + margin};
}

std::vector<std::uint32_t> inside(const cloud::Cloud& cloud, const geometry::Aabb& box) {
  std::vector<std::uint32_t> of;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    if (box.contains(cloud.local_mm(i))) of.push_back(static_cast<std::uint32_t>(i));
  return of;
}

/// Those of `of` within `radius_mm` of the way.
std::vector<std::uint32_t> tube(const cloud::Cloud& cloud, const std::vector<std::uint32_t>& of,
                                const std::vector<Vec3>& hips, double radius_mm) {
  double gap = 0.0;
  for (std::size_t k = kTubeStride; k < hips.size(); k += kTubeStride)
    gap = std::max(gap, (hips[k] - hips[k - kTubeStride]).norm());
  const double square = (radius_mm + 0.5 * gap) * (radius_mm + 0.5 * gap);
  std::vector<std::uint32_t> kept;
  for (const std::uint32_t i : of) {
    const Vec3 at = cloud.local_mm(i);
    for (std::size_t k = 0; k < hips.size(); k += kTubeStride)
      if ((hips[k] - at).squaredNorm() <= square) {
        kept.push_back(i);
        break;
      }
  }
  return kept;
}

/// The rectangle of a raster that holds these points; nothing if too large.
struct Rectangle {
  std::vector<std::uint32_t> of;
  cloud::ScanRaster raster;
};
Rectangle rectangle_around(const cloud::ScanRaster& raster, const std::vector<std::uint32_t>& of) {
  Rectangle out;
  if (of.empty()) return out;
  std::size_t row0 = raster.rows, row1 = 0, column0 = raster.columns, column1 = 0;
  for (const std::uint32_t i : of) {
    const std::size_t row = i / raster.columns, column = raster.column(i);
    row0 = std::min(row0, row);
    row1 = std::max(row1, row);
    column0 = std::min(column0, column);
    column1 = std::max(column1, column);
  }
  const std::size_t rows = row1 - row0 + 1, columns = column1 - column0 + 1;
  if (rows * columns > kMaxPoints) return out;
  out.raster.rows = static_cast<std::uint32_t>(rows);
  out.raster.columns = static_cast<std::uint32_t>(columns);
  for (std::size_t row = row0; row <= row1; ++row)
    for (std::size_t column = column0; column <= column1; ++column)
      out.of.push_back(static_cast<std::uint32_t>(raster.index(row, column)));
  return out;
}

/// A part of a model, alone and at rest, with its surface.
render::SceneInput part_of(const render::SceneInput& scene, const render::ModelInput& whole,
                           const std::vector<std::uint32_t>& of,
                           const std::optional<cloud::ScanRaster>& raster) {
  render::ModelInput part = render::subset_of(whole, of, raster);
  render::ModelInput model;
  model.name = whole.name;
  model.surface = std::move(part.surface);
  model.cloud = std::move(part.cloud);
  render::SceneInput out;
  out.force_limit_n = scene.force_limit_n;
  out.models.push_back(std::move(model));
  return out;
}

trace::ProbePath part_of(const trace::ProbePath& path, std::size_t begin, std::size_t end) {
  trace::ProbePath out;
  out.name = path.name;
  const auto from = static_cast<std::ptrdiff_t>(begin), to = static_cast<std::ptrdiff_t>(end);
  out.t_s.assign(path.t_s.begin() + from, path.t_s.begin() + to);
  out.hip_mm.assign(path.hip_mm.begin() + from, path.hip_mm.begin() + to);
  return out;
}

/// Points that the way can feel.
std::vector<std::uint32_t> felt_by(const cloud::Cloud& cloud, const std::vector<Vec3>& hips,
                                   const FeltReach& reach) {
  double margin = std::max(kMarginSpacings * reach.spacing_mm, 0.5 * reach.felt_mm);
  std::vector<std::uint32_t> of;
  for (int growth = 0; growth < kMaxGrowths; ++growth, margin *= 2.0) {
    of = inside(cloud, box_around(hips, reach.felt_mm + margin, reach.heights));
    if (of.size() >= std::min(kFewestPoints, cloud.size())) break;
  }
  if (of.size() <= kMaxPoints || reach.heights) return of;
  return tube(cloud, of, hips, reach.felt_mm + margin);
}

}  // namespace

SceneExcerpt extract_excerpt(const render::SceneInput& scene, const render::ModelInput& model,
                             const trace::ProbePath& path, std::size_t begin, std::size_t end,
                             const FeltReach& reach) {
  const cloud::Cloud& cloud = *model.cloud;
  if (cloud.size() <= kMaxWholePoints) {
    std::vector<std::uint32_t> all(cloud.size());
    std::iota(all.begin(), all.end(), 0u);
    return {part_of(scene, model, all, cloud.raster), part_of(path, begin, end)};
  }
  std::vector<std::uint32_t> of;
  for (int halving = 0; halving <= kMaxHalvings; ++halving) {
    std::vector<Vec3> hips;
    for (std::size_t k = begin; k < end; ++k) hips.push_back(path.hip_mm[k] - cloud.origin_mm);
    of = felt_by(cloud, hips, reach);
    if (cloud.raster) {
      Rectangle rectangle = rectangle_around(*cloud.raster, of);
      if (!rectangle.of.empty())
        return {part_of(scene, model, rectangle.of, rectangle.raster), part_of(path, begin, end)};
    }
    if (of.size() <= kMaxPoints) break;
    end = begin + std::max<std::size_t>(1, (end - begin) / 2);
  }
  return {part_of(scene, model, of, std::nullopt), part_of(path, begin, end)};
}

std::vector<Window> choose_windows(std::size_t frames, std::size_t period_frames, std::size_t count) {
  const std::size_t period = period_frames > 0 ? period_frames : kWindowFrames;
  const std::size_t length = period * std::max<std::size_t>(1, kWindowFrames / period);
  const std::size_t fitting = frames / length;
  if (fitting <= 1 || count <= 1) return {{0, frames}};
  std::vector<Window> windows;
  const std::size_t taken = std::min(count, fitting);
  for (std::size_t k = 0; k < taken; ++k) {
    const std::size_t at = (2 * k + 1) * fitting / (2 * taken);
    windows.push_back({at * length, (at + 1) * length});
  }
  return windows;
}

}  // namespace palpate::plan
