#include "experiments/window/splat_points.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "baselines/reference/closest_mesh.h"
#include "toolkit/core/random.h"
#include "toolkit/search/knn.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::experiments {
namespace {

constexpr std::uint64_t kEvenOrderSeed = 20'090'414;
constexpr Rgba kUnknownColour = {150, 150, 150, 255};
constexpr double kLargestNormal = 127.0, kLargestByte = 255.0;
/// Percentile of errors with the full colour: one outlier must not hide the rest.
constexpr double kErrorShare = 0.99;

std::uint8_t byte_of(double value) noexcept {
  return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 1.0) * kLargestByte));
}

Rgba mixed(const Rgba& a, const Rgba& b, double share) noexcept {
  Rgba between{};
  for (std::size_t k = 0; k < between.size(); ++k)
    between[k] = static_cast<std::uint8_t>(std::lround((1.0 - share) * a[k] + share * b[k]));
  return between;
}

template <std::size_t N>
Rgba between_stops(const std::array<Rgba, N>& stops, double share) noexcept {
  if (!(share >= 0.0)) share = 0.0;
  const double at = std::min(share, 1.0) * static_cast<double>(N - 1);
  const std::size_t low = std::min(static_cast<std::size_t>(at), N - 2);
  return mixed(stops[low], stops[low + 1], at - static_cast<double>(low));
}

/// A value per point in the cloud's order, with its range.
struct Values {
  std::vector<float> of;
  bool both_signs = false;
};

const cloud::Property* property_named(const cloud::Cloud& cloud, std::initializer_list<const char*> names) {
  for (const char* name : names)
    for (const cloud::Property& property : cloud.properties)
      if (property.name == name) return &property;
  return nullptr;
}

bool file_colours(const cloud::Cloud& cloud, std::span<const std::uint32_t> order, std::vector<Rgba>& into) {
  const cloud::Property* red = property_named(cloud, {"red", "r", "diffuse_red"});
  const cloud::Property* green = property_named(cloud, {"green", "g", "diffuse_green"});
  const cloud::Property* blue = property_named(cloud, {"blue", "b", "diffuse_blue"});
  if (red == nullptr || green == nullptr || blue == nullptr) return false;
  float most = 0.0f;
  for (const cloud::Property* one : {red, green, blue})
    for (const float value : one->values) most = std::max(most, value);
  // Files hold bytes or shares of 1.
  const double scale = most > 1.0f ? 1.0 / kLargestByte : 1.0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::uint32_t point = order[i];
    into[i] = {byte_of(scale * static_cast<double>(red->values[point])),
               byte_of(scale * static_cast<double>(green->values[point])),
               byte_of(scale * static_cast<double>(blue->values[point])), 255};
  }
  return true;
}

std::vector<float> heights(const render::ModelInput& model) {
  std::vector<float> z_mm(model.cloud->size());
  for (std::size_t i = 0; i < z_mm.size(); ++i)
    z_mm[i] = static_cast<float>((model.world_from_model * model.cloud->point_mm(i)).z());
  return z_mm;
}

Values errors(const render::ModelInput& model, ColourScale& scale) {
  Values values;
  values.both_signs = true;
  const cloud::Cloud& cloud = *model.cloud;
  if (model.analytic) {
    for (std::size_t i = 0; i < cloud.size(); ++i)
      values.of.push_back(static_cast<float>(model.analytic->signed_distance_mm(cloud.point_mm(i))));
    return values;
  }
  if (!model.original_mesh || model.original_mesh->empty()) {
    scale.nothing = "no truth: neither a formula nor faces in the file";
    return values;
  }
  const auto mesh = baselines::ClosestMesh::build(*model.original_mesh, geometry::RigidTransform());
  if (!mesh) {
    scale.nothing = mesh.error().message();
    return values;
  }
  for (std::size_t i = 0; i < cloud.size(); ++i)
    values.of.push_back(static_cast<float>((*mesh)->signed_distance_mm(cloud.point_mm(i))));
  return values;
}

Values values_of(const render::ModelInput& model, ColourBy by, ColourScale& scale) {
  const surface::PointProperties* own = model.surface.per_point.get();
  switch (by) {
    case ColourBy::kHeight:
      scale.unit = "mm";
      return {heights(model)};
    case ColourBy::kStiffness:
      scale.unit = "N/mm";
      scale.low = scale.high = model.surface.stiffness_n_per_mm;
      return own != nullptr ? Values{own->stiffness_n_per_mm} : Values{};
    case ColourBy::kFriction:
      scale.low = scale.high = model.surface.friction.dynamic_coefficient;
      return own != nullptr ? Values{own->dynamic_friction} : Values{};
    case ColourBy::kError:
      scale.unit = "mm";
      return errors(model, scale);
    case ColourBy::kFile:
      if (model.cloud->properties.empty()) {
        scale.nothing = "the file has no values beside coordinates";
        return {};
      }
      scale.unit = model.cloud->properties.front().name;
      return {model.cloud->properties.front().values};
    case ColourBy::kPlain:
      break;
  }
  return {};
}

/// Magnitude that nearly all values stay within.
double usual_size(std::vector<float> values) {
  for (float& value : values) value = std::abs(value);
  const auto at = static_cast<std::ptrdiff_t>(kErrorShare * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return static_cast<double>(values[static_cast<std::size_t>(at)]);
}

}  // namespace

const char* colour_name(ColourBy by) noexcept {
  switch (by) {
    case ColourBy::kPlain:
      return "plain";
    case ColourBy::kHeight:
      return "height";
    case ColourBy::kFile:
      return "the file's";
    case ColourBy::kStiffness:
      return "stiffness";
    case ColourBy::kFriction:
      return "friction";
    case ColourBy::kError:
      return "error";
  }
  return "unknown";
}

Rgba ramp(double share) noexcept {
  // Lightness rises evenly, so grey prints keep the order.
  static constexpr std::array<Rgba, 5> kStops = {
      {{48, 30, 96, 255}, {52, 90, 140, 255}, {40, 148, 138, 255}, {118, 200, 90, 255}, {250, 228, 60, 255}}};
  return between_stops(kStops, share);
}

Rgba two_sided(double share) noexcept {
  static constexpr std::array<Rgba, 5> kStops = {{{24, 60, 170, 255},
                                                  {120, 165, 230, 255},
                                                  {240, 240, 240, 255},
                                                  {238, 140, 110, 255},
                                                  {170, 20, 30, 255}}};
  return between_stops(kStops, 0.5 * (share + 1.0));
}

std::vector<std::uint32_t> even_order(std::size_t n) {
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0u);
  Random random(kEvenOrderSeed);
  for (std::size_t i = n; i > 1; --i)
    std::swap(order[i - 1], order[static_cast<std::size_t>(random.below(i))]);
  return order;
}

std::vector<float> places_in_order(const cloud::Cloud& cloud, std::span<const std::uint32_t> order) {
  constexpr std::size_t kAxes = 3;
  std::vector<float> places(kAxes * order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    places[kAxes * i] = cloud.x_mm[order[i]];
    places[kAxes * i + 1] = cloud.y_mm[order[i]];
    places[kAxes * i + 2] = cloud.z_mm[order[i]];
  }
  return places;
}

std::vector<Rgba> colours_in_order(const render::ModelInput& model, std::span<const std::uint32_t> order,
                                   ColourBy by, ColourScale& scale) {
  scale = {};
  std::vector<Rgba> colours(order.size(), kPlainColour);
  if (by == ColourBy::kPlain) return colours;
  if (by == ColourBy::kFile && file_colours(*model.cloud, order, colours)) {
    scale.unit = "red, green, blue";
    return colours;
  }
  const Values values = values_of(model, by, scale);
  if (!scale.nothing.empty()) std::fill(colours.begin(), colours.end(), kUnknownColour);
  if (values.of.size() != order.size()) return colours;
  if (values.both_signs) {
    scale.high = usual_size(values.of);
    scale.low = -scale.high;
  } else {
    const auto [low, high] = std::minmax_element(values.of.begin(), values.of.end());
    scale.low = static_cast<double>(*low);
    scale.high = static_cast<double>(*high);
  }
  const double span = scale.high - scale.low;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const double share = span > 0.0 ? (static_cast<double>(values.of[order[i]]) - scale.low) / span : 0.5;
    colours[i] = values.both_signs ? two_sided(2.0 * share - 1.0) : ramp(share);
  }
  return colours;
}

Surroundings find_surroundings(const cloud::Cloud& cloud) {
  constexpr int kOneThread = 1;
  Surroundings found;
  found.neighbours = search::exact_knn(cloud, kOneThread);
  std::vector<surface::OrientedPoint> points = surface::surface_points(cloud);
  surface::fit_planes(points, found.neighbours.of, kOneThread);
  (void)surface::orient_planes(points, found.neighbours.of, kOneThread);
  found.normals.reserve(points.size());
  for (const surface::OrientedPoint& point : points) {
    PackedNormal packed{};
    if (point.normal != surface::kNoNormal) {
      const Vec3 normal = surface::decode_normal(point.normal);
      for (int axis = 0; axis < 3; ++axis)
        packed[static_cast<std::size_t>(axis)] =
            static_cast<std::int8_t>(std::lround(kLargestNormal * normal[axis]));
    }
    found.normals.push_back(packed);
  }
  return found;
}

Vec3 Surroundings::half_box_mm(const cloud::Cloud& cloud, std::uint32_t point) const noexcept {
  Vec3 half_mm = Vec3::Zero();
  for (const std::uint32_t other : neighbours.of[point])
    half_mm = half_mm.cwiseMax((cloud.local_mm(other) - cloud.local_mm(point)).cwiseAbs());
  return half_mm;
}

}  // namespace palpate::experiments
