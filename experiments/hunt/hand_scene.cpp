#include "experiments/hunt/hand_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include <palpate/generate.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include "experiments/run/stage.h"

namespace palpate::experiments {
namespace {

/// Distance from a border within which a surface may end: random points leave gaps of some three spacings.
constexpr double kBorderSpacings = 4.0;
/// Least width of a part in depths of the press. A round part's depth is half its radius, and its other sides
/// stay away.
constexpr double kFewestDepths = 4.0;
/// A touch lasts at least a tenth of a second.
constexpr std::size_t kFewestHandFrames = 100;

/// Lower bound on the distance to the surface's border; infinite without one.
double to_border_mm(const Quarry& quarry, const geometry::Aabb& box, const Vec3& p) {
  if (!quarry.open()) return std::numeric_limits<double>::infinity();
  return std::min(
      {p.x() - box.low_mm.x(), box.high_mm.x() - p.x(), p.y() - box.low_mm.y(), box.high_mm.y() - p.y()});
}

Error not_judged(const char* what) {
  return {what, "take another quarry", {}, 0};
}

}  // namespace

std::string toml_lines(const Options& options) {
  std::string text;
  for (const auto& [key, value] : options.all()) {
    const bool bare = parse_number(value).ok() || value == "true" || value == "false";
    text += bare ? fmt::format("{} = {}\n", key, value) : fmt::format("{} = \"{}\"\n", key, value);
  }
  return text;
}

std::string surface_toml(const Quarry& quarry) {
  std::string text = fmt::format("  [model.surface]\n  stiffness_n_per_mm = {}\n", kHuntedStiffness);
  if (quarry.friction > 0.0) text += fmt::format("  friction = {:.17g}\n", quarry.friction);
  return text;
}

Result<std::string> hand_scene_toml(const Quarry& quarry) {
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(quarry.model_text()));
  return fmt::format("[[model]]\ngenerate = \"{}\"\n", named.name) + toml_lines(named.options) +
         surface_toml(quarry);
}

Result<HuntScene> make_hand_scene(const Quarry& quarry) {
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(quarry.model_text()));
  PALPATE_ASSIGN(const std::string text, hand_scene_toml(quarry));
  StageRequest request;
  request.scene_name = "hunted";
  PALPATE_ASSIGN(request.scene, scene::parse_scene(text, request.scene_name));
  request.path = quarry.hand->path_text();
  request.threads = request.load.threads = 1;
  PALPATE_ASSIGN(const cloud::GeneratedModel made, cloud::generate(named));
  if (quarry.shape == "bowl") return not_judged("points do not tell from which side a sheet is felt");
  const double depth_mm = quarry.hand->force_n / kHuntedStiffness;
  const Vec3 extent_mm = made.cloud.box_mm().extent_mm();
  const double width_mm = quarry.open() ? std::min(extent_mm.x(), extent_mm.y()) : extent_mm.minCoeff();
  if (std::min(quarry.finest_mm(), width_mm) <
      std::max(kFinestSpacings * made.nominal_spacing_mm, kFewestDepths * depth_mm))
    return not_judged("the shape is finer than its points or the press can tell");
  PALPATE_ASSIGN(Stage stage, set_up(request, io::Readers(), no_progress()));
  HuntScene scene;
  scene.input = std::move(stage.scene.input);
  scene.path = std::move(stage.path);
  scene.spacing_mm = made.nominal_spacing_mm;
  scene.truth = std::move(*stage.reference);
  const geometry::Aabb box = scene.input.models[0].cloud->box_mm();
  const auto at_border =
      std::find_if(scene.truth->frames.begin(), scene.truth->frames.end(), [&](const trace::TruthFrame& f) {
        return f.frame.contact &&
               to_border_mm(quarry, box, f.frame.god_object_mm) < kBorderSpacings * scene.spacing_mm;
      });
  const auto kept = static_cast<std::size_t>(at_border - scene.truth->frames.begin());
  if (kept < kFewestHandFrames) return not_judged("the hand is soon at a border");
  scene.truth->frames.resize(kept);
  scene.path.t_s.resize(kept);
  scene.path.hip_mm.resize(kept);
  return scene;
}

}  // namespace palpate::experiments
