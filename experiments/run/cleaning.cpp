#include "experiments/run/cleaning.h"

#include <fmt/format.h>

#include <palpate/baselines.h>

namespace palpate::experiments {
namespace {

/// The properties of the points that were kept.
std::shared_ptr<const surface::PointProperties> follow(const surface::PointProperties& before,
                                                       const std::vector<std::uint32_t>& from) {
  auto after = std::make_shared<surface::PointProperties>();
  for (auto values :
       {&surface::PointProperties::stiffness_n_per_mm, &surface::PointProperties::static_friction,
        &surface::PointProperties::dynamic_friction, &surface::PointProperties::deformation}) {
    if ((before.*values).empty()) continue;
    ((*after).*values).reserve(from.size());
    for (const std::uint32_t i : from) ((*after).*values).push_back((before.*values)[i]);
  }
  return after;
}

}  // namespace

const scene::Cleaning& all_cleaning() {
  static const scene::Cleaning cleaning = [] {
    scene::Cleaning all;
    baselines::register_cleaning(all);
    return all;
  }();
  return cleaning;
}

std::string cleaning_text(std::span<const NamedOptions> steps) {
  std::string text;
  for (const NamedOptions& step : steps) {
    text += (text.empty() ? "" : "+") + step.name;
    for (const auto& [key, value] : step.options.all()) text += fmt::format("/{}={}", key, value);
  }
  return text;
}

Result<CleanedScene> clean_scene(const render::SceneInput& input, std::span<const NamedOptions> steps,
                                 int threads, Progress& progress) {
  CleanedScene cleaned{input, {}, {}};
  for (render::ModelInput& model : cleaned.input.models) {
    Result<scene::CleanedCloud> own = all_cleaning().run(*model.cloud, steps, threads, progress);
    if (!own) return Error{model.name + ": " + own.error().what, own.error().remedy, {}, 0};
    model.cloud = std::make_shared<const cloud::Cloud>(std::move(own->cloud));
    model.original_mesh = nullptr;
    if (model.surface.per_point) model.surface.per_point = follow(*model.surface.per_point, own->from);
    cleaned.phases.insert(cleaned.phases.end(), own->phases.begin(), own->phases.end());
    cleaned.notes.insert(cleaned.notes.end(), own->notes.begin(), own->notes.end());
  }
  return cleaned;
}

}  // namespace palpate::experiments
