#include "toolkit/scene/surface_sources.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <palpate/result.h>
#include "toolkit/core/message_text.h"

namespace palpate::scene {
namespace {

using surface::PointProperties;

constexpr double kDeepest = 65535.0;  // of 16 bits

Status fill_column(const cloud::Cloud& cloud, const std::string& name, std::vector<float>& values) {
  if (name.empty()) return Done{};
  const auto at = std::find_if(cloud.properties.begin(), cloud.properties.end(),
                               [&](const cloud::Property& p) { return p.name == name; });
  if (at != cloud.properties.end()) {
    values = at->values;
    return Done{};
  }
  const std::vector<std::string> known = names_of(cloud.properties);
  return Error{
      fmt::format("the model has no column '{}'", name),
      did_you_mean(name, known,
                   known.empty() ? "its file has none beside the coordinates" : "it has " + joined(known)),
      {},
      0};
}

/// Reads a height image of any model format: its posts, lowest 0, highest 65535.
Result<surface::TextureImage> read_image(const std::string& path, const io::Readers& readers,
                                         std::uint64_t max_bytes, Progress& progress) {
  io::ReadOptions options;
  options.max_bytes = max_bytes;
  options.unit = io::Unit::kMillimetre;
  options.non_finite = cloud::NonFinite::kRefuse;
  PALPATE_ASSIGN(const io::ReadModel read, readers.read(path, options, progress));
  const cloud::Cloud& cloud = read.cloud;
  if (!cloud.raster)
    return Error{"is no full grid of heights", "give a PFM, or a 16-bit PNG or TIFF without holes", path, 0};
  surface::TextureImage image;
  image.columns = cloud.raster->columns;
  image.rows = cloud.raster->rows;
  const auto [low, high] = std::minmax_element(cloud.z_mm.begin(), cloud.z_mm.end());
  const double range = static_cast<double>(*high) - static_cast<double>(*low);
  image.height.reserve(cloud.size());
  for (const float z : cloud.z_mm) {
    const double share = range > 0.0 ? (static_cast<double>(z) - static_cast<double>(*low)) / range : 1.0;
    image.height.push_back(static_cast<std::uint16_t>(std::lround(share * kDeepest)));
  }
  return image;
}

/// The map seen along z, tiled, nearest pixel.
Status fill_map(const FrictionMap& map, const cloud::Cloud& cloud, const Result<surface::TextureImage>& image,
                std::vector<float>& values) {
  if (!image) return image.error();
  const double per_mm = image->columns / map.tile_mm;
  const auto tile = [](double x, double n) { return std::min(x - n * std::floor(x / n), n - 1.0); };
  values.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    const auto column = static_cast<std::size_t>(tile(p.x() * per_mm, image->columns));
    const auto row = static_cast<std::size_t>(tile(p.y() * per_mm, image->rows));
    const double share = image->height[row * image->columns + column] / kDeepest;
    values[i] = static_cast<float>(map.low + share * (map.high - map.low));
  }
  return Done{};
}

/// Fills missing values with `value`.
void widen(std::vector<float>& values, std::size_t n, double value) {
  if (values.empty()) values.assign(n, static_cast<float>(value));
}

/// Returns the number of points in the region.
std::size_t fill_region(const SceneRegion& region, const surface::Surface& base, const cloud::Cloud& cloud,
                        PointProperties& p) {
  const std::size_t n = cloud.size();
  if (region.stiffness_n_per_mm) widen(p.stiffness_n_per_mm, n, base.stiffness_n_per_mm);
  if (region.deformation) widen(p.deformation, n, base.deformation);
  if (region.friction) {
    // A single coefficient's column or map serves as both.
    if (p.dynamic_friction.empty() && !p.static_friction.empty()) p.dynamic_friction = p.static_friction;
    widen(p.static_friction, n, base.friction.static_coefficient);
    widen(p.dynamic_friction, n, base.friction.dynamic_coefficient);
  }
  std::size_t inside = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!region.box_mm.contains(cloud.point_mm(i))) continue;
    ++inside;
    if (region.stiffness_n_per_mm) p.stiffness_n_per_mm[i] = static_cast<float>(*region.stiffness_n_per_mm);
    if (region.deformation) p.deformation[i] = static_cast<float>(*region.deformation);
    if (region.friction) {
      p.static_friction[i] = static_cast<float>(region.friction->static_coefficient);
      p.dynamic_friction[i] = static_cast<float>(region.friction->dynamic_coefficient);
    }
  }
  return inside;
}

}  // namespace

Status resolve_surface(const SceneModel& model, const io::Readers& readers, std::uint64_t max_bytes,
                       Progress& progress, render::ModelInput& input, std::vector<std::string>& warnings) {
  input.surface = model.surface;
  const SurfaceSources& sources = model.sources;
  if (!sources.texture_image.empty()) {
    PALPATE_ASSIGN(surface::TextureImage image,
                   read_image(sources.texture_image, readers, max_bytes, progress));
    input.surface.texture.image = std::make_shared<const surface::TextureImage>(std::move(image));
  }
  auto p = std::make_shared<PointProperties>();
  const cloud::Cloud& cloud = *input.cloud;
  for (const auto& [name, values] : {std::pair{&sources.stiffness_column, &p->stiffness_n_per_mm},
                                     std::pair{&sources.static_friction_column, &p->static_friction},
                                     std::pair{&sources.dynamic_friction_column, &p->dynamic_friction},
                                     std::pair{&sources.deformation_column, &p->deformation}})
    PALPATE_TRY(fill_column(cloud, *name, *values));
  if (sources.friction_map)
    PALPATE_TRY(fill_map(*sources.friction_map, cloud,
                         read_image(sources.friction_map->image, readers, max_bytes, progress),
                         p->static_friction));
  for (const SceneRegion& region : model.regions)
    if (fill_region(region, model.surface, cloud, *p) == 0)
      warnings.push_back(fmt::format("The region in line {} holds no point of {}: it changes nothing.",
                                     region.line, model.name));
  if (p->varies_stiffness() || p->varies_friction()) input.surface.per_point = std::move(p);
  return Done{};
}

}  // namespace palpate::scene
