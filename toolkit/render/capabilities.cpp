#include <palpate/registry.h>

#include <array>
#include <utility>

namespace palpate::render {
namespace {

constexpr std::array<std::pair<Feature, const char*>, 9> kNames = {{
    {Feature::kFriction, "friction"},
    {Feature::kSoftness, "deformation"},
    {Feature::kTexture, "texture"},
    {Feature::kDent, "dents"},
    {Feature::kPerPoint, "properties point by point"},
    {Feature::kMotion, "motion"},
    {Feature::kManyModels, "several models"},
    {Feature::kMovedPoints, "points moved from outside"},
    {Feature::kJointContact, "joint contact"},
}};

Features features_required_by(const ModelInput& model) {
  const surface::Surface& s = model.surface;
  const surface::PointProperties* const p = s.per_point.get();
  Features asked;
  if (s.friction.any()) asked |= Feature::kFriction;
  if (s.deformation != 0.0) asked |= Feature::kSoftness;
  if (s.texture.any()) asked |= Feature::kTexture;
  if (s.dent.any()) asked |= Feature::kDent;
  if (model.moves != nullptr) asked |= Feature::kMovedPoints;
  if (p != nullptr && (p->varies_stiffness() || p->varies_friction())) {
    asked |= Feature::kPerPoint;
    if (p->varies_friction()) asked |= Feature::kFriction;
  }
  if (model.motion != nullptr) asked |= Feature::kMotion;
  return asked;
}

}  // namespace

std::string_view name_of(Role role) noexcept {
  constexpr std::array<std::string_view, 5> kRoles = {"ours", "literal", "rival", "reference", "oracle"};
  return kRoles[static_cast<std::size_t>(role)];
}

std::string_view name_of(Geometry geometry) noexcept {
  constexpr std::array<std::string_view, 4> kGeometries = {"points", "mesh", "heights", "formula"};
  return kGeometries[static_cast<std::size_t>(geometry)];
}

std::vector<std::string> names_of(Features features) {
  std::vector<std::string> names;
  for (const auto& [feature, name] : kNames)
    if (features.has(feature)) names.emplace_back(name);
  return names;
}

Features features_required_by(const SceneInput& scene) {
  Features asked;
  if (scene.models.size() > 1) asked |= Feature::kManyModels;
  for (const ModelInput& model : scene.models) asked |= features_required_by(model);
  return asked;
}

}  // namespace palpate::render
