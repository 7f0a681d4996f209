#include "experiments/run/surface_keys.h"

#include <fmt/format.h>

#include <optional>

#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/core/message_text.h"
#include "toolkit/core/physical_ranges.h"

namespace palpate::experiments {
namespace {

/// A value that the command line gives to every model.
struct Given {
  std::optional<double> stiffness_n_per_mm;
  std::optional<surface::Friction> friction;
  std::optional<double> deformation;
};

Result<double> number(const char* option, const std::string& text, const NumberRange& range) {
  Result<double> value = read_number(text, range);
  if (!value) return Error{fmt::format("--{}: {}", option, value.error().what), value.error().remedy, {}, 0};
  return value;
}

Result<surface::Friction> friction(const std::string& text) {
  std::vector<double> values;
  for (const std::string& part : split_list(text)) {
    const Result<double> mu = number("friction", part, kFrictionCoefficients);
    if (!mu) return mu.error();
    values.push_back(*mu);
  }
  if (values.size() > 2 || values.back() > values.front())
    return Error{
        fmt::format("--friction: {} is not one coefficient, or a static and then a dynamic one, not larger",
                    shown(text)),
        "write one number, or two as in 0.7,0.5",
        {},
        0};
  return surface::Friction{values.front(), values.back()};
}

Result<Given> parse(const SurfaceArguments& arguments) {
  Given given;
  if (!arguments.stiffness.empty()) {
    const Result<double> k = number("stiffness", arguments.stiffness, kStiffnessesNPerMm);
    if (!k) return k.error();
    given.stiffness_n_per_mm = *k;
  }
  if (!arguments.friction.empty()) {
    const Result<surface::Friction> mu = friction(arguments.friction);
    if (!mu) return mu.error();
    given.friction = *mu;
  }
  if (!arguments.deformation.empty()) {
    const Result<double> c = number("deformation", arguments.deformation, {0.0, 1.0});
    if (!c) return c.error();
    if (!(*c < 1.0))
      return Error{
          "--deformation: 1 would take all of the force away", "give a number from 0, below 1", {}, 0};
    given.deformation = *c;
  }
  return given;
}

/// A value from the command line beside one that the scene takes point by point.
Status check_source(const scene::SceneFile& scene, const scene::SceneModel& model, const char* option,
                    bool given, const std::string& source) {
  if (!given || source.empty()) return Done{};
  return Error{
      fmt::format("--{} cannot hold: '{}' takes it point by point from {}", option, model.name, source),
      "leave the option out, or take the key out of the scene", scene.path, model.sources.line};
}

Status check_sources(const scene::SceneFile& scene, const scene::SceneModel& model, const Given& given) {
  const scene::SurfaceSources& s = model.sources;
  const auto column = [](const std::string& name) {
    return name.empty() ? std::string() : fmt::format("the column '{}'", name);
  };
  const std::string friction = s.friction_map ? fmt::format("the image {}", s.friction_map->image)
                                              : column(s.static_friction_column + s.dynamic_friction_column);
  for (const auto& [option, is_given, source] :
       {std::tuple{"stiffness", given.stiffness_n_per_mm.has_value(), column(s.stiffness_column)},
        {"friction", given.friction.has_value(), friction},
        {"deformation", given.deformation.has_value(), column(s.deformation_column)}})
    PALPATE_TRY(check_source(scene, model, option, is_given, source));
  return Done{};
}

void set(const Given& given, scene::SceneModel& model, SurfaceReport& report) {
  if (given.stiffness_n_per_mm) model.surface.stiffness_n_per_mm = *given.stiffness_n_per_mm;
  if (given.friction) model.surface.friction = *given.friction;
  if (given.deformation) model.surface.deformation = *given.deformation;
  for (const scene::SceneRegion& region : model.regions)
    for (const auto& [option, keeps] :
         {std::pair{"stiffness", given.stiffness_n_per_mm && region.stiffness_n_per_mm},
          {"friction", given.friction && region.friction},
          {"deformation", given.deformation && region.deformation}})
      if (keeps)
        report.warnings.push_back(
            fmt::format("--{} does not hold in a region of '{}' (line {}), which has its own.", option,
                        model.name, region.line));
}

std::string text_of(const Given& given) {
  std::string text;
  const auto add = [&](const std::string& value) { text += (text.empty() ? "" : ", ") + value; };
  if (given.stiffness_n_per_mm) add(fmt::format("stiffness {} N/mm", *given.stiffness_n_per_mm));
  if (given.friction)
    add(fmt::format("friction {} static, {} dynamic", given.friction->static_coefficient,
                    given.friction->dynamic_coefficient));
  if (given.deformation) add(fmt::format("deformation {}", *given.deformation));
  return text;
}

}  // namespace

Result<SurfaceReport> set_surfaces(const SurfaceArguments& arguments, scene::SceneFile& scene) {
  SurfaceReport report;
  if (!arguments.any()) return report;
  const Result<Given> given = parse(arguments);
  if (!given) return given.error();
  for (scene::SceneModel& model : scene.models) {
    PALPATE_TRY(check_sources(scene, model, *given));
    set(*given, model, report);
  }
  report.notes.push_back(fmt::format("From the command line, for every model: {}.", text_of(*given)));
  return report;
}

}  // namespace palpate::experiments
