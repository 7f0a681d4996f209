// The renderer around a rival's model: everything that is the same for all point-based rivals.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "toolkit/render/registry.h"
#include "toolkit/render/summed_models.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// What every rival's model has beside its own data. Belongs to one thread.
struct RivalModel {
  render::ModelPose place;
  render::SurfaceField surface;
  render::SurfaceState state;  ///< of rivals with a god object

  [[nodiscard]] render::ModelPose& pose() noexcept { return place; }
  /// The answer of a rival whose god object is `pull` away from the HIP: friction and texture as on every
  /// other renderer.
  [[nodiscard]] render::ModelAnswer touch(const Vec3& hip, const Vec3& pull) noexcept {
    const render::SurfaceAnswer answer = render::respond_uniform(state, surface, hip, pull, place.origin_mm);
    return {true, false, answer.god_object_mm, answer.force_n};
  }
};

/// Where a rival comes from.
struct RivalText {
  const char* name;
  const char* summary;
  const char* source;
};

/// Model: derived from RivalModel, with
///   static constexpr RivalText kText;
///   static constexpr bool kGodObject;  friction and texture need one
///   static std::vector<OptionSpec> specs();
///   static Status prepare(Model&, const ModelInput&, const Options&, const PrepareContext&, PrepareReport&);
///   std::string work_bound() const;  of a frame with this model
///   void reset(const Vec3&) noexcept; ModelAnswer update(const Vec3&, FrameCounters&) noexcept.
template <class Model>
class RivalRenderer final : public render::HapticRenderer {
 public:
  explicit RivalRenderer(const Options& options) : options_(options) {}

  Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                        const render::PrepareContext& context) override {
    render::PrepareReport report;
    if (scene.models.empty()) return Error{"the scene has no model", "add a [[model]]", {}, 0};
    models_.clear(scene.force_limit_n);
    for (const render::ModelInput& input : scene.models) {
      if (Status fit = check(input); !fit.ok()) return std::move(fit).error();
      auto model = std::make_unique<Model>();
      Result<render::SurfaceField> surface = render::build_uniform_surface_field(input.surface, report);
      if (!surface.ok()) return std::move(surface).error();
      model->surface = std::move(surface).value();
      if (!Model::kGodObject && model->surface.features != 0)
        report.notes.push_back("friction and texture: not rendered, a penalty has no god object");
      model->place = render::ModelPose(input, input.cloud->origin_mm);
      if (Status done = Model::prepare(*model, input, options_, context, report); !done.ok())
        return std::move(done).error();
      models_.add(std::move(model));
    }
    models_.reset(Vec3::Zero());
    return report;
  }
  void reset(const Vec3& hip_mm) noexcept override { models_.reset(hip_mm); }
  render::Frame step(const Vec3& hip_mm, double dt_s) noexcept override { return models_.step(hip_mm, dt_s); }
  render::FrameCounters counters() const noexcept override { return models_.counters(); }
  render::Description describe() const override {
    return {Model::kText.name, Model::kText.summary, Model::kText.source,
            models_.size() > 0 ? models_[0].work_bound() : Model().work_bound(), options_};
  }

 private:
  static Status check(const render::ModelInput& input) {
    if (input.cloud->empty())
      return Error{
          "the model '" + input.name + "' has no points", "give a file with at least one point", {}, 0};
    if (input.surface.per_point == nullptr) return Done{};
    return Error{"model '" + input.name + "' has properties that differ from point to point",
                 std::string(Model::kText.name) +
                     " takes one value for the whole model: leave out regions and columns",
                 {},
                 0};
  }

  Options options_;
  render::SummedModels<Model> models_;
};

template <class Model>
[[nodiscard]] render::RendererInfo rival_info() {
  render::RendererInfo info;
  info.name = Model::kText.name;
  info.summary = Model::kText.summary;
  info.source = Model::kText.source;
  info.options = Model::specs();
  info.make = [](const Options& options) { return std::make_unique<RivalRenderer<Model>>(options); };
  return info;
}

}  // namespace palpate::baselines
