#include "toolkit/render/surface_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <queue>
#include <vector>

namespace palpate::render {
namespace {

bool is_coefficient(double x) {
  return std::isfinite(x) && x >= 0.0;
}

Status check(const surface::Surface& s) {
  if (!(s.stiffness_n_per_mm > 0.0) || !std::isfinite(s.stiffness_n_per_mm))
    return Error{"the stiffness must be a positive number", "set stiffness_n_per_mm", {}, 0};
  if (!is_coefficient(s.friction.static_coefficient) || !is_coefficient(s.friction.dynamic_coefficient) ||
      s.friction.dynamic_coefficient > s.friction.static_coefficient)
    return Error{
        "friction needs static >= dynamic >= 0", "set friction = { static = .., dynamic = .. }", {}, 0};
  if (!(s.deformation >= 0.0 && s.deformation < 1.0))
    return Error{"the deformation must be at least 0 and below 1", "set deformation", {}, 0};
  const surface::Texture& t = s.texture;
  if (!t.any()) return Done{};
  if (!(t.depth_mm > 0.0) || !(t.wavelength_mm > 0.0) || !std::isfinite(t.depth_mm / t.wavelength_mm))
    return Error{"a texture needs a depth and a wavelength above 0", "set depth_mm and wavelength_mm", {}, 0};
  if (t.kind == surface::TextureKind::kImage && (t.image == nullptr || t.image->empty()))
    return Error{"the texture's image is empty", "give an image with at least one pixel", {}, 0};
  return Done{};
}

Result<SurfaceField> uniform_field(const surface::Surface& s, PrepareReport& report) {
  if (const Status right = check(s); !right) return right.error();
  SurfaceField field;
  field.stiffness_n_per_mm = s.stiffness_n_per_mm * (1.0 - s.deformation);
  field.largest_stiffness_n_per_mm = field.stiffness_n_per_mm;
  field.friction = s.friction;
  if (s.friction.any()) field.features |= kFriction;
  if (!s.texture.any()) return field;
  field.features |= kTexture;
  field.texture = s.texture;
  const double steepest = s.texture.steepest();
  if (steepest > surface::kMaxTextureSlope) {
    field.texture.depth_mm *= surface::kMaxTextureSlope / steepest;
    report.notes.push_back(
        fmt::format("texture: {:.3g} mm deep would slope by {:.3g}; made {:.3g} mm deep, a slope of {:.3g}",
                    s.texture.depth_mm, steepest, field.texture.depth_mm, surface::kMaxTextureSlope));
  }
  return field;
}

Status check_lengths(const surface::PointProperties& p, std::size_t n) {
  for (const auto* values : {&p.stiffness_n_per_mm, &p.static_friction, &p.dynamic_friction, &p.deformation})
    if (!values->empty() && values->size() != n)
      return Error{fmt::format("per-point properties for {} points, the cloud has {}", values->size(), n),
                   "give one value for each point",
                   {},
                   0};
  return Done{};
}

}  // namespace

Result<SurfaceField> build_uniform_surface_field(const surface::Surface& surface, PrepareReport& report) {
  return uniform_field(surface, report);
}

Result<SurfaceField> build_surface_field(const ModelInput& model, std::span<const std::uint32_t> order,
                                         PrepareReport& report) {
  Result<SurfaceField> built = uniform_field(model.surface, report);
  if (!built || model.surface.per_point == nullptr) return built;
  SurfaceField& field = *built;
  const surface::PointProperties& p = *model.surface.per_point;
  if (const Status right = check_lengths(p, model.cloud->size()); !right) return right.error();
  if (!p.varies_stiffness() && !p.varies_friction()) return built;
  field.features |= kVaried;
  field.of_place.resize(order.size());
  field.largest_stiffness_n_per_mm = 0.0;
  bool rubs = false;
  for (std::size_t place = 0; place < order.size(); ++place) {
    const std::size_t i = order[place];
    surface::Surface s = model.surface;
    if (!p.stiffness_n_per_mm.empty()) s.stiffness_n_per_mm = static_cast<double>(p.stiffness_n_per_mm[i]);
    if (!p.static_friction.empty()) s.friction.static_coefficient = static_cast<double>(p.static_friction[i]);
    // One coefficient alone means both.
    if (!p.dynamic_friction.empty())
      s.friction.dynamic_coefficient = static_cast<double>(p.dynamic_friction[i]);
    else if (!p.static_friction.empty())
      s.friction.dynamic_coefficient = s.friction.static_coefficient;
    if (!p.deformation.empty()) s.deformation = static_cast<double>(p.deformation[i]);
    if (const Status right = check(s); !right) {
      Error error = right.error();
      error.what = fmt::format("point {}: {}", i, error.what);
      return error;
    }
    const double stiffness = s.stiffness_n_per_mm * (1.0 - s.deformation);
    field.of_place[place] = {static_cast<float>(stiffness), static_cast<float>(s.friction.static_coefficient),
                             static_cast<float>(s.friction.dynamic_coefficient)};
    field.largest_stiffness_n_per_mm = std::max(field.largest_stiffness_n_per_mm, stiffness);
    rubs |= s.friction.any();
  }
  field.features = rubs ? field.features | kFriction : field.features & ~unsigned{kFriction};
  return built;
}

std::size_t blend_stiffness(SurfaceField& field, std::span<const surface::SurfacePoint> points,
                            std::span<const neighbourhood::Neighbours> neighbours, double blend_mm) {
  if (field.of_place.empty() || !(blend_mm > 0.0)) return 0;
  const auto stiffness = [&](std::size_t place) {
    return static_cast<double>(field.of_place[place].stiffness_n_per_mm);
  };
  const auto [least, most] = std::minmax_element(field.of_place.begin(), field.of_place.end(),
                                                 [](const PlaceSurface& a, const PlaceSurface& b) {
                                                   return a.stiffness_n_per_mm < b.stiffness_n_per_mm;
                                                 });
  const double rise =
      (static_cast<double>(most->stiffness_n_per_mm) - static_cast<double>(least->stiffness_n_per_mm)) /
      blend_mm;
  if (!(rise > 0.0)) return 0;
  // The softest first, as in Dijkstra's search: each point is final when it is taken.
  using Entry = std::pair<float, std::uint32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  const auto soften_around = [&](std::uint32_t place) {
    std::size_t softened = 0;
    for (const std::uint32_t other : neighbours[place]) {
      const double way = (points[other].at() - points[place].at()).norm();
      const auto limit = static_cast<float>(stiffness(place) + rise * way);
      if (!(field.of_place[other].stiffness_n_per_mm > limit)) continue;
      field.of_place[other].stiffness_n_per_mm = limit;
      queue.emplace(limit, other);
      ++softened;
    }
    return softened;
  };
  std::vector<std::uint32_t> softest_first(points.size());
  for (std::uint32_t i = 0; i < softest_first.size(); ++i) softest_first[i] = i;
  // Only borders start a search: a point that softens nobody is not queued.
  for (const std::uint32_t place : softest_first) (void)soften_around(place);
  std::vector<bool> changed(points.size());
  std::size_t count = 0;
  while (!queue.empty()) {
    const auto [value, place] = queue.top();
    queue.pop();
    if (value != field.of_place[place].stiffness_n_per_mm) continue;  // softened again since
    if (!changed[place]) {
      changed[place] = true;
      ++count;
    }
    (void)soften_around(place);
  }
  return count;
}

}  // namespace palpate::render
