#include <palpate/registry.h>
#include <palpate/result.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <utility>

namespace palpate::render {

std::vector<std::string> unsupported_features(const RendererInfo& info, const SceneInput& scene) {
  std::vector<std::string> sentences;
  for (const std::string& name : names_of(features_required_by(scene).without(info.supports)))
    sentences.push_back(
        fmt::format("{} renders no {}: what the scene says of it is left out.", info.name, name));
  return sentences;
}

void Registry::add(RendererInfo info) {
  assert(find(info.name) == nullptr);
  renderers_.push_back(std::move(info));
}

const RendererInfo* Registry::find(std::string_view name) const noexcept {
  for (const RendererInfo& info : renderers_)
    if (info.name == name) return &info;
  return nullptr;
}

Result<std::unique_ptr<HapticRenderer>> Registry::make(std::string_view name, const Options& options) const {
  const RendererInfo* info = find(name);
  if (info == nullptr) {
    std::string known;
    for (const RendererInfo& r : renderers_) known.append(known.empty() ? "" : ", ").append(r.name);
    return Error{fmt::format("there is no renderer '{}'", name), "choose from " + known};
  }
  PALPATE_ASSIGN(Options complete, validate(options, info->options, name));
  return info->make(complete);
}

namespace {

bool has_camera(const SceneInput& scene) {
  return std::any_of(scene.models.begin(), scene.models.end(),
                     [](const ModelInput& model) { return model.camera != nullptr; });
}

}  // namespace

Status Registry::check_supports(const RendererInfo& info, const SceneInput& scene) const {
  if (info.geometry == Geometry::kImages && !has_camera(scene))
    return Error{fmt::format("{} feels depth images, and the scene has no camera", info.name),
                 "give --stream, or choose heightfield or cloud"};
  const Features asked = features_required_by(scene), missing = asked.without(info.supports);
  if (missing.empty()) return Done{};
  std::string able;
  for (const RendererInfo& r : renderers_)
    if (r.geometry != Geometry::kFormula && (r.geometry != Geometry::kImages || has_camera(scene)) &&
        asked.without(r.supports).empty())
      able.append(able.empty() ? "" : ", ").append(r.name);
  return Error{fmt::format("the scene asks for {}, which {} does not render",
                           fmt::join(names_of(missing), " and "), info.name),
               able.empty() ? "no renderer has all that the scene asks for: take something out of it"
                            : "take it out of the scene, or choose from " + able};
}

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
  constexpr std::array<std::string_view, 5> kGeometries = {"points", "mesh", "heights", "formula", "images"};
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
