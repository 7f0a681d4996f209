#include "experiments/ablate/ablate.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <utility>

namespace palpate::experiments {
namespace {

using Models = std::vector<render::ModelInput>;

template <class Has>
bool any_of(const Models& models, Has&& has) {
  return std::any_of(models.begin(), models.end(), std::forward<Has>(has));
}

const surface::PointProperties* properties_of(const render::ModelInput& model) {
  return model.surface.per_point.get();
}

/// Removes some columns; without any left, the object.
template <class Clear>
void clear_columns(surface::Surface& s, Clear&& clear) {
  if (s.per_point == nullptr) return;
  auto rest = std::make_shared<surface::PointProperties>(*s.per_point);
  clear(*rest);
  s.per_point = rest->varies_stiffness() || rest->varies_friction() ? std::move(rest) : nullptr;
}

class Variants {
 public:
  Variants(const scene::LoadedScene& scene, const RendererRequest& request) {
    all_.push_back({{}, "all that the scene asks for", scene, request});
  }

  /// Adds a variant if the stage exists; leave_out(variant) removes the stage.
  template <class LeaveOut>
  void add(bool is_there, std::string stage, std::string instead, LeaveOut&& leave_out) {
    if (!is_there) return;
    Variant variant = all_.front();
    variant.stage = std::move(stage);
    variant.instead = std::move(instead);
    leave_out(variant);
    all_.push_back(std::move(variant));
  }
  /// The same with leave_out(model) for each model.
  template <class LeaveOut>
  void add_for_models(bool is_there, std::string stage, std::string instead, LeaveOut&& leave_out) {
    add(is_there, std::move(stage), std::move(instead), [&](Variant& variant) {
      for (render::ModelInput& model : variant.scene.input.models) leave_out(model);
    });
  }
  [[nodiscard]] const Models& models() const { return all_.front().scene.input.models; }
  [[nodiscard]] const Variant& whole() const { return all_.front(); }
  [[nodiscard]] std::vector<Variant> take() { return std::move(all_); }

 private:
  std::vector<Variant> all_;
};

void add_surface(Variants& variants) {
  const Models models = variants.models();
  variants.add_for_models(any_of(models,
                                 [](const auto& m) {
                                   return m.surface.friction.any() || (properties_of(m) != nullptr &&
                                                                       properties_of(m)->varies_friction());
                                 }),
                          "friction", "a surface without any", [](render::ModelInput& m) {
                            m.surface.friction = {};
                            clear_columns(m.surface, [](surface::PointProperties& p) {
                              p.static_friction.clear();
                              p.dynamic_friction.clear();
                            });
                          });
  variants.add_for_models(
      any_of(models,
             [](const auto& m) {
               return m.surface.deformation > 0.0 ||
                      (properties_of(m) != nullptr && !properties_of(m)->deformation.empty());
             }),
      "deformation", "the rigid force", [](render::ModelInput& m) {
        m.surface.deformation = 0.0;
        clear_columns(m.surface, [](surface::PointProperties& p) { p.deformation.clear(); });
      });
  variants.add_for_models(
      any_of(models,
             [](const auto& m) {
               return properties_of(m) != nullptr && !properties_of(m)->stiffness_n_per_mm.empty();
             }),
      "stiffness by point", "the model's one value", [](render::ModelInput& m) {
        clear_columns(m.surface, [](surface::PointProperties& p) { p.stiffness_n_per_mm.clear(); });
      });
  variants.add_for_models(any_of(models, [](const auto& m) { return m.surface.texture.any(); }), "texture",
                          "the surface of the points", [](render::ModelInput& m) { m.surface.texture = {}; });
  variants.add_for_models(any_of(models, [](const auto& m) { return m.surface.dent.any(); }), "dents",
                          "points that stay", [](render::ModelInput& m) { m.surface.dent = {}; });
}

void add_models(Variants& variants) {
  const Models models = variants.models();
  variants.add(any_of(models, [](const auto& m) { return m.motion != nullptr; }), "motion",
               "models at rest where they begin", [](Variant& variant) {
                 for (render::ModelInput& m : variant.scene.input.models) m.motion = nullptr;
                 variant.scene.input.simulation = nullptr;
               });
  if (models.size() > kMostModelsInTurn) {
    variants.add(true, "all models but the first", "one model",
                 [](Variant& variant) { variant.scene.input.models.resize(1); });
    return;
  }
  for (std::size_t i = 0; models.size() > 1 && i < models.size(); ++i)
    variants.add(true, fmt::format("model {}, {}", i + 1, models[i].name), "the others",
                 [i](Variant& variant) {
                   Models& left = variant.scene.input.models;
                   left.erase(left.begin() + static_cast<std::ptrdiff_t>(i));
                 });
}

void add_control(Variants& variants) {
  const scene::LoadedScene& scene = variants.whole().scene;
  const control::ControlOptions control = scene.control;
  variants.add(scene.input.force_limit_n > 0.0, "force limit", "forces as large as they come",
               [](Variant& v) { v.scene.input.force_limit_n = 0.0; });
  variants.add(control.coupling.has_value(), "coupling", "the renderer's own force",
               [](Variant& v) { v.scene.control.coupling.reset(); });
  variants.add(control.filter.any(), "force filter", "forces that change as fast as they come",
               [](Variant& v) { v.scene.control.filter = {}; });
  variants.add(control.passivity.has_value(), "passivity", "energy that nobody watches",
               [](Variant& v) { v.scene.control.passivity.reset(); });
}

void add_cleaning(Variants& variants, const scene::LoadedScene* uncleaned) {
  variants.add(uncleaned != nullptr, "cleaning of the scene", "the points as they were read",
               [&](Variant& v) { v.scene = *uncleaned; });
  variants.add(!variants.whole().request.clean.empty(), "cleaning of the renderer", "the scene's points",
               [](Variant& v) { v.request.clean.clear(); });
}

bool is_shaded(const render::Decisions& decided) {
  for (const render::ModelDecisions& model : decided.models)
    for (const render::Decision& d : model.decisions)
      if (d.about == "shading" && d.choice != "none") return true;
  return false;
}

/// Adds options other than their defaults, and shading, which some renderers add themselves.
void add_options(Variants& variants, const render::Registry& registry, const render::Decisions& decided) {
  const RendererRequest& request = variants.whole().request;
  const render::RendererInfo& info = *registry.find(request.name);
  for (const OptionSpec& spec : info.options) {
    if (!request.options.has(spec.key) || request.options.text(spec.key) == spec.default_value) continue;
    Options rest;
    for (const auto& [key, value] : request.options.all())
      if (key != spec.key) rest.set(key, value);
    variants.add(registry.make(info.name, rest).ok(), "option " + spec.key,
                 spec.key + "=" + spec.default_value, [&](Variant& v) { v.request.options = rest; });
  }
  const bool can_do_without =
      std::any_of(info.options.begin(), info.options.end(), [](const OptionSpec& spec) {
        return spec.key == "shading" &&
               std::find(spec.choices.begin(), spec.choices.end(), "none") != spec.choices.end();
      });
  Options flat = request.options;
  if (can_do_without) flat.set("shading", "none");
  variants.add(can_do_without && !request.options.has("shading") && is_shaded(decided), "shading",
               "the force of the nearest point", [&](Variant& v) { v.request.options = flat; });
}

}  // namespace

std::vector<Variant> variants_of(const scene::LoadedScene& scene, const RendererRequest& request,
                                 const render::Registry& registry, const render::Decisions& decided,
                                 const scene::LoadedScene* uncleaned) {
  Variants variants(scene, request);
  add_surface(variants);
  add_models(variants);
  add_control(variants);
  add_cleaning(variants, uncleaned);
  add_options(variants, registry, decided);
  return variants.take();
}

}  // namespace palpate::experiments
