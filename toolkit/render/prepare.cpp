#include "toolkit/render/prepare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <palpate/decision.h>
#include <palpate/model_store.h>
#include <palpate/renderer.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/winding_number.h"
#include "toolkit/render/shading.h"

namespace palpate::render {
namespace {
/// Extent divided by the rounding of a coordinate.
constexpr double kExtentPerRounding = 0x1p25;
}  // namespace

double coordinate_rounding_mm(const cloud::Cloud& cloud) {
  return cloud.box_mm().extent_mm().maxCoeff() * kUnitRoundoffFloat * 0.5;
}

bool float_precision_suffices(const cloud::Cloud& cloud, double spacing_mm) {
  return !(spacing_mm > 0.0) || coordinate_rounding_mm(cloud) <= kMaxRoundingShare * spacing_mm;
}

Decision coordinates_decision(const cloud::Cloud& cloud, double spacing_mm) {
  const double rounding_mm = coordinate_rounding_mm(cloud);
  const double share = spacing_mm > 0.0 ? rounding_mm / spacing_mm : 0.0;
  std::string reason =
      fmt::format("they round to {:.2g} mm, {:.2g} of the median spacing", rounding_mm, share);
  if (!float_precision_suffices(cloud, spacing_mm))
    reason += fmt::format(
        ": TOO COARSE, more than a hundredth; cut the cloud into models of a part of its extent, {:.0f} "
        "along "
        "its longest side",
        std::ceil(share / kMaxRoundingShare));
  else if (spacing_mm > 0.0)
    reason +=
        fmt::format(": its extent is 2^{:.0f} spacings, and floats hold up to 2^{:.0f}",
                    std::log2(share * kExtentPerRounding), std::log2(kMaxRoundingShare * kExtentPerRounding));
  return {"coordinates", "float, relative to the middle of the box", std::move(reason)};
}

std::optional<std::string> wide_mouth_warning(double min_enclosed) {
  const double mouth = 1.0 - min_enclosed;
  if (!(mouth > geometry::kWideOpeningFraction)) return std::nullopt;
  return fmt::format(
      "A piece encloses a volume but for a mouth of {:.0f} % of its surface: it is felt from the side on "
      "which a "
      "replay begins alone, and a probe that goes in by the mouth feels nothing. If the inner side is to be "
      "felt too, as of a vase, say sides=both.",
      100.0 * mouth);
}

geometry::Aabb box_of(const std::vector<ModelInput>& models) {
  geometry::Aabb box;
  constexpr int kCorners = 8;
  for (const ModelInput& model : models) {
    const geometry::Aabb own = model.cloud->box_mm();
    for (int corner = 0; corner < kCorners; ++corner) {
      Vec3 at = own.low_mm;
      for (int axis = 0; axis < 3; ++axis)
        if ((corner >> axis & 1) != 0) at[axis] = own.high_mm[axis];
      box.add(model.world_from_model * at);
    }
  }
  return box;
}

ModelInput subset_of(const ModelInput& model, std::span<const std::uint32_t> of,
                     const std::optional<cloud::ScanRaster>& raster) {
  ModelInput part = model;
  auto points = std::make_shared<cloud::Cloud>(cloud::subset_of(*model.cloud, of));
  points->raster = raster;
  part.cloud = std::move(points);
  part.original_mesh = nullptr;
  part.prepared = nullptr;
  if (const surface::PointProperties* p = model.surface.per_point.get())
    part.surface.per_point = std::make_shared<const surface::PointProperties>(surface::PointProperties{
        cloud::taken(p->stiffness_n_per_mm, of), cloud::taken(p->static_friction, of),
        cloud::taken(p->dynamic_friction, of), cloud::taken(p->deformation, of)});
  return part;
}

namespace {

/// Warnings for the user, whichever renderer prepared the data.
void add_to_report(const PrepareReport& of, PrepareReport& to) {
  to.bytes += of.bytes;
  to.notes.insert(to.notes.end(), of.notes.begin(), of.notes.end());
  to.warnings.insert(to.warnings.end(), of.warnings.begin(), of.warnings.end());
}

}  // namespace

std::shared_ptr<const void> ModelStore::find(const std::string& key, PrepareReport& report) {
  std::erase_if(held_, [](const auto& entry) { return entry.second.geometry.expired(); });
  const auto found = held_.find(key);
  std::shared_ptr<const void> geometry = found == held_.end() ? nullptr : found->second.geometry.lock();
  if (geometry == nullptr) return nullptr;
  add_to_report(found->second.report, report);
  report.shared_bytes += found->second.report.bytes;
  return geometry;
}

void ModelStore::keep(const std::string& key, const std::shared_ptr<const void>& geometry, PrepareReport own,
                      PrepareReport& report) {
  add_to_report(own, report);
  report.total_ms += own.total_ms;
  report.phases.insert(report.phases.end(), own.phases.begin(), own.phases.end());
  held_[key] = {geometry, std::move(own)};
}

std::size_t ModelStore::size() const {
  const std::scoped_lock lock(mutex_);
  return static_cast<std::size_t>(std::count_if(
      held_.begin(), held_.end(), [](const auto& entry) { return !entry.second.geometry.expired(); }));
}

std::string key_text(const Options& options, std::span<const OptionSpec> specs) {
  std::string text;
  for (const OptionSpec& spec : specs) text += fmt::format(" {}={}", spec.key, options.text(spec.key));
  return text;
}

namespace {

/// Cost of broad phase and model loop in each frame, from feature_cost.
constexpr double kManyUs = 0.02;

bool can_deform(const ModelInput& model) {
  return model.surface.dent.any() || model.moves != nullptr;
}

Decision broad_phase_decision(const SceneInput& scene, const SceneDecision& decided) {
  if (!decided.many) return {"broad phase", "none", "one model at rest: there is nothing to choose from"};
  const bool moves = std::any_of(scene.models.begin(), scene.models.end(),
                                 [](const ModelInput& model) { return model.motion != nullptr; });
  const std::string what =
      fmt::format("{} model{}{}", scene.models.size(), scene.models.size() > 1 ? "s" : "",
                  moves ? ", some of them moving" : "");
  if (decided.broad_phase)
    return {"broad phase", "tree of model boxes",
            what + ": a frame looks only at those near the HIP, wherever their points go"};
  return {"broad phase", "none", what + ": this renderer looks at every one in every frame"};
}

/// The sum, or nothing if a part is unknown.
std::optional<double> plus(const std::optional<double>& a, const std::optional<double>& b) {
  return a && b ? std::optional<double>(*a + *b) : std::nullopt;
}

}  // namespace

SceneDecision decide_scene(const SceneInput& scene, const LocalModelTraits& kind,
                           ContactCombination combine) {
  SceneDecision decided;
  decided.many = scene.models.size() > 1 ||
                 std::any_of(scene.models.begin(), scene.models.end(), [&](const auto& model) {
                   return model.motion != nullptr || (kind.changes && can_deform(model));
                 });
  decided.broad_phase = decided.many && kind.boxed;
  decided.combine = kind.sums ? ContactCombination::kSum : combine;
  decided.force_limit_n = scene.force_limit_n;
  return decided;
}

void describe_scene(const SceneInput& scene, const SceneDecision& scene_decision, Decisions& decided) {
  decided.decisions.push_back(broad_phase_decision(scene, scene_decision));
  if (scene.models.size() > 1)
    decided.decisions.push_back(
        scene_decision.combine == ContactCombination::kSum
            ? Decision{"models touched at once", "sum", "each answers for itself, and the forces are added"}
            : Decision{"models touched at once", "joint", "one god object is held by all of them together"});
  decided.decisions.push_back(force_limit_decision(scene_decision.force_limit_n));
  decided.prepare_ms = 0.0;
  decided.frame_us = scene_decision.many ? kManyUs : 0.0;
  std::optional<double> slowest = 0.0;
  for (const ModelDecisions& model : decided.models) {
    decided.bytes += model.bytes;
    decided.prepare_ms = plus(decided.prepare_ms, model.prepare_ms);
    slowest =
        slowest && model.frame_us ? std::optional<double>(std::max(*slowest, *model.frame_us)) : std::nullopt;
  }
  decided.frame_us = plus(decided.frame_us, slowest);
}

Decision force_limit_decision(double force_limit_n) {
  if (force_limit_n > 0.0)
    return {"force limit", fmt::format("{:.3g} N", force_limit_n), "the scene sets it", true};
  return {"force limit", "none", "the scene sets none; a device has its own"};
}

std::string note_text(const Decision& decision) {
  return fmt::format("{}: {}, {}", decision.about, decision.choice, decision.reason);
}

namespace {

constexpr const char* kAbout = "shading";

}  // namespace

ShadingDecision given_shading(const std::string& choice) {
  return {parse_shading(choice), {kAbout, choice, "as given", true}};
}

ShadingDecision decide_literal_shading(const std::string& choice, double resolution_mm) {
  if (choice != "auto") return given_shading(choice);
  ShadingDecision decided;
  const bool shade = resolution_mm > kLiteralShadingResolutionMm;
  if (shade) decided.shading = Shading::kAreaRaw;
  decided.explanation = {kAbout, shade ? "area-raw" : "none",
                         fmt::format("the resolution, {:.3g} mm, is {} {} mm (section 3.4)", resolution_mm,
                                     shade ? "above" : "at most", kLiteralShadingResolutionMm)};
  return decided;
}

}  // namespace palpate::render
