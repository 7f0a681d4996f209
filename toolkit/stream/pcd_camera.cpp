#include "toolkit/stream/pcd_camera.h"

#include <fmt/format.h>

#include <cmath>

#include <palpate/progress.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"

namespace palpate::stream {
namespace {

/// Off by more than this, as root mean square, the points are another camera's or were moved: PCL makes its
/// clouds from the pinhole itself, so that only rounding is left.
constexpr double kMaxRayErrorPx = 1.0;
constexpr const char* kOrganisedRemedy =
    "a sequence needs organised clouds in the camera's frame, as PCL's grabbers write them; or give the "
    "camera";

/// A straight line through pairs, by sums.
struct LineFit {
  double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0, yy = 0.0;
  void add(double at, double value) noexcept {
    n += 1.0;
    x += at;
    y += value;
    xx += at * at;
    xy += at * value;
    yy += value * value;
  }
  [[nodiscard]] double slope() const noexcept { return (n * xy - x * y) / (n * xx - x * x); }
  [[nodiscard]] double offset() const noexcept { return (y - slope() * x) / n; }
  [[nodiscard]] double rms() const noexcept {
    const double a = slope(), b = offset();
    return std::sqrt(std::max(0.0, (yy - a * xy - b * y) / n));
  }
};

}  // namespace

Result<OrganisedPoints> read_organised_pcd(const std::string& file, const io::Readers* readers) {
  const io::Reader* const reader = readers != nullptr ? readers->find(pcd::kPcdExtension) : nullptr;
  if (reader == nullptr)
    return Error{"PCD files cannot be read by this program", "build Palpate with PALPATE_WITH_PCD", file};
  PALPATE_ASSIGN(const std::unique_ptr<io::ByteSource> bytes, io::open_file(file));
  const io::ReadOptions options;
  Result<io::DecodedFile> decoded = (*reader)(io::ReaderInput{*bytes, file, options, no_progress()});
  if (!decoded) return std::move(decoded).error().in_file(file);
  if (!decoded->raster) return Error{"the cloud has no rows: its HEIGHT is 1", kOrganisedRemedy, file};
  OrganisedPoints points{decoded->raster->columns, decoded->raster->rows, std::move(decoded->points)};
  const double mm = io::mm_per(decoded->conventional_unit.value_or(io::Unit::kMetre));
  for (Vec3& p : points.points_mm) p *= mm;
  return points;
}

Result<DepthCamera> camera_of(const OrganisedPoints& points) {
  LineFit across, down;
  for (std::size_t i = 0; i < points.points_mm.size(); ++i) {
    const Vec3& p = points.points_mm[i];
    if (!is_finite(p) || !(p.z() > 0.0)) continue;
    across.add(p.x() / p.z(), static_cast<double>(i % points.width));
    down.add(p.y() / p.z(), static_cast<double>(i / points.width));
  }
  DepthCamera camera;
  camera.width = static_cast<int>(points.width);
  camera.height = static_cast<int>(points.height);
  camera.fx_px = across.slope();
  camera.fy_px = down.slope();
  camera.cx_px = across.offset();
  camera.cy_px = down.offset();
  const double error_px = std::max(across.rms(), down.rms());
  if (!(camera.fx_px > 0.0 && camera.fy_px > 0.0 && error_px < kMaxRayErrorPx))
    return Error{fmt::format("the points do not lie on the rays of one camera: {:.3g} pixels off", error_px),
                 kOrganisedRemedy};
  return camera;
}

Status depths_of(const OrganisedPoints& points, const DepthCamera& camera, std::vector<float>& depth_mm) {
  if (points.points_mm.size() != camera.pixels() || points.width != static_cast<std::uint32_t>(camera.width))
    return Error{fmt::format("the cloud has {} x {} points, the camera {} x {} pixels", points.width,
                             points.height, camera.width, camera.height),
                 "all clouds of a folder come from one camera: move the others"};
  depth_mm.resize(points.points_mm.size());
  for (std::size_t i = 0; i < depth_mm.size(); ++i) {
    const Vec3& p = points.points_mm[i];
    depth_mm[i] = is_finite(p) && p.z() > 0.0 ? static_cast<float>(p.z()) : 0.0f;
  }
  return Done{};
}

}  // namespace palpate::stream
