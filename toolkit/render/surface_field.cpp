#include "toolkit/render/surface_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <queue>
#include <vector>

#include <palpate/result.h>

namespace palpate::render {
namespace {

bool is_coefficient(double x) {
  return std::isfinite(x) && x >= 0.0;
}

Status check(const surface::Surface& s) {
  if (!(s.stiffness_n_per_mm > 0.0) || !std::isfinite(s.stiffness_n_per_mm))
    return Error{"the stiffness must be a positive number", "set stiffness_n_per_mm"};
  if (!is_coefficient(s.friction.static_coefficient) || !is_coefficient(s.friction.dynamic_coefficient) ||
      s.friction.dynamic_coefficient > s.friction.static_coefficient)
    return Error{"friction needs static >= dynamic >= 0", "set friction = { static = .., dynamic = .. }"};
  if (!(s.deformation >= 0.0 && s.deformation < 1.0))
    return Error{"the deformation must be at least 0 and below 1", "set deformation"};
  const surface::Texture& t = s.texture;
  if (!t.any()) return Done{};
  if (!(t.depth_mm > 0.0) || !(t.wavelength_mm > 0.0) || !std::isfinite(t.depth_mm / t.wavelength_mm))
    return Error{"a texture needs a depth and a wavelength above 0", "set depth_mm and wavelength_mm"};
  if (t.kind == surface::TextureKind::kImage && (t.image == nullptr || t.image->empty()))
    return Error{"the texture's image is empty", "give an image with at least one pixel"};
  return Done{};
}

Result<SurfaceDecision> decide_uniform(const surface::Surface& s) {
  PALPATE_TRY(check(s));
  SurfaceDecision decided;
  decided.stiffness_n_per_mm = s.stiffness_n_per_mm * (1.0 - s.deformation);
  decided.largest_stiffness_n_per_mm = decided.stiffness_n_per_mm;
  decided.friction = s.friction;
  if (s.friction.any()) decided.features |= kFriction;
  if (!s.texture.any()) return decided;
  decided.features |= kTexture;
  decided.texture = s.texture;
  if (const double steepest = s.texture.steepest(); steepest > surface::kMaxTextureSlope)
    decided.texture.depth_mm *= surface::kMaxTextureSlope / steepest;
  return decided;
}

SurfaceField field_of(const surface::Surface& s, const SurfaceDecision& decided, PrepareReport& report) {
  if (decided.texture.depth_mm < s.texture.depth_mm)
    report.notes.push_back(fmt::format(
        "texture: {:.3g} mm deep would slope by {:.3g}; made {:.3g} mm deep, a slope of {:.3g}",
        s.texture.depth_mm, s.texture.steepest(), decided.texture.depth_mm, surface::kMaxTextureSlope));
  SurfaceField field;
  static_cast<SurfaceDecision&>(field) = decided;
  return field;
}

Status check_lengths(const surface::PointProperties& p, std::size_t n) {
  for (const auto* values : {&p.stiffness_n_per_mm, &p.static_friction, &p.dynamic_friction, &p.deformation})
    if (!values->empty() && values->size() != n)
      return Error{fmt::format("per-point properties for {} points, the cloud has {}", values->size(), n),
                   "give one value for each point"};
  return Done{};
}

/// The surface at one cloud point of a model with varying properties.
surface::Surface surface_at(const surface::Surface& whole, std::size_t i) {
  const surface::PointProperties& p = *whole.per_point;
  surface::Surface s = whole;
  if (!p.stiffness_n_per_mm.empty()) s.stiffness_n_per_mm = static_cast<double>(p.stiffness_n_per_mm[i]);
  if (!p.static_friction.empty()) s.friction.static_coefficient = static_cast<double>(p.static_friction[i]);
  // A single coefficient serves as both.
  if (!p.dynamic_friction.empty())
    s.friction.dynamic_coefficient = static_cast<double>(p.dynamic_friction[i]);
  else if (!p.static_friction.empty())
    s.friction.dynamic_coefficient = s.friction.static_coefficient;
  if (!p.deformation.empty()) s.deformation = static_cast<double>(p.deformation[i]);
  return s;
}

double felt_stiffness(const surface::Surface& s) {
  return s.stiffness_n_per_mm * (1.0 - s.deformation);
}

/// Extra time of contact frames with each stage (feature_cost); estimates for reports only.
constexpr double kFrictionUs = 0.05, kVariedUs = 0.02, kTextureUs = 0.11;

/// One optional property, uniform or per point.
Decision property(const char* name, bool any, bool per_point, std::string value, std::uint64_t places) {
  if (per_point)
    return {name, "per point",
            fmt::format("it differs from point to point: {} bytes for each of {}, for all that differs",
                        sizeof(PointSurface), places)};
  if (any)
    return {name, "one value, " + std::move(value), "it is the same all over the model: no byte for it"};
  return {name, "none",
          "the scene asks for none: its stage is not in the frame function, and no byte is stored"};
}

Decision left_out_decision(const char* name) {
  return {name, "left out", "the scene asks for it, and this renderer has none"};
}

}  // namespace

bool varies(const surface::Surface& surface) noexcept {
  const surface::PointProperties* const p = surface.per_point.get();
  return p != nullptr && (p->varies_stiffness() || p->varies_friction());
}

Result<SurfaceDecision> decide_surface(const ModelInput& model) {
  Result<SurfaceDecision> decided = decide_uniform(model.surface);
  if (!decided || model.surface.per_point == nullptr) return decided;
  const surface::PointProperties& p = *model.surface.per_point;
  const std::size_t n = model.cloud->size();
  PALPATE_TRY(check_lengths(p, n));
  if (!varies(model.surface)) return decided;
  decided->features |= kVaried;
  decided->largest_stiffness_n_per_mm = 0.0;
  bool rubs = false;
  for (std::size_t i = 0; i < n; ++i) {
    const surface::Surface s = surface_at(model.surface, i);
    if (const Status right = check(s); !right) {
      Error error = right.error();
      error.what = fmt::format("point {}: {}", i, error.what);
      return error;
    }
    decided->largest_stiffness_n_per_mm = std::max(decided->largest_stiffness_n_per_mm, felt_stiffness(s));
    rubs |= s.friction.any();
  }
  decided->features = rubs ? decided->features | kFriction : decided->features & ~unsigned{kFriction};
  return decided;
}

void describe_surface(const ModelInput& model, const SurfaceDecision& decision, Features felt,
                      std::uint64_t places, ModelDecisions& out) {
  const surface::PointProperties* const p = model.surface.per_point.get();
  const bool varied = (decision.features & kVaried) != 0;
  const bool rubs = (decision.features & kFriction) != 0, textured = (decision.features & kTexture) != 0;
  out.decisions.push_back(
      rubs && !felt.has(Feature::kFriction)
          ? left_out_decision("friction")
          : property("friction", rubs, rubs && p != nullptr && p->varies_friction(),
                     fmt::format("static {:.3g}, dynamic {:.3g}", decision.friction.static_coefficient,
                                 decision.friction.dynamic_coefficient),
                     places));
  out.decisions.push_back(property("stiffness and deformation", true, p != nullptr && p->varies_stiffness(),
                                   fmt::format("{:.3g} N/mm", decision.stiffness_n_per_mm), places));
  out.decisions.push_back(
      textured && !felt.has(Feature::kTexture)
          ? left_out_decision("texture")
          : property("texture", textured, false,
                     fmt::format("{:.3g} mm deep over {:.3g} mm", decision.texture.depth_mm,
                                 decision.texture.wavelength_mm),
                     places));
  if (varied) out.bytes += sizeof(PointSurface) * places;
  if (out.frame_us)
    *out.frame_us += (rubs && felt.has(Feature::kFriction) ? kFrictionUs : 0.0) + (varied ? kVariedUs : 0.0) +
                     (textured && felt.has(Feature::kTexture) ? kTextureUs : 0.0);
}

Result<SurfaceField> build_uniform_surface_field(const surface::Surface& surface, PrepareReport& report) {
  PALPATE_ASSIGN(const SurfaceDecision decided, decide_uniform(surface));
  return field_of(surface, decided, report);
}

Result<SurfaceField> build_surface_field(const ModelInput& model, std::span<const std::uint32_t> order,
                                         PrepareReport& report) {
  PALPATE_ASSIGN(const SurfaceDecision decided, decide_surface(model));
  SurfaceField field = field_of(model.surface, decided, report);
  if ((field.features & kVaried) == 0) return field;
  field.by_point.resize(order.size());
  for (std::size_t place = 0; place < order.size(); ++place) {
    const surface::Surface s = surface_at(model.surface, order[place]);
    field.by_point[place] = {static_cast<float>(felt_stiffness(s)),
                             static_cast<float>(s.friction.static_coefficient),
                             static_cast<float>(s.friction.dynamic_coefficient)};
  }
  return field;
}

std::size_t blend_stiffness(SurfaceField& field, std::span<const surface::OrientedPoint> points,
                            std::span<const search::Neighbours> neighbours, double blend_mm) {
  if (field.by_point.empty() || !(blend_mm > 0.0)) return 0;
  const auto stiffness = [&](std::size_t place) {
    return static_cast<double>(field.by_point[place].stiffness_n_per_mm);
  };
  const auto [least, most] = std::minmax_element(field.by_point.begin(), field.by_point.end(),
                                                 [](const PointSurface& a, const PointSurface& b) {
                                                   return a.stiffness_n_per_mm < b.stiffness_n_per_mm;
                                                 });
  const double rise =
      (static_cast<double>(most->stiffness_n_per_mm) - static_cast<double>(least->stiffness_n_per_mm)) /
      blend_mm;
  if (!(rise > 0.0)) return 0;
  // Softest first, as in Dijkstra's search: a point is final when taken.
  using Entry = std::pair<float, std::uint32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  const auto soften_around = [&](std::uint32_t place) {
    std::size_t softened = 0;
    for (const std::uint32_t other : neighbours[place]) {
      const double way = (points[other].at() - points[place].at()).norm();
      const auto limit = static_cast<float>(stiffness(place) + rise * way);
      if (!(field.by_point[other].stiffness_n_per_mm > limit)) continue;
      field.by_point[other].stiffness_n_per_mm = limit;
      queue.emplace(limit, other);
      ++softened;
    }
    return softened;
  };
  std::vector<std::uint32_t> softest_first(points.size());
  for (std::uint32_t i = 0; i < softest_first.size(); ++i) softest_first[i] = i;
  // Only borders start a search; a point that softens no neighbour is not queued.
  for (const std::uint32_t place : softest_first) (void)soften_around(place);
  std::vector<bool> changed(points.size());
  std::size_t count = 0;
  while (!queue.empty()) {
    const auto [value, place] = queue.top();
    queue.pop();
    if (value != field.by_point[place].stiffness_n_per_mm) continue;  // softened again later
    if (!changed[place]) {
      changed[place] = true;
      ++count;
    }
    (void)soften_around(place);
  }
  return count;
}

}  // namespace palpate::render
